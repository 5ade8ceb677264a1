"""A gripper: fingers that one motor closes, and what they hold by friction."""

from __future__ import annotations

import math
import re
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import imported_models as models
import skywright
from skywright.core.arrays import Array
from skywright.description.robot.arm import Hand
from skywright.description.robot.loader import load_robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.docking_body import NOSLIP_ITERATIONS
from skywright.models.drawing import build_drawing, compute_part_poses, rotate_vectors
from skywright.models.gripper_body import add_fingers, add_grip_motor
from skywright.models.importing.chain import combine
from skywright.models.importing.importer import Request, import_robot
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip
from skywright.models.scene import build_scene
from skywright.models.urdf import build_urdf
from skywright.vehicle.actuators._gripper import GripperState
from skywright.vehicle.commanded_arms import CommandedArms
from skywright.vehicle.commands import State
from skywright.vehicle.motions import Arrival
from skywright.vehicle.simulated import Saved, SimulatedVehicle
from skywright.vehicle.uav import Uav

NEAR = Arrival(tolerance_m=0.015, dwell_s=0.3, yaw_rad=0.1)

ROBOT = """
[robot]
name = "gripping"
extends = "hexarotor"

[robot.control]
position_integral_rad_s = 1.0

[robot.arm.boom]
joint = "fixed"
along = "-z"
length_m = 0.1
mass_kg = 0.05

[robot.arm.hand]
kind = "gripper"
length_m = 0.06
mass_kg = 0.04
radius_m = 0.008
stroke_m = 0.08
grip_speed_mps = 0.1
grip_force_n = 15.0
"""
TURNING = ROBOT.replace(
    "stroke_m = 0.08", 'finger = "turn"\npivot_m = 0.03\nopen_deg = 20.0\nclosed_deg = -30.0'
)
WORLD = """
[world]
name = "stand"

[world.mocap]

[world.things.stand]
kind = "box"
x_m = 0.0
y_m = 0.0
z_m = 0.35
size_x_m = 0.2
size_y_m = 0.2
size_z_m = 0.7

[world.things.block]
kind = "box"
moves = true
mass_kg = 0.12
x_m = 0.0
y_m = 0.0
z_m = 0.75
size_x_m = 0.03
size_y_m = 0.04
size_z_m = 0.1
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("gripping")
    out = {}
    for name, text in {"slide": ROBOT, "turn": TURNING, "world": WORLD}.items():
        out[name] = folder / f"{name}.toml"
        out[name].write_text(text)
    return out


@pytest.fixture(scope="module")
def flown(files: dict[str, Path], request: pytest.FixtureRequest) -> tuple[SimulatedVehicle, Saved]:
    """A vehicle with its fingers around the block, and its saved state; they slide or turn."""
    sets = {"mission.start_x_m": -0.8, "mission.timestep_ms": 2, "mission.estimator": "truth"}
    vehicle = skywright.build_vehicle(
        skywright.load(
            "waypoints",
            robot=files[getattr(request, "param", "slide")],
            world=files["world"],
            sets=sets,
        )
    )
    uav = Uav(vehicle, arrival=NEAR, waits=True)
    while uav.state == State.UNINITIALIZED:
        uav.tick()
    for way in (uav.take_off(1.2), uav.go_to((0.0, 0.0, 1.2)), uav.go_to((0.0, 0.0, 0.935))):
        assert way.result, way.result
    return vehicle, vehicle.save()


@pytest.fixture
def above(flown: tuple[SimulatedVehicle, Saved]) -> tuple[Uav, CommandedArms, SimulatedVehicle]:
    """The vehicle there again."""
    vehicle, saved = flown
    vehicle.restore(saved)
    uav = Uav(vehicle, arrival=NEAR, waits=True)
    return uav, CommandedArms(uav), vehicle


def find_block(vehicle: SimulatedVehicle) -> Array:
    """Place (3,) m of the block in W."""
    return np.array(vehicle.sim.data.body("object block").xpos)


def test_fingers_that_close_slowly_do_not_stand(
    above: tuple[Uav, CommandedArms, SimulatedVehicle],
) -> None:
    """0.1 N close the opening by 0.7 mm/s: the way to the block takes a minute."""
    uav, arms, vehicle = above
    before = float(vehicle.look(GripperState).opening[0])
    handle = arms.grasp(0.1, wait=False)
    for _ in range(50):
        uav.tick()
    assert handle.result is None
    closed = before - float(vehicle.look(GripperState).opening[0])
    assert closed == pytest.approx(0.1 * 0.1 / 15.0, rel=0.3)


OPEN = {"slide": 0.08, "turn": 2.0 * (0.03 + 0.06 * math.sin(math.radians(20.0)) - 0.008)}


@pytest.mark.parametrize(("flown", "width"), OPEN.items(), indirect=["flown"], ids=list(OPEN))
def test_a_gripper_lifts_what_it_closes_on_and_puts_it_down(
    above: tuple[Uav, CommandedArms, SimulatedVehicle], width: float
) -> None:
    uav, arms, vehicle = above
    state = vehicle.look(GripperState)
    assert state.opening[0] == pytest.approx(width, abs=1e-3)
    start = find_block(vehicle)
    assert start[2] == pytest.approx(0.75, abs=1e-3)
    assert arms.grasp(12.0).result
    assert state.opening[0] == pytest.approx(0.04, abs=5e-4)  # the block's width
    assert uav.go_to((0.0, 0.3, 1.1)).result
    np.testing.assert_allclose(find_block(vehicle) - start, [0.0, 0.3, 0.165], atol=0.03)

    def find_in_hand() -> float:
        """Height (m) of the block in the hand."""
        hand = vehicle.sim.data.site("tip")
        return float((hand.xmat.reshape(3, 3).T @ (find_block(vehicle) - hand.xpos))[2])

    held = find_in_hand()
    uav.wait(5.0)
    assert find_in_hand() == pytest.approx(held, abs=2e-4), "friction holds without creep"
    assert uav.go_to((0.0, 0.0, 1.0)).result
    assert uav.go_to((0.0, 0.0, 0.936)).result
    assert arms.release().result
    assert state.opening[0] == pytest.approx(width, abs=1e-3)
    assert uav.go_to((0.0, 0.0, 1.2)).result
    np.testing.assert_allclose(find_block(vehicle), start, atol=0.04)
    ended = arms.grasp(12.0).result
    assert ended is not None
    assert (ended.ok, ended.reason) == (False, "the left gripper closed on nothing")
    assert state.opening[0] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("finger", ["slide", "turn"])
def test_an_imported_gripper_lifts_a_block(tmp_path: Path, finger: str) -> None:
    """The capsule of the link that carries the fingers leaves them room."""
    turns = finger == "turn"
    arm = models.turning_gripper(tmp_path, "urdf") if turns else models.sdf_gripper(tmp_path)
    request = Request(models.write_quad(tmp_path), arm=arm, mount="0,0,-0.05,0,90,0", assume=True)
    robot, world = import_robot(request, tmp_path / "made").path, tmp_path / "world.toml"
    # the landing gear passes beside the stand
    world.write_text(re.sub("size_([xy])_m = 0.2", r"size_\1_m = 0.06", WORLD))
    sets = {
        "mission.timestep_ms": 2, "mission.estimator": "truth",
        "robot.control.position_integral_rad_s": 0.6, "mission.start_x_m": -0.8,
        "world.things.block.mass_kg": 0.05,
    }  # fmt: skip
    vehicle = skywright.build_vehicle(
        skywright.load("waypoints", robot=robot, world=world, sets=sets)
    )
    uav = Uav(vehicle, arrival=NEAR, waits=True)
    arms = CommandedArms(uav)
    while uav.state == State.UNINITIALIZED:
        uav.tick()
    z = 0.78 - compute_tip(build_body_model(load_robot(robot)[0]), np.zeros(1))[0][2]
    for way in (uav.take_off(1.4), uav.go_to((0.0, 0.0, 1.4)), uav.go_to((0.0, 0.0, z))):
        assert way.result, way.result
    assert arms.grasp(6.0).result
    assert vehicle.look(GripperState).opening[0] == pytest.approx(0.04, abs=1e-3)
    assert uav.go_to((0.0, 0.0, z + 0.2)).result
    assert find_block(vehicle)[2] == pytest.approx(0.75 + 0.2, abs=0.03)


def test_a_grasp_that_is_too_weak_leaves_the_block(
    above: tuple[Uav, CommandedArms, SimulatedVehicle],
) -> None:
    """Two pads of friction 0.5 hold at most their force: 0.9 N for a block of 1.18 N."""
    uav, arms, vehicle = above
    assert arms.grasp(0.9).result
    assert uav.go_to((0.0, 0.0, 1.1)).result
    assert find_block(vehicle)[2] < 0.76
    ended = arms.grasp(12.0).result
    assert ended is not None
    assert (ended.ok, ended.reason) == (False, "the left gripper closed on nothing")


def test_wrong_orders_are_refused(above: tuple[Uav, CommandedArms, SimulatedVehicle]) -> None:
    _, arms, _ = above
    with pytest.raises(InputError, match="gripper 'right' is unknown; valid: left"):
        arms.grasp(5.0, hand="right")
    with pytest.raises(InputError, match="of hands without fingers"):
        arms.grasp(5.0, [0, 0, 1], [0, 0.1, 1])
    with pytest.raises(InputError, match="grip of left = nan"):
        arms.plain.grip({"left": math.nan})
    with pytest.raises(InputError, match="force = -1"):
        arms.grasp(-1.0)
    ended = arms.grasp(16.0).result
    assert ended is not None and ended.reason == "grip = [16.0] N; valid: -15 to 15"


@pytest.mark.parametrize("finger", ["slide", "turn"])
def test_the_model_for_control_has_the_fingers_mass(files: dict[str, Path], finger: str) -> None:
    """Rigid body against the compiled scene, fingers open: mass, centre and inertia."""
    robot = load_robot(files[finger])[0]
    scene = build_scene(robot, World(name="nowhere"))
    data = mujoco.MjData(scene.model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_comPos(scene.model, data)
    mass, com, inertia = combine(scene.model, data, list(range(1, scene.model.nbody)))
    own_mass, own_com, own_inertia = compute_body(build_body_model(robot), np.zeros(0))
    assert own_mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(own_com, com, atol=1e-12)
    about = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    np.testing.assert_allclose(own_inertia, about, atol=1e-12)


def test_a_turning_finger_is_drawn_where_its_pad_is(files: dict[str, Path]) -> None:
    """Half the opening and the pad's radius from the middle, and its length from the pivot."""
    robot = load_robot(files["turn"])[0]
    drawing = build_drawing(robot, World(name="nowhere"))
    opening = np.array([[0.0], [0.04], [robot.arm.hand.opening_max_m]])
    poses = compute_part_poses(drawing, np.zeros((3, 3)), np.tile(np.eye(4)[0], (3, 1)),
                               np.zeros((3, 0)), np.zeros(3), opening=opening)  # fmt: skip
    fingers = [k for k, part in enumerate(drawing.parts) if part.motion == "turning finger"]
    assert len(fingers) == 2
    for k, sign in zip(fingers, (1.0, -1.0), strict=True):
        (p, q), pad = poses[k], drawing.parts[k].shapes[0]
        way = rotate_vectors(q, np.tile(pad.position, (3, 1)))
        np.testing.assert_allclose(np.linalg.norm(way, axis=1), 0.06, atol=1e-12)
        np.testing.assert_allclose((p + way)[:, 1], sign * (0.5 * opening[:, 0] + 0.008), atol=1e-9)
        np.testing.assert_allclose(q[2], drawing.parts[k].quaternion, atol=1e-9)


