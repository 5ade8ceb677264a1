"""A gripper: fingers that one motor closes, and what they hold by friction."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import skywright
from skywright.core.arrays import Array
from skywright.description.robot.arm import Hand
from skywright.description.robot.loader import load_robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.docking_body import NOSLIP_ITERATIONS
from skywright.models.gripper_body import add_fingers, add_grip_motor
from skywright.models.importing.chain import combine
from skywright.models.rigid_body import build_body_model, compute_body
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
    for name, text in {"robot": ROBOT, "world": WORLD}.items():
        out[name] = folder / f"{name}.toml"
        out[name].write_text(text)
    return out


@pytest.fixture(scope="module")
def flown(files: dict[str, Path]) -> tuple[SimulatedVehicle, Saved]:
    """A vehicle with its fingers around the block, and its saved state."""
    sets = {"mission.start_x_m": -0.8, "mission.timestep_ms": 2, "mission.estimator": "truth"}
    vehicle = skywright.build_vehicle(
        skywright.load("waypoints", robot=files["robot"], world=files["world"], sets=sets)
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


def test_a_gripper_lifts_what_it_closes_on_and_puts_it_down(
    above: tuple[Uav, CommandedArms, SimulatedVehicle],
) -> None:
    uav, arms, vehicle = above
    state = vehicle.look(GripperState)
    assert state.opening[0] == pytest.approx(0.08, abs=1e-3)
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
    assert state.opening[0] == pytest.approx(0.08, abs=1e-3)
    assert uav.go_to((0.0, 0.0, 1.2)).result
    np.testing.assert_allclose(find_block(vehicle), start, atol=0.04)


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


def test_the_model_for_control_has_the_fingers_mass(files: dict[str, Path]) -> None:
    """Rigid body against the compiled scene, fingers open: mass, centre and inertia."""
    robot = load_robot(files["robot"])[0]
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


def test_a_robot_in_urdf_has_its_fingers(files: dict[str, Path]) -> None:
    """Pinocchio reads the exported file: mass and centre of mass."""
    robot = load_robot(files["robot"])[0]
    other = pin.buildModelFromXML(build_urdf(robot), pin.JointModelFreeFlyer())
    mass, com, _ = compute_body(build_body_model(robot), np.zeros(0))
    assert pin.computeTotalMass(other) == pytest.approx(mass)
    at = pin.centerOfMass(other, other.createData(), pin.neutral(other))
    np.testing.assert_allclose(at, com, atol=1e-9)


def test_a_back_end_without_physics_refuses_to_grasp(files: dict[str, Path]) -> None:
    vehicle = skywright.fly(files["robot"], backend="kinematic", arrival=NEAR)
    assert vehicle.take_off(1.0).result
    for handle in (vehicle.arms.grasp(5.0), vehicle.arms.release()):
        assert handle.result is not None
        assert handle.result.reason.endswith("refused: the back end does not move the gripper")


def test_a_gripper_without_fingers_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(ROBOT.replace("mass_kg = 0.04\n", ""))
    with pytest.raises(InputError, match="length_m and mass_kg must be above 0"):
        load_robot(file)


@pytest.mark.parametrize("step", [0.001, 0.002])
@pytest.mark.parametrize(("friction", "force"), [(0.3, 2.0), (0.5, 12.0), (0.8, 6.0)])
def test_two_pads_hold_twice_the_friction(friction: float, force: float, step: float) -> None:
    """Coulomb's limit 2 mu F: 95 % of it is held without creep, 105 % falls."""
    moved = [_hang(friction, force, share, step) for share in (0.95, 1.05)]
    assert abs(moved[0]) < 2e-5
    assert moved[1] > 0.1


def _hang(friction: float, force: float, share: float, step: float) -> float:
    """How far (m) a block falls in 1 s whose weight is a share of what the pads can hold."""
    hand = Hand(kind="gripper", length_m=0.06, mass_kg=0.04, radius_m=0.008, stroke_m=0.05,
                grip_force_n=15.0, grip_speed_mps=0.2)  # fmt: skip
    touch = {
        "friction": [friction, 0.005, 0.0001], "condim": 4, "priority": 1, "mass": 0.0,
        "solref": [0.008, 0.5], "solimp": [0.9, 0.9, 0.001, 0.5, 2.0],
    }  # fmt: skip
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.noslip_iterations = step, NOSLIP_ITERATIONS
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    body = spec.worldbody.add_body(name="hand0", pos=[0, 0, 1], quat=[0, 1, 0, 0])  # z down
    add_fingers(body, hand, 1.0, True, touch)
    add_grip_motor(spec, "hand0", hand)
    block = spec.worldbody.add_body(name="block", pos=[0, 0, 1.03])
    block.add_freejoint()
    block.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.015, 0.02, 0.05],
                   mass=share * 2.0 * friction * force / 9.81)  # fmt: skip
    model = spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0], model.opt.gravity[:] = force, 0.0
    mujoco.mj_step(model, data, round(0.8 / step))
    model.opt.gravity[2] = -9.81
    start = data.body("block").xpos[2]
    mujoco.mj_step(model, data, round(1.0 / step))
    return float(start - data.body("block").xpos[2])
