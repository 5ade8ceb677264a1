"""The robot as URDF, and Pinocchio's dynamics of it against the scene's and our own.

Three derivations from one description: MuJoCo compiles the scene, Pinocchio reads the URDF, and
models/rigid_body.py computes composite body, Jacobians and gravity torques by itself.

MuJoCo's free joint has the linear velocity in W and the angular one in B; Pinocchio's free flyer
has both in B. With V_pin = T V_mj, T = diag(R_WB^T, 1, 1): M_mj = T^T M_pin T, and because T turns,
bias_mj = T^T (M_pin c + bias_pin) with c = (-w_WB_B x v_WB_B, 0).
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright import cli
from skywright.core.rotations import rot_from_quat
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.description.world.loader import load_world
from skywright.errors import InputError
from skywright.models.arm_body import Deviation
from skywright.models.body_records import Kinematics
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_tip,
    fill_gravity_torque,
    fill_hands,
    fill_kinematics,
    joint_names,
)
from skywright.models.scene import Scene, build_scene, set_pose
from skywright.models.springs import spring_torque
from skywright.models.urdf import build_urdf

ROBOTS = ("bimanual", "bimanual-longreach", "othex", "f550-bridge")
WORLD = load_world("open")[0]


class State(NamedTuple):
    """A state in MuJoCo's convention."""

    p: Any
    quat: Any  # wxyz
    q: Any  # in the scene's order
    v: Any  # linear in W, angular in B, joints

    @property
    def R(self):
        return rot_from_quat(self.quat)


class Pin(NamedTuple):
    """Pinocchio's model of a URDF, its joints brought into a given order."""

    model: Any
    data: Any
    order: Any  # index into v of each joint

    def q(self, s: State):
        out = pin.neutral(self.model)
        out[:3], out[3:7] = s.p, s.quat[[1, 2, 3, 0]]
        out[1 + self.order] = s.q
        return out

    def turn(self, s: State):
        """T of V_pin = T V_mj, joint order included."""
        n = self.model.nv
        T = np.zeros((n, n))
        T[:3, :3], T[3:6, 3:6] = s.R.T, np.eye(3)
        T[self.order, np.arange(6, n)] = 1.0
        return T

    def mass_matrix(self, s: State):
        T = self.turn(s)
        return T.T @ np.array(pin.crba(self.model, self.data, self.q(s))) @ T

    def bias(self, s: State):
        T, q = self.turn(s), self.q(s)
        v = T @ s.v
        c = np.zeros(self.model.nv)
        c[:3] = -np.cross(v[3:6], v[:3])
        # rnea at that acceleration is M c + bias
        return T.T @ pin.rnea(self.model, self.data, q, v, c)


def read(text: str, names: list[str]) -> Pin:
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    model.gravity.linear = np.array([0.0, 0.0, -WORLD.gravity_mps2])
    assert sorted(model.names[2:]) == sorted(names)
    order = np.array([model.joints[model.getJointId(n)].idx_v for n in names], dtype=int)
    return Pin(model, model.createData(), order)


def random_state(rng, n: int) -> State:
    quat = rng.normal(size=4)
    return State(
        rng.normal(size=3), quat / np.linalg.norm(quat), rng.uniform(-2.5, 2.5, n),
        rng.normal(size=6 + n) * 2.0,
    )  # fmt: skip


def compute_mujoco(model, data) -> tuple[Any, Any]:
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full, data.qfrc_bias.copy()


def compare_scene(robot: Robot, p: Any, seed: int, states: int) -> Iterator[State]:
    """Compare mass matrix and bias of the scene with Pinocchio's; yields each random state."""
    names, scene = joint_names(robot), build_scene(robot, WORLD)
    data, rng = mujoco.MjData(scene.model), np.random.default_rng(seed)
    for _ in range(states):
        s = random_state(rng, len(names))
        set_pose(scene, data, s.p, s.quat, s.q)
        data.qvel[:] = s.v
        full, bias = compute_mujoco(scene.model, data)
        np.testing.assert_allclose(full, p.mass_matrix(s), atol=1e-8, rtol=1e-9)
        np.testing.assert_allclose(bias, p.bias(s), atol=1e-8, rtol=1e-9)
        yield s


def hold_equal(robot: Robot, seed: int, states: int) -> None:
    """Mass matrix, bias, tip and hands of the scene and of our own record against Pinocchio."""
    p = read(build_urdf(robot), joint_names(robot))
    own = build_body_model(robot, WORLD.gravity_mps2)
    for s in compare_scene(robot, p, seed, states):
        _hold_record_equal(robot, own, p, s)


