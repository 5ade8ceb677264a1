"""Distances of MuJoCo against closed forms, and the culled query against all pairs."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from skywright.core.rotations import exp_so3, quat_from_rot, rot_z
from skywright.description.loader import load_description
from skywright.description.world.surface import build_cylinder
from skywright.models.drawing import build_drawing, is_propeller
from skywright.models.geometry import (
    FAR,
    ClearanceQuery,
    build_clearance,
    compute_clearance,
    compute_self_clearance,
    query_clearance,
)
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene, set_pose
from skywright.models.things.box import Box

Array = NDArray[np.float64]


def rotation(vector: Array) -> Array:
    out = np.empty((3, 3))
    exp_so3(vector, out)
    return out


@pytest.fixture(scope="module")
def case():
    d = load_description("pipe-weld-scan")
    box = Box(x_m=0.0, y_m=2.0, z_m=1.0, size_x_m=0.4, size_y_m=0.6, size_z_m=0.8, yaw_deg=30.0)
    pipe = d.world.pipe.model_copy(update={"inclination_deg": 20.0, "yaw_deg": 35.0})
    world = d.world.model_copy(update={"things": {"crate": box}, "pipe": pipe})
    scene = build_scene(d.robot, world)
    return scene, build_clearance(scene), build_cylinder(pipe), box


def pair_distance(q: ClearanceQuery, a: str, b: str, p: Array, R: Array, joints: Array) -> float:
    """Distance of one named pair through the compiled query."""
    core = q.core._replace(
        pairs=np.array([[q.names.index(a), q.names.index(b)]]), n_world=1, probe=np.zeros(1)
    )
    return query_clearance(core, p, R, joints, 0.0, 50.0)[0]


def to_cylinder(x: Array, p: Array, R: Array, radius: float, half: float) -> Array:
    """Nearest point of a solid cylinder (axis R[:, 2]) to x."""
    local = R.T @ (x - p)
    r = math.hypot(local[0], local[1])
    if r > radius:
        local[:2] *= radius / r
    local[2] = np.clip(local[2], -half, half)
    return p + R @ local


def place(q: ClearanceQuery, scene, p: Array, R: Array, joints: Array) -> None:
    set_pose(scene, q.data, p, quat_from_rot(R), joints)
    mujoco.mj_kinematics(q.model, q.data)


poses = st.tuples(
    *(st.floats(-1.0, 1.0) for _ in range(3)), *(st.floats(-0.7, 0.7) for _ in range(3))
)


@given(poses)
@settings(max_examples=60)
def test_sphere_distances_match_closed_forms(case, pose) -> None:
    scene, q, cyl, box = case
    p, R = np.array([*pose[:2], 1.5 + pose[2]]), rotation(np.array(pose[3:]))
    joints = np.array([-0.5, 0.9])
    place(q, scene, p, R, joints)
    x = q.data.geom_xpos[q.names.index("foot1")].copy()
    r = q.model.geom_size[q.names.index("foot1")][0]
    assert pair_distance(q, "foot1", "ground", p, R, joints) == pytest.approx(x[2] - r, abs=1e-9)
    # pipe: a finite cylinder, from outside
    axis_first = cyl.R_WP[:, [2, 0, 1]]
    near = to_cylinder(x, cyl.p_WP, axis_first, cyl.radius, cyl.half_length)
    if np.linalg.norm(x - near) > r:
        d = pair_distance(q, "foot1", "pipe", p, R, joints)
        assert d == pytest.approx(np.linalg.norm(x - near) - r, abs=2e-6)
    # box
    local = rot_z(math.radians(box.yaw_deg)).T @ (x - [box.x_m, box.y_m, box.z_m])
    half = 0.5 * np.array([box.size_x_m, box.size_y_m, box.size_z_m])
    out = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0))
    if out > r:
        d = pair_distance(q, "foot1", "crate", p, R, joints)
        assert d == pytest.approx(out - r, abs=2e-6)


@given(poses)
@settings(max_examples=40)
def test_disc_and_capsule_over_the_plane(case, pose) -> None:
    scene, q, _, _ = case
    p, R = np.array([*pose[:2], 1.5 + pose[2]]), rotation(np.array(pose[3:]))
    joints = np.array([-0.5, 0.9])
    place(q, scene, p, R, joints)
    g = q.names.index("propeller1")
    z = q.data.geom_xmat[g].reshape(3, 3)[2, 2]
    radius, half = q.model.geom_size[g][:2]
    low = q.data.geom_xpos[g][2] - radius * math.sqrt(1 - z * z) - half * abs(z)
    assert pair_distance(q, "propeller1", "ground", p, R, joints) == pytest.approx(low, abs=1e-9)
    g = q.names.index("link2 shell")
    z = q.data.geom_xmat[g].reshape(3, 3)[2, 2]
    radius, half = q.model.geom_size[g][:2]
    low = q.data.geom_xpos[g][2] - radius - half * abs(z)
    assert pair_distance(q, "link2 shell", "ground", p, R, joints) == pytest.approx(low, abs=1e-9)


@given(poses)
@settings(max_examples=40)
def test_disc_against_the_pipe_by_alternating_projections(case, pose) -> None:
    """Two convex bodies: projections to and fro converge to the nearest points."""
    scene, q, cyl, _ = case
    p = cyl.p_WP + np.array([pose[0] - 1.3, pose[1], pose[2]])
    R, joints = rotation(np.array(pose[3:])), np.array([-0.5, 0.9])
    place(q, scene, p, R, joints)
    g = q.names.index("propeller0")
    frame = q.data.geom_xmat[g].reshape(3, 3).copy()
    centre, size = q.data.geom_xpos[g].copy(), q.model.geom_size[g]
    axis_first = cyl.R_WP[:, [2, 0, 1]]
    a = centre
    for _ in range(3000):
        b = to_cylinder(a, cyl.p_WP, axis_first, cyl.radius, cyl.half_length)
        a = to_cylinder(b, centre, frame, size[0], size[1])
    d = float(np.linalg.norm(a - b))
    if d > 0.01:
        got = pair_distance(q, "propeller0", "pipe", p, R, joints)
        assert got <= d + 1e-6  # the projections approach from above
        assert got == pytest.approx(d, abs=2e-5)


@given(poses, st.tuples(st.floats(-2.0, 2.0), st.floats(-2.5, 2.5)))
@settings(max_examples=60)
def test_culling_changes_nothing(case, pose, angles) -> None:
    _, q, cyl, _ = case
    p = cyl.p_WP + np.array([pose[0] - 0.8, pose[1], pose[2] * 0.5])
    R, joints = rotation(0.5 * np.array(pose[3:])), np.array(angles)
    for exclude in (False, True):
        found = compute_clearance(q, p, R, joints, exclude)
        every = [
            mujoco.mj_geomDistance(q.model, q.data, int(a), int(b), FAR, None)
            for (a, b), probe in zip(q.core.pairs, q.core.probe, strict=True)
            if q.names[b] in ("ground", "pipe", "support0", "support1", "crate")
            and not (exclude and probe)
        ]
        assert found.distance == pytest.approx(min(every), abs=1e-6)


def test_names_and_exclusions(case) -> None:
    _, q, cyl, _ = case
    p = cyl.p_WP + np.array([0.0, 0.0, cyl.radius + 0.35])
    found = compute_clearance(q, p, np.eye(3), np.array([0.0, math.radians(165)]))
    assert q.names[found.other_geom] == "pipe"
    standing = compute_clearance(q, np.array([0.0, 0.0, 0.2]), np.eye(3), np.array([-0.7, 0.7]))
    assert standing.distance > 0.05  # feet on the ground do not count


def test_arm_folded_into_a_leg_is_seen(case) -> None:
    _, q, _, _ = case
    folded = compute_self_clearance(q, np.array([0.0, math.radians(165)]))
    assert folded.distance > 0.02
    assert {q.names[folded.robot_geom].split()[0]} <= {"link1", "link2", "holder", "tip", "pen"}


def test_a_link_with_a_name_like_a_part_of_the_platform_is_a_link() -> None:
    """Its pair with the ground stays, and no link is paired with itself."""
    d = load_description("pipe-weld-scan")
    arm = d.robot.arm
    assert arm is not None
    names = ["propeller_arm", "leg1", "foot_link", "boom2"][: len(arm.links)]
    links = dict(zip(names, arm.links.values(), strict=True))
    robot = d.robot.model_copy(update={"arm": arm.model_copy(update={"links": links})})
    plain = build_clearance(build_scene(d.robot, d.world))
    named = build_clearance(build_scene(robot, d.world))
    assert named.core.pairs.tolist() == plain.core.pairs.tolist()
    q = posture(robot, "working")
    assert compute_self_clearance(named, q) == compute_self_clearance(plain, q)
    drawn = build_drawing(robot, d.world).parts
    propellers = {x.name for part in drawn for x in part.shapes if is_propeller(part, x)}
    assert propellers == {f"propeller{i}" for i in range(len(robot.rotors.spin))}
