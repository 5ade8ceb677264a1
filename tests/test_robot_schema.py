"""What a robot file may say: full inertias, turned frames, arms that differ, slides, any rotor.

`tests/test_urdf.py` holds the dynamics of such robots against Pinocchio's; here the built-in robots
keep their models, and files mean what they say.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from compiled_robots import ROBOTS, STORED, collect
from skywright.description.robot.limbs import list_joints, list_limbs, list_servos
from skywright.description.robot.loader import list_robots, load_robot
from skywright.description.robot.spec import Robot
from skywright.description.world.loader import load_world
from skywright.models.arm_body import Deviation
from skywright.models.rigid_body import build_body_model, compute_kinematics, posture
from skywright.models.rotors import build_rotors
from skywright.models.scene import build_scene, set_pose

SERVO = {"stall_torque_nm": 2.0, "no_load_speed_rad_s": 5.0}
OPEN = load_world("open")[0]


def build(arm: dict[str, Any] | None = None, **tables: Any) -> Robot:
    """The hexarotor with these tables over its own."""
    tree = load_robot("hexarotor")[0].model_dump()
    for name, table in tables.items():
        tree[name] = tree[name] | table
    return Robot.model_validate(tree if arm is None else tree | {"arm": arm})


@pytest.mark.parametrize("name", ROBOTS)
def test_built_in_robots_compile_as_before(name: str) -> None:
    stored, now = np.load(STORED), collect(name)
    keys = {key for key in stored.files if key.startswith(f"{name}/")}
    assert keys == set(now)
    for key in keys:
        np.testing.assert_allclose(now[key], stored[key], rtol=0.0, atol=1e-12, err_msg=key)


def test_every_stored_robot_is_a_built_in_one() -> None:
    assert set(ROBOTS) <= {entry.name for entry in list_robots()}


def test_each_rotor_has_its_own_radius_and_height() -> None:
    n = 6
    radii, heights = [0.3 + 0.02 * i for i in range(n)], [0.01 * i for i in range(n)]
    robot = build(rotors={"radius_m": radii, "height_m": heights, "alpha_deg": [180.0] + [0.0] * 5})
    rotors = build_rotors(robot.rotors)
    np.testing.assert_allclose(np.hypot(*rotors.position[:, :2].T), radii, atol=1e-12)
    np.testing.assert_allclose(rotors.position[:, 2], heights, atol=1e-15)
    np.testing.assert_allclose(rotors.axis[0], [0.0, 0.0, -1.0], atol=1e-12)
    # the torque of a propeller is about its own axis, against its spin, whichever way it points
    drag = rotors.B[3:] - np.cross(rotors.position, rotors.axis).T
    want = -rotors.spin * robot.rotors.torque_per_thrust_m * rotors.axis.T
    np.testing.assert_allclose(drag, want, atol=1e-12)
    plant = build_scene(robot, OPEN, Deviation()).model
    gear = plant.actuator_gear[[plant.actuator(f"thrust{i}").id for i in range(n)]]
    np.testing.assert_allclose(gear, np.hstack([rotors.axis, want.T]), atol=1e-12)


def test_arms_that_differ_stand_as_they_are_written() -> None:
    """A left arm of two hinges, a right arm of one slide; nothing of either is mirrored."""
    links = {
        "upper": {
            "side": "left", "length_m": 0.3, "mass_kg": 0.2, "axis": "x", "joint_max_deg": 90.0,
        },
        "fore": {"side": "left", "length_m": 0.2, "mass_kg": 0.1},
        "rail": {
            "side": "right", "joint": "slide", "axis": "x", "length_m": 0.25, "mass_kg": 0.3,
            "y_m": -0.1, "yaw_deg": 30.0, "joint_min_m": 0.0, "joint_max_m": 0.2, "working_m": 0.15,
        },
    }  # fmt: skip
    servos = {
        "m1": SERVO | {"side": "left"}, "m2": SERVO | {"side": "left"},
        "m3": SERVO | {"side": "right"},
    }  # fmt: skip
    robot = build({"sides": 2, "separation_m": 0.4, "links": links, "servos": servos})
    limbs = list_limbs(robot)
    assert [limb.name for limb in limbs] == ["left_upper", "left_fore", "right_rail"]
    assert limbs[0].offset == (0.0, 0.2, 0.0)
    assert limbs[2].offset == (0.0, -0.1, 0.0)
    assert [name for name, _ in list_servos(robot)] == ["left_m1", "left_m2", "right_m3"]
    assert [limb.servo for limb in list_joints(robot)] == [0, 1, 2]
    np.testing.assert_allclose(posture(robot, "working"), [0.0, 0.0, 0.15])
    model = build_body_model(robot)
    hand = compute_kinematics(model, np.array([0.0, 0.0, 0.15]))["p_BH"]
    np.testing.assert_allclose(hand[0], [0.5, 0.2, 0.0], atol=1e-12)
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0])
    np.testing.assert_allclose(hand[1], [0.0, -0.1, 0.0] + 0.4 * along, atol=1e-12)
    scene = build_scene(robot, OPEN)
    data = mujoco.MjData(scene.model)
    set_pose(scene, data, np.zeros(3), np.array([1.0, 0, 0, 0]), np.array([0.0, 0.0, 0.15]))
    mujoco.mj_kinematics(scene.model, data)
    np.testing.assert_allclose(data.site("hand1").xpos, hand[1], atol=1e-12)
    plant = build_scene(robot, OPEN, Deviation()).model
    low, high = plant.joint("right_rail").range
    assert low < 0.0 < 0.2 < high < 0.21
    # a slide's servo is tuned to the mass that it moves, not to an inertia
    gain = plant.actuator("right_m3").gainprm[0]
    assert gain == pytest.approx((0.3 + 0.005) / 0.03**2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"inertia_xx_kgm2": 1e-3}, "inertia_xx_kgm2, inertia_yy_kgm2, inertia_zz_kgm2 together"),
        ({"inertia_xy_kgm2": 1e-3}, "together"),
        (
            {"inertia_xx_kgm2": 1e-3, "inertia_yy_kgm2": 1e-3, "inertia_zz_kgm2": 1e-3,
             "inertia_xy_kgm2": 2e-3},
            "principal moments",
        ),
        ({"com_m": 0.1, "com_x_m": 0.1}, "not both"),
        ({"joint_min_m": 0.0, "joint_max_m": 0.1}, "of a slide"),
        ({"joint": "slide"}, "joint = 'slide' needs joint_min_m and joint_max_m"),
        ({"joint": "slide", "joint_min_m": 0.0}, "both joint_min_m and joint_max_m"),
        (
            {"joint": "slide", "joint_min_m": 0.0, "joint_max_m": 0.1, "folded_deg": 20.0},
            "folded_deg = 20 has no effect on a slide: use folded_m",
        ),
        ({"joint": "slide", "joint_min_m": 0.1, "joint_max_m": 0.0}, "must exceed"),
        ({"joint": "slide", "joint_min_m": 0.1, "joint_max_m": 0.2}, "folded_m lies outside"),
        ({"side": "left"}, "sides = 2"),
        ({"roll_deg": float("nan")}, "finite"),
    ],
)  # fmt: skip
def test_wrong_links_are_refused(change: dict[str, Any], says: str) -> None:
    link = {"length_m": 0.3, "mass_kg": 0.2} | change
    with pytest.raises(ValidationError, match=says):
        build({"links": {"one": link}, "servos": {"m": SERVO}})


@pytest.mark.parametrize("joint", ["fixed", "slide"])
def test_a_pendulum_is_a_hinge(joint: str) -> None:
    tree = load_robot("ars-lrm")[0].model_dump()
    limits = {"joint_min_m": 0.0, "joint_max_m": 0.1} if joint == "slide" else {}
    tree["pendulum"] = {"joint": joint, "length_m": 0.8, "mass_kg": 0.5} | limits
    with pytest.raises(ValidationError, match=f"joint is '{joint}'; valid: 'hinge'"):
        Robot.model_validate(tree)


def test_wrong_platforms_and_rotors_are_refused() -> None:
    with pytest.raises(ValidationError, match="radius_m has 2 entries"):
        build(rotors={"radius_m": [0.3, 0.3]})
    with pytest.raises(ValidationError, match="at least one rotor"):
        build(rotors={"radius_m": [0.0] * 6})
    with pytest.raises(ValidationError, match="principal moments"):
        build(platform={"inertia_xy_kgm2": 0.5})
    with pytest.raises(ValidationError, match="no link is on the right arm"):
        link = {"length_m": 0.3, "mass_kg": 0.2, "side": "left"}
        build({"sides": 2, "links": {"one": link}, "servos": {"m": SERVO | {"side": "left"}}})