def _hold_record_equal(robot: Robot, own, p: Pin, s: State) -> None:
    """models/rigid_body.py: composite body, tip, hands and gravity torques."""
    n = len(s.q)
    at_B = s._replace(p=np.zeros(3), quat=np.array([1.0, 0, 0, 0]))
    M = p.mass_matrix(at_B)
    mass, com, inertia = compute_body(own, s.q)
    np.testing.assert_allclose(mass, M[0, 0], atol=1e-9)
    np.testing.assert_allclose(inertia, M[3:6, 3:6], atol=1e-9)
    # the linear-angular block is -m [p_BC]x
    np.testing.assert_allclose(mass * com, [M[1, 5], M[2, 3], M[0, 4]], atol=1e-9)
    if robot.arm is None:
        return
    k, full, torque = np.zeros(1, Kinematics.dtype), np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS)
    full[:n] = s.q
    fill_kinematics(own[0], full, k[0])
    fill_hands(own[0], k[0])
    g_B = s.R.T @ [0.0, 0.0, -WORLD.gravity_mps2]
    fill_gravity_torque(own[0], k[0], g_B, torque)
    still = p.bias(s._replace(v=0.0 * s.v))
    np.testing.assert_allclose(torque[:n], still[6:], atol=1e-9)
    frames = {"tip": (compute_tip(own, s.q), k[0]["J_BT"])}
    if robot.probe is None:
        hands = ["hand"] if robot.arm.sides == 1 else ["left_hand", "right_hand"]
        frames |= {
            name: ((k[0]["p_BH"][h], k[0]["R_BH"][h]), k[0]["J_BH"][h])
            for h, name in enumerate(hands)
        }
    q = p.q(at_B)
    pin.computeJointJacobians(p.model, p.data, q)
    pin.updateFramePlacements(p.model, p.data)
    for name, ((place, turn), jacobian) in frames.items():
        frame = p.model.getFrameId(name, pin.FrameType.BODY)
        np.testing.assert_allclose(p.data.oMf[frame].translation, place, atol=1e-10)
        np.testing.assert_allclose(p.data.oMf[frame].rotation, turn, atol=1e-10)
        J = pin.getFrameJacobian(p.model, p.data, frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(J[:3, p.order], jacobian[:, :n], atol=1e-10)


def test_a_bar_in_the_hands_is_a_link() -> None:
    """On the left hand, as in the scene. (The record gives each hand half of it.)"""
    bar = (("robot.arm.bar.mass_kg", 0.5), ("robot.arm.bar.length_m", 1.2))
    bare, robot = load_robot("ars-lrm")[0], load_robot("ars-lrm", bar)[0]
    names = joint_names(robot)
    p, without = read(build_urdf(robot), names), read(build_urdf(bare), names).model
    more = pin.computeTotalMass(p.model) - pin.computeTotalMass(without)
    assert more == pytest.approx(0.5)
    assert len(list(compare_scene(robot, p, seed=5, states=10))) == 10


@pytest.mark.parametrize("name", ROBOTS)
def test_pinocchio_scene_and_record_agree(name: str) -> None:
    hold_equal(load_robot(name)[0], seed=11, states=30)


def millimetres(low: int, high: int):
    """Metres; MuJoCo takes a centre closer than a micrometre to the frame for the frame's."""
    return st.integers(low, high).map(lambda n: n / 1000)


links = st.fixed_dictionaries(
    {
        "joint": st.sampled_from(["hinge", "hinge", "slide", "fixed"]),
        "axis": st.sampled_from(["x", "y", "z"]),
        "along": st.sampled_from(["x", "-z"]),
        "length_m": st.floats(0.02, 0.8),
        "mass_kg": st.floats(0.01, 2.0),
        "radius_m": st.floats(0.005, 0.05),
    },
    optional={
        "com_m": millimetres(-200, 500),
        "x_m": millimetres(-500, 500),
        "y_m": millimetres(-500, 500),
        "z_m": millimetres(-500, 500),
        "roll_deg": st.floats(-180.0, 180.0),
        "pitch_deg": st.floats(-180.0, 180.0),
        "yaw_deg": st.floats(-180.0, 180.0),
    },
)
centre = st.fixed_dictionaries({f"com_{axis}_m": millimetres(-200, 200) for axis in "xyz"})


@st.composite
def inertias(draw: Any, scale: float = 1e-3) -> dict[str, float]:
    """The six numbers of a body's inertia: of point masses at random places."""
    points = np.array(draw(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=4, max_size=6)))
    square = points.T @ points + 0.05 * np.eye(3)
    tensor = scale * (np.trace(square) * np.eye(3) - square)
    return {
        f"inertia_{'xyz'[a]}{'xyz'[b]}_kgm2": float(tensor[a, b])
        for a in range(3)
        for b in range(a, 3)
        if a == b or abs(tensor[a, b]) > 1e-9
    }