@pytest.mark.parametrize("finger", ["slide", "turn"])
def test_a_robot_in_urdf_has_its_fingers(files: dict[str, Path], finger: str) -> None:
    """Pinocchio reads the exported file: mass and centre of mass."""
    robot = load_robot(files[finger])[0]
    other = pin.buildModelFromXML(build_urdf(robot), pin.JointModelFreeFlyer())
    mass, com, _ = compute_body(build_body_model(robot), np.zeros(0))
    assert pin.computeTotalMass(other) == pytest.approx(mass)
    at = pin.centerOfMass(other, other.createData(), pin.neutral(other))
    np.testing.assert_allclose(at, com, atol=1e-9)


def test_a_back_end_without_physics_refuses_to_grasp(files: dict[str, Path]) -> None:
    vehicle = skywright.fly(files["slide"], backend="kinematic", arrival=NEAR)
    assert vehicle.take_off(1.0).result
    for handle in (vehicle.arms.grasp(5.0), vehicle.arms.release()):
        assert handle.result is not None
        assert handle.result.reason.endswith("refused: the back end does not move the gripper")


def test_a_gripper_without_fingers_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(ROBOT.replace("mass_kg = 0.04\n", ""))
    with pytest.raises(InputError, match="length_m and mass_kg must be above 0"):
        load_robot(file)


