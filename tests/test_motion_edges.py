"""Distances against brute force, kinematics against MuJoCo, certified edges against samples."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.models.scene import build_scene
from skywright.planning.motion.connect import draw_coordinates
from skywright.planning.motion.distance import box_box, segment_box, segment_segment
from skywright.planning.motion.edges import (
    is_edge_free,
    is_state_free,
    place_shapes,
    state_clearance,
)
from skywright.planning.motion.planner import sample_reserve
from skywright.planning.motion.rng import build_state, uniform
from skywright.planning.motion.space import build_scratch
from skywright.planning.motion.transport import build_scenario, build_transport

Array = NDArray[np.float64]

ROBOT = load_robot("ars-lrm")[0]
WORLD = load_world("pipe-structures")[0]
PROBLEMS = [build_transport(ROBOT, build_scenario(WORLD, seed)) for seed in (None, 2, 3)]

point = st.tuples(*[st.floats(-2, 2) for _ in range(3)]).map(np.array)
size = st.tuples(*[st.floats(0.05, 1.0) for _ in range(3)]).map(np.array)
angles = st.tuples(*[st.floats(-3, 3) for _ in range(3)])


def turn(a: tuple[float, float, float]) -> Array:
    return np.ascontiguousarray(rot_z(a[0]) @ rot_y(a[1]) @ rot_x(a[2]))


def to_box(p: Array, centre: Array, rot: Array, half: Array) -> Array:
    """Distance of points (n, 3) to a box."""
    return np.linalg.norm(np.maximum(np.abs((p - centre) @ rot) - half, 0.0), axis=-1)


@settings(max_examples=100, deadline=None)
@given(point, point, point, point)
def test_segments(a0: Array, a1: Array, b0: Array, b1: Array) -> None:
    n = np.zeros(3)
    d, t = segment_segment(a0, a1, b0, b1, n)
    s = np.linspace(0, 1, 201)
    pa = a0 + s[:, None] * (a1 - a0)
    pb = b0 + s[:, None] * (b1 - b0)
    brute = np.min(np.linalg.norm(pa[:, None] - pb[None], axis=-1))
    step = (np.linalg.norm(a1 - a0) + np.linalg.norm(b1 - b0)) / 200
    # of segments within 1e-6 rad of parallel, one end is taken: off by that much of a length
    assert d <= brute + 1e-6 * np.linalg.norm(a1 - a0) + 1e-9 and d >= brute - step - 1e-9
    if d > 1e-5:  # both segments lie on their sides of the plane across n
        on_a = a0 + t * (a1 - a0)
        assert min((a0 - on_a) @ n, (a1 - on_a) @ n) > -1e-6
        assert max((b0 - on_a) @ n, (b1 - on_a) @ n) < -d + 1e-6


@settings(max_examples=100, deadline=None)
@given(point, point, point, angles, size)
def test_segment_and_box(a0: Array, a1: Array, centre: Array, a: Any, half: Array) -> None:
    n, rot = np.zeros(3), turn(a)
    d, t = segment_box(a0, a1, centre, rot, half, n)
    s = np.linspace(0, 1, 2001)[:, None]
    brute = np.min(to_box(a0 + s * (a1 - a0), centre, rot, half))
    assert abs(d - to_box(a0 + t * (a1 - a0), centre, rot, half)) < 1e-9
    assert d <= brute + 1e-9 and d >= brute - np.linalg.norm(a1 - a0) / 2000 - 1e-9


@settings(max_examples=50, deadline=None)
@given(point, angles, size, point, angles, size)
def test_boxes(ca: Array, a: Any, ha: Array, cb: Array, b: Any, hb: Array) -> None:
    spec = mujoco.MjSpec()
    for name, p, r, h in (("a", ca, a, ha), ("b", cb, b, hb)):
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, turn(r).ravel())
        spec.worldbody.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=h, pos=p, quat=quat
        )  # fmt: skip
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    theirs = mujoco.mj_geomDistance(model, data, 0, 1, 20.0, np.zeros(6))
    n = np.zeros(3)
    ours, _ = box_box(ca, turn(a), ha, cb, turn(b), hb, n)
    assert max(theirs, 0.0) == pytest.approx(ours, abs=1e-5)


def test_kinematics_and_equilibrium_agree_with_mujoco() -> None:
    """Bodies stand where MuJoCo puts them, and gravity makes no torque about the passive joint."""
    problem = PROBLEMS[0]._replace()
    bare = build_transport(ROBOT, WORLD, problem.transport._replace(bar_length=0.0))
    scene = build_scene(ROBOT, WORLD)
    data = mujoco.MjData(scene.model)
    scratch, state = build_scratch(bare.space), build_state(np.random.default_rng(1))
    c = np.zeros(4)
    for _ in range(50):
        draw_coordinates(bare.space[0], state, c)
        place(bare.space, scratch, c, np.zeros(4))
        u = scratch[0]["u"]
        data.qpos[:3] = u[:3]
        data.qpos[3:7] = [1, 0, 0, 0]
        data.qpos[scene.places.joint_qpos] = u[4 : 4 + len(scene.places.joint_qpos)]
        mujoco.mj_forward(scene.model, data)
        np.testing.assert_allclose(
            scratch[0]["p"][: scene.model.nbody - 1], data.xpos[1:], atol=1e-9
        )
        dof = scene.places.joint_dof[0]
        assert abs(data.qfrc_bias[dof]) < 1e-9  # at rest the bias is gravity


@njit
def place(space: Any, scratch: Any, c: Array, d: Array) -> None:
    place_shapes(space[0], c, d, scratch[0])


def test_velocities_and_bounds_against_differences() -> None:
    rng = np.random.default_rng(2)
    for problem in PROBLEMS:
        space = problem.space
        ns = int(space["ns"][0])
        low, high = space[0]["low"][:4], space[0]["high"][:4]
        for _ in range(20):
            a, b = low + (high - low) * rng.random(4), low + (high - low) * rng.random(4)
            d, s = b - a, 0.3
            ends = []
            for x in (s - 1e-4, s, s + 1e-4):
                k = build_scratch(space)
                place(space, k, a + x * d, d)
                ends.append(k)
            for p, v in (("p0", "v0"), ("p1", "v1")):
                before, here, after = (k[0][p][:ns] for k in ends)
                np.testing.assert_allclose((after - before) / 2e-4, ends[1][0][v][:ns], atol=1e-5)
                second = np.linalg.norm(after - 2 * here + before, axis=1) / 1e-8
                k = build_scratch(space)
                edge(space, k, a, b)
                assert np.all(second <= k[0]["acc"][:ns] + 1e-5)
                free = np.linalg.norm(ends[1][0][v][:ns], axis=1)
                most = np.linalg.norm(d[:2]) + k[0]["omega"][:ns] * space[0]["reach"][:ns]
                assert np.all(free <= most + 1e-9)


@njit
def edge(space: Any, scratch: Any, a: Array, b: Array) -> bool:
    return is_edge_free(space[0], a, b, scratch[0])


@njit
def draw_edges(
    space: Any, scratch: Any, seed: Any, count: int, a: Array, b: Array, free: Any
) -> None:
    """Edges of mixed length that start at free places, near obstacles too."""
    r, k = space[0], scratch[0]
    i = 0
    while i < count:
        draw_coordinates(r, seed, a[i])
        if not is_state_free(r, a[i], k):
            continue
        draw_coordinates(r, seed, b[i])
        share = uniform(seed) ** 3
        for j in range(r.n):
            b[i, j] = a[i, j] + share * (b[i, j] - a[i, j])
        free[i] = is_edge_free(r, a[i], b[i], k)
        i += 1


@pytest.mark.parametrize("which", range(3))
def test_a_certified_edge_keeps_its_margins_everywhere(which: int) -> None:
    """No edge that is called free comes closer than the margin at any of its samples."""
    space, n = PROBLEMS[which].space, 600
    scratch = build_scratch(space)
    a, b, free = np.zeros((n, 4)), np.zeros((n, 4)), np.zeros(n, dtype=bool)
    draw_edges(space, scratch, build_state(np.random.default_rng(which)), n, a, b, free)
    assert 0.1 < free.mean() < 0.95
    wrongly_blocked = 0
    for i in range(n):
        reserve, _ = sample_reserve(space, scratch, np.array([a[i], b[i]]), 4e-3)
        if free[i]:
            assert reserve >= 0.0
        elif reserve > 1e-3:
            wrongly_blocked += 1
    assert wrongly_blocked == 0  # it gives away less than a millimetre


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_state_reserve_and_state_check_agree(seed: int) -> None:
    space = PROBLEMS[seed % 3].space
    scratch = build_scratch(space)
    c = np.zeros(4)
    state = build_state(np.random.default_rng(seed))
    for _ in range(20):
        draw_coordinates(space[0], state, c)
        reserve, _ = state_clearance(space[0], c, scratch[0])
        assert is_state_free(space[0], c, scratch[0]) == (reserve >= 0.0)
    assert math.isfinite(reserve)