@st.composite
def given_bodies(draw: Any) -> dict[str, Any]:
    """A link whose centre of mass and inertia are given in full."""
    link = {key: value for key, value in draw(links).items() if key != "com_m"}
    return link | draw(centre) | draw(inertias())


@settings(max_examples=15, deadline=None)
@given(
    chain=st.lists(links | given_bodies(), min_size=1, max_size=4), own=inertias(1e-2),
    sides=st.sampled_from([1, 2]),
    branch=st.booleans(), swings=st.booleans(), hand_mass=st.sampled_from([0.0, 0.3]),
    pitch=st.none() | st.floats(-180.0, 180.0), com=millimetres(-100, 100),
)  # fmt: skip
def test_any_tree_of_links_agrees(
    chain: list[dict[str, Any]], own: dict[str, float], sides: int, branch: bool, swings: bool,
    hand_mass: float, pitch: float | None, com: float,
) -> None:  # fmt: skip
    """Branches, slides, turned frames, mirrored arms, a passive link, hands, a turned probe."""
    tree = load_robot("hexarotor")[0].model_dump()
    tree["platform"] |= own | {"com_x_m": com, "com_y_m": -0.5 * com, "com_z_m": 2.0 * com}
    named = {f"link{i}": link for i, link in enumerate(chain)}
    if branch and len(chain) > 2:
        named["link2"]["parent"] = "link0"
    for link in chain:
        if link["joint"] == "slide":
            link |= {"joint_min_m": -0.5, "joint_max_m": 0.5}
    moving = sum(link["joint"] != "fixed" for link in chain)
    servo = {"stall_torque_nm": 1.0, "no_load_speed_rad_s": 5.0}
    tree["arm"] = {
        "sides": sides, "links": named, "servos": {f"servo{i}": servo for i in range(moving)},
        "hand": {"mass_kg": hand_mass, "length_m": 0.07, "kind": "hook"},
        "mount_x_m": 0.0 if swings else 0.1,
    }  # fmt: skip
    if swings:
        tree["pendulum"] = {"length_m": 0.6, "mass_kg": 0.4, "z_m": -0.1}
    if pitch is not None:
        tree["probe"] = {"mass_kg": 0.2, "length_m": 0.15, "pitch_deg": pitch}
    hold_equal(Robot.model_validate(tree), seed=5, states=2)


# --- the plant: servo shafts, springs, the link's bending ------------------------------------


def split(root: ET.Element, name: str, first: str, second: str, axis: str | None = None) -> None:
    """Put a second hinge after the joint `name` of a URDF: two joints, a massless link between."""
    joint = next(j for j in root.iter("joint") if j.get("name") == name)
    between, child = f"{name} shaft", joint.find("child")
    assert child is not None
    ET.SubElement(root, "link", name=between)
    extra = ET.SubElement(root, "joint", name=second, type="revolute")
    ET.SubElement(extra, "origin", xyz="0 0 0", rpy="0 0 0")
    ET.SubElement(extra, "parent", link=between)
    ET.SubElement(extra, "child", link=child.get("link", ""))
    ET.SubElement(extra, "limit", lower="-9", upper="9", effort="0", velocity="9")
    own = joint.find("axis")
    assert own is not None
    ET.SubElement(extra, "axis", xyz=axis or own.get("xyz", ""))
    child.set("link", between)
    joint.set("name", first)