@pytest.mark.parametrize(("change", "says"), [
    ("pivot_m = 0.003", "fingers of radius_m = 0.008 need more than 0.004"),
    ("open_deg = -30.0", "open_deg is -30, closed_deg -30: the pads do not part"),
    ("open_deg = -25.0", "the pads do not part"),
    ("open_deg = 90.0", "open_deg"),
])  # fmt: skip
def test_fingers_that_cannot_turn_are_refused(tmp_path: Path, change: str, says: str) -> None:
    key = change.split()[0]
    lines = [change if line.startswith(key) else line for line in TURNING.splitlines()]
    file = tmp_path / "robot.toml"
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match=says):
        load_robot(file)


SLIDING = Hand(kind="gripper", length_m=0.06, mass_kg=0.04, radius_m=0.008, stroke_m=0.05,
               grip_force_n=15.0, grip_speed_mps=0.2)  # fmt: skip
HANDS = {
    "slide": SLIDING,
    # pivots outside of the block, so that the fingers lean inward, and inside
    "inward": SLIDING.model_copy(update={"finger": "turn", "pivot_m": 0.05, "open_deg": -15.0}),
    "outward": SLIDING.model_copy(update={"finger": "turn", "pivot_m": 0.015, "open_deg": 20.0}),
}


@pytest.mark.parametrize("step", [0.001, 0.002])
@pytest.mark.parametrize(("friction", "force"), [(0.3, 2.0), (0.5, 12.0), (0.8, 6.0)])
@pytest.mark.parametrize("kind", HANDS)
def test_two_pads_hold_twice_the_friction(
    kind: str, friction: float, force: float, step: float
) -> None:
    """Coulomb's limit 2 mu N: 95 % of it is held without creep, 105 % falls.

    Fingers that slide press with N = F. The friction of a pad at the height L cos(a) and the way y
    outside of its pivot turns the finger, too: N = F / (1 - mu y / (L cos(a))).
    """
    hand, motor, press = HANDS[kind], force, force
    if hand.finger == "turn":
        out = (HALF_WIDTH + hand.radius_m - hand.pivot_m) / hand.length_m  # sin(a)
        height = hand.length_m * math.cos(math.asin(out))
        motor *= height / hand.length_m
        press /= 1.0 - friction * (HALF_WIDTH - hand.pivot_m) / height
    most = 2.0 * friction * press
    moved = [_hang(hand, friction, motor, share * most, step) for share in (0.95, 1.05)]
    assert abs(moved[0]) < 2e-5
    assert moved[1] > 0.1