def plant_urdf(robot: Robot, scene: Scene) -> tuple[str, list[str]]:
    """The URDF of the plant's joints, (text, joint names in the plant's order)."""
    root = ET.fromstring(build_urdf(robot))
    for limb in list_joints(robot):
        if limb.link.flex_stiffness_nm_per_rad is not None:
            split(root, limb.name, limb.name, f"{limb.name} flex")
        if limb.link.lateral_stiffness_nm_per_rad is not None:
            assert limb.link.axis == "y"
            split(root, limb.name, limb.name, f"{limb.name} lateral", "1 0 0")
    for joint in root.iter("joint"):
        if joint.get("name") == "slider":
            joint.set("name", "spring")
            joint.set("type", "prismatic")
            ET.SubElement(joint, "axis", xyz="1 0 0")
            ET.SubElement(joint, "limit", lower="-1", upper="1", effort="0", velocity="1")
    names = [scene.model.joint(i).name for i in range(1, scene.model.njnt)]
    return ET.tostring(root, encoding="unicode"), names


@pytest.mark.parametrize("name", ["bimanual", "bimanual-longreach", "othex"])
def test_full_plant_agrees(name: str) -> None:
    """Shafts, deflections, bending and the probe's spring as coordinates; rotors' inertia."""
    robot = load_robot(name)[0]
    scene = build_scene(robot, WORLD, Deviation())
    text, names = plant_urdf(robot, scene)
    p, rng = read(text, names), np.random.default_rng(7)
    driven = [6 + names.index(limb.name) for limb in list_joints(robot) if limb.servo >= 0]
    motors = np.eye(len(driven))  # rates of the motors in the joints'
    if robot.arm is not None and robot.arm.belt is not None:
        motors = np.linalg.inv(robot.arm.belt)
    inertia = [servo.armature_kgm2 for _, servo in list_servos(robot)]
    armature = np.zeros((6 + len(names), 6 + len(names)))
    armature[np.ix_(driven, driven)] = motors.T @ np.diag(inertia) @ motors
    data = mujoco.MjData(scene.model)
    for _ in range(20):
        s = random_state(rng, len(names))
        data.qpos[:3], data.qpos[3:7], data.qpos[7:], data.qvel[:] = s.p, s.quat, s.q, s.v
        full, bias = compute_mujoco(scene.model, data)
        np.testing.assert_allclose(full, p.mass_matrix(s) + armature, atol=1e-8)
        np.testing.assert_allclose(bias, p.bias(s), atol=1e-8, rtol=1e-9)


def test_plant_in_the_paper_s_coordinates() -> None:
    """Suarez 2020 (8), (13): shafts theta and output links q are coupled by the springs only.

    The scene has theta and q - theta as joints. The mass matrix in xi is that of the rigid robot
    beside the shafts' own inertia; the springs pull with k (theta - q), beyond 10 deg and with the
    gear's play as `spring_torque` says.
    """
    robot = load_robot("bimanual")[0]
    rigid, plant = build_scene(robot, WORLD), build_scene(robot, WORLD, Deviation())
    n, m = rigid.n_joints, plant.model
    theta = plant.places.joint_dof
    flex = theta + 1
    S_q = np.zeros((6 + n, m.nv))  # rates of the rigid robot
    S_q[:6, :6] = np.eye(6)
    S_q[6 + np.arange(n), theta] = S_q[6 + np.arange(n), flex] = 1.0
    servos = [servo for _, servo in list_servos(robot)]
    shafts = np.zeros(m.nv)
    shafts[theta] = [servo.armature_kgm2 for servo in servos]
    a, b, rng = mujoco.MjData(rigid.model), mujoco.MjData(m), np.random.default_rng(2)
    for _ in range(20):
        s = random_state(rng, m.nv - 6)
        b.qpos[:3], b.qpos[3:7], b.qpos[7:], b.qvel[:] = s.p, s.quat, s.q, s.v
        b.qpos[1 + flex] = rng.uniform(-0.4, 0.4, n)
        b.qvel[flex] = 0.0
        full, bias = compute_mujoco(m, b)
        set_pose(rigid, a, s.p, s.quat, b.qpos[1 + theta] + b.qpos[1 + flex])
        a.qvel[:] = S_q @ b.qvel
        full_rigid, bias_rigid = compute_mujoco(rigid.model, a)
        np.testing.assert_allclose(full, S_q.T @ full_rigid @ S_q + np.diag(shafts), atol=1e-8)
        np.testing.assert_allclose(bias, S_q.T @ bias_rigid, atol=1e-8)
        for j, limb in enumerate(list_joints(robot)):
            link, play = limb.link, np.radians(servos[j].backlash_deg)
            deflection = -float(b.qpos[1 + flex[j]])
            stretched = np.copysign(max(abs(deflection) - play / 2, 0.0), deflection)
            k, linear = link.flex_stiffness_nm_per_rad, np.radians(link.flex_linear_deg)
            torque = spring_torque(k, linear, link.flex_hardening, stretched)
            assert b.qfrc_passive[flex[j]] == pytest.approx(torque, abs=1e-9)
            assert b.qfrc_passive[theta[j]] == pytest.approx(0.0, abs=1e-12)


# --- standard and long reach -----------------------------------------------------------------


def shrunk(mass: float, length: float) -> Robot:
    """The long-reach robot with a passive link of almost no length and mass."""
    return load_robot(
        "bimanual-longreach",
        [
            ("robot.pendulum.length_m", length),
            ("robot.pendulum.com_m", 0.0),
            ("robot.pendulum.mass_kg", mass),
        ],
    )[0]


def arms_only(robot: Robot, seed: int) -> list[Any]:
    """Mass matrix, bias and tips at random states, the passive joint locked straight down."""
    scene, names = build_scene(robot, WORLD), joint_names(robot)
    swing = robot.pendulum is not None
    own = build_body_model(robot, WORLD.gravity_mps2)
    p, rng, out = read(build_urdf(robot), names), np.random.default_rng(seed), []
    keep = np.delete(np.arange(6 + len(names)), 6) if swing else np.arange(6 + len(names))
    for _ in range(10):
        s = random_state(rng, 8)
        if swing:
            s = s._replace(q=np.insert(s.q, 0, 0.0), v=np.insert(s.v, 6, 0.0))
        data = mujoco.MjData(scene.model)
        set_pose(scene, data, s.p, s.quat, s.q)
        data.qvel[:] = s.v
        full, bias = compute_mujoco(scene.model, data)
        for M, h in ((full, bias), (p.mass_matrix(s), p.bias(s))):
            out += [M[np.ix_(keep, keep)], h[keep]]
        out += [data.site("hand0").xpos.copy(), data.site("hand1").xpos.copy()]
        out += [np.hstack([np.ravel(x) for x in compute_body(own, s.q)])]
    return out


def test_long_reach_without_its_link_is_the_standard_robot() -> None:
    """Suarez 2020: (13) with L0 = m0 = 0 and q0 locked is the standard configuration.

    A link has a mass and a length, so this is a limit: the difference goes to zero with both. With
    the joint merely locked the link's mass remains and the arms hang 0.8 m lower: that is another
    robot, and the paper's "drop q0, tau0, m0, I0" is more than locking q0.
    """
    standard = arms_only(load_robot("bimanual")[0], 4)

    def differ(robot: Robot) -> float:
        return max(
            float(np.abs(a - b).max()) for a, b in zip(standard, arms_only(robot, 4), strict=True)
        )

    sizes = [1e-2, 1e-4, 1e-6]
    found = [differ(shrunk(size, size)) for size in sizes]
    assert found[-1] < 1e-4
    assert found[1] / found[2] == pytest.approx(sizes[1] / sizes[2], rel=1e-3)  # and on to zero
    locked = load_robot("bimanual-longreach")[0]
    assert differ(locked) > 1.0
    assert differ(shrunk(1e-6, 0.8)) > 1.0  # a link without mass is not enough
    assert differ(shrunk(0.52, 1e-6)) > 0.5  # nor one without length


# --- the file itself --------------------------------------------------------------------------


def points_of(placement_R, placement_p, half: float) -> list[Any]:
    return [placement_p + s * half * placement_R[:, 2] for s in (-1.0, 1.0)]


@pytest.mark.parametrize("name", ["bimanual-longreach", "othex"])
def test_shapes_are_where_the_scene_has_them(name: str) -> None:
    """Every capsule's ends and every cylinder's and sphere's centre, with its radius, in W."""
    robot = load_robot(name)[0]
    scene, text, names = build_scene(robot, WORLD), build_urdf(robot), joint_names(robot)
    p = read(text, names)
    geometry = pin.buildGeomFromUrdfString(p.model, text, pin.GeometryType.COLLISION)
    s = random_state(np.random.default_rng(1), len(names))
    data = mujoco.MjData(scene.model)
    set_pose(scene, data, s.p, s.quat, s.q)
    mujoco.mj_forward(scene.model, data)
    placed = geometry.createData()
    pin.updateGeometryPlacements(p.model, p.data, geometry, placed, p.q(s))
    theirs = []
    for item, at in zip(geometry.geometryObjects, placed.oMg, strict=True):
        half = getattr(item.geometry, "halfLength", 0.0)
        theirs.append([*at.translation, item.geometry.radius, half])
    ours = []
    for g in scene.places.robot_geoms:
        kind, (radius, half, _) = scene.model.geom_type[g], scene.model.geom_size[g]
        at, turn = data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3)
        sphere = kind == mujoco.mjtGeom.mjGEOM_SPHERE
        ours.append([*at, radius, 0.0 if sphere else half])
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            ours += [[*end, radius, 0.0] for end in points_of(turn, at, half)]
    assert len(ours) == len(theirs)
    distance = np.abs(np.array(ours)[:, None] - np.array(theirs)[None]).max(axis=2)
    assert distance.min(axis=1).max() < 1e-9 and distance.min(axis=0).max() < 1e-9