HALF_WIDTH = 0.02  # m, of the block


def _hang(hand: Hand, friction: float, motor: float, weight: float, step: float) -> float:
    """How far (m) a block of this weight (N) falls in 1 s."""
    touch = {
        "friction": [friction, 0.005, 0.0001], "condim": 4, "priority": 1, "mass": 0.0,
        "solref": [0.008, 0.5], "solimp": [0.9, 0.9, 0.001, 0.5, 2.0],
    }  # fmt: skip
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep, spec.option.noslip_iterations = step, NOSLIP_ITERATIONS
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    body = spec.worldbody.add_body(name="hand0", pos=[0, 0, 1], quat=[0, 1, 0, 0])  # z down
    add_fingers(body, hand, 0.1, True, touch)  # so light that their own weight does not count
    add_grip_motor(spec, "hand0", hand)
    block = spec.worldbody.add_body(name="block", pos=[0, 0, 0.97])
    block.add_freejoint()
    block.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.015, HALF_WIDTH, 0.04],
                   mass=weight / 9.81)  # fmt: skip
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0], model.opt.gravity[:] = motor, 0.0
    mujoco.mj_step(model, data, round(0.8 / step))
    model.opt.gravity[2] = -9.81
    start = data.body("block").xpos[2]
    mujoco.mj_step(model, data, round(1.0 / step))
    return float(start - data.body("block").xpos[2])