def test_limits_effort_and_speed_are_those_of_the_servos() -> None:
    p = read(build_urdf(load_robot("bimanual-longreach")[0]), joint_names(
        load_robot("bimanual-longreach")[0]
    ))  # fmt: skip
    at = dict(zip(joint_names(load_robot("bimanual-longreach")[0]), p.order, strict=True))
    for side, lower, upper in (("left", -10.0, 90.0), ("right", -90.0, 10.0)):
        i = at[f"{side}_shoulder_roll"]
        assert p.model.lowerPositionLimit[i + 1] == pytest.approx(np.radians(lower))
        assert p.model.upperPositionLimit[i + 1] == pytest.approx(np.radians(upper))
        assert p.model.effortLimit[at[f"{side}_shoulder_yaw"]] == pytest.approx(1.17)
        assert p.model.velocityLimit[i] == pytest.approx(7.1)
    assert p.model.effortLimit[at["pendulum"]] == 0.0


def test_through_a_belt_servos_work_together() -> None:
    """othex: q_A1 = m_1, q_A2 = m_2 - m_1, so both servos load joint 1 and turn joint 2."""
    robot = load_robot("othex")[0]
    p = read(build_urdf(robot), joint_names(robot))
    stall = [servo.stall_torque_nm for _, servo in list_servos(robot)]
    speed = [servo.no_load_speed_rad_s for _, servo in list_servos(robot)]
    np.testing.assert_allclose(p.model.effortLimit[p.order], [sum(stall), stall[1]])
    np.testing.assert_allclose(p.model.velocityLimit[p.order], [speed[0], sum(speed)])


def show(*args: str, folder, monkeypatch):
    monkeypatch.chdir(folder)
    return CliRunner().invoke(cli.main, ["show", *args])


def test_command_writes_the_file_and_no_picture(tmp_path, monkeypatch) -> None:
    args = ("pipe-weld-scan", "--urdf", "new/othex.urdf", "--json")
    done = show(*args, folder=tmp_path, monkeypatch=monkeypatch)
    assert done.exit_code == 0
    assert json.loads(done.stdout)["urdf"] == "new/othex.urdf"
    text = (tmp_path / "new" / "othex.urdf").read_text(encoding="utf-8")
    assert text == build_urdf(load_robot("othex")[0])
    assert [f.name for f in tmp_path.rglob("*.*")] == ["othex.urdf"]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("open", "--urdf", "a.urdf"), "'open' is a world"),
        (("bimanual", "--urdf", "a.txt"), "valid: .urdf, .xml"),
        (("bimanual", "--urdf", "/proc/none/a.urdf"), "cannot be written"),
        (("bimanual", "--urdf", "."), "valid: .urdf, .xml"),
        (("bimanuel", "--urdf", "a.urdf"), "bimanual"),
    ],
)
def test_command_refuses(args: tuple[str, ...], words: str, tmp_path, monkeypatch) -> None:
    done = show(*args, folder=tmp_path, monkeypatch=monkeypatch)
    assert done.exit_code == 2 and words in done.stderr and done.stdout == ""
    assert done.stderr.startswith("skywright: ") and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["world", "platform", "tip", "rotor0", "slider", "free"])
def test_a_link_cannot_have_the_name_of_another_part(name: str, tmp_path) -> None:
    file = tmp_path / "robot.toml"
    link = f"[robot.arm.{name}]\njoint = 'fixed'\nlength_m = 0.1\nmass_kg = 0.1\n"
    file.write_text(f"[robot]\nname = 'mine'\nextends = 'hexarotor'\n{link}")
    with pytest.raises(InputError, match=f"a link cannot be named '{name}'"):
        load_robot(file)
