"""What the ends of arms are: probe or hand, fixed links after the joints, the bar between hands."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.description.world.loader import load_world
from skywright.errors import InputError
from skywright.missions.bridge_contact.metrics import _find_touches
from skywright.missions.skills.hook_grip import check_hooks, compute_hooks_apart
from skywright.models.arm_body import Deviation
from skywright.models.arm_inverse_kinematics import (
    build_arm_chain,
    compute_arm_fk,
    has_arm_chain,
)
from skywright.models.contact_stance import check_lever, find_free_stance
from skywright.models.planar import build_planar_lrm
from skywright.models.rigid_body import (
    build_body_model,
    compute_body,
    compute_hands_apart,
    compute_kinematics,
    compute_tip,
    joint_names,
    posture,
)
from skywright.models.scene import build_scene
from skywright.run.planning import plan_mission
from skywright.vehicle.arms.joints import build_arm_model

OPEN = load_world("open")[0]
PROBE = {"mass_kg": 0.07, "length_m": 0.08}
FIXED = {"joint": "fixed", "along": "-z", "length_m": 0.1, "mass_kg": 0.02}
BAR = {"length_m": 0.7, "mass_kg": 0.3, "diameter_m": 0.02}


def change(name: str, arm: dict[str, Any] | None = None, **tables: Any) -> Robot:
    """Return a built-in robot with these tables over its own; of links, `arm` holds new ones."""
    tree = load_robot(name)[0].model_dump()
    arm = copy.deepcopy(arm or {})
    links = tree["arm"]["links"]
    tree["arm"]["links"] = arm.pop("before", {}) | links | arm.pop("after", {})
    for joint, keys in arm.pop("links", {}).items():
        tree["arm"]["links"][joint] |= keys
    tree["arm"] |= arm
    return Robot.model_validate(tree | tables)


def place(robot: Robot, q: Any, plant: Deviation | None = None) -> tuple[Any, Any]:
    """Return MuJoCo's model and data with the joints at q and the platform at the origin."""
    model = build_scene(robot, OPEN, plant).model
    data = mujoco.MjData(model)
    data.qpos[:3] = 0.0
    for name, value in zip(joint_names(robot), q, strict=True):
        data.qpos[model.joint(name).qposadr] = value
    mujoco.mj_forward(model, data)
    return model, data


ENDS = {
    "fixed tool": change("bimanual", {"after": {"tool": FIXED}}),
    "bracket": change("bimanual", {"before": {"base": FIXED}}),
    "probe left": change("bimanual", probe=PROBE),
    "probe right": change("bimanual", probe=PROBE | {"on": "right_elbow_pitch"}),
    "probe in the arm": change("bimanual", probe=PROBE | {"on": "left_shoulder_yaw"}),
}


@pytest.mark.parametrize("plant", [None, Deviation()], ids=["nominal", "plant"])
@pytest.mark.parametrize("name", ENDS)
def test_hands_and_tip_are_where_mujoco_has_them(name: str, plant: Deviation | None) -> None:
    robot = ENDS[name]
    model = build_body_model(robot)
    q = np.array([0.2, 0.3, -0.4, -1.0, -0.3, -0.1, 0.5, -1.2])
    m, data = place(robot, q, plant)
    k = compute_kinematics(model, q)
    for side in range(2):
        np.testing.assert_allclose(data.site(f"hand{side}").xpos, k["p_BH"][side], atol=1e-12)
    np.testing.assert_allclose(data.site("tip").xpos, compute_tip(model, q)[0], atol=1e-12)
    mass, p_BC, _ = compute_body(model, q)
    assert m.body_subtreemass[m.body("platform").id] == pytest.approx(mass, abs=1e-12)
    np.testing.assert_allclose(data.subtree_com[m.body("platform").id], p_BC, atol=1e-12)


@pytest.mark.parametrize("name", ["fixed tool", "bracket"])
def test_the_closed_form_of_an_arm_counts_its_fixed_links(name: str) -> None:
    """A tool of 0.1 m after the elbow, or a bracket before the shoulder, was left out."""
    robot = ENDS[name]
    q = np.array([0.2, 0.3, -0.4, -1.0, -0.3, -0.1, 0.5, -1.2])
    hands, arm = compute_kinematics(build_body_model(robot), q)["p_BH"], build_arm_model(robot)[0]
    for side in range(2):
        chain = build_arm_chain(robot, side)
        p = chain.p_shoulder + compute_arm_fk(chain, q[chain.first : chain.first + 4])
        np.testing.assert_allclose(p, hands[side], atol=1e-12)
        np.testing.assert_array_equal(arm["p_BS"][side], chain.p_shoulder)
        assert (arm["upper"], arm["fore"]) == (chain.upper, chain.fore)


def test_arms_of_different_reach_have_no_closed_form() -> None:
    """The laws have one forearm for both arms; a probe on one of them is 8 cm longer."""
    aside = FIXED | {"y_m": 0.1}
    short = FIXED | {"side": "left"}
    for robot in (
        ENDS["probe left"], ENDS["probe right"], change("bimanual", {"after": {"tool": aside}}),
        change("bimanual", {"after": {"tool": short}}),
    ):  # fmt: skip
        assert not has_arm_chain(robot)
        with pytest.raises(InputError, match="equal on both sides, and a hand"):
            build_arm_chain(robot)


@pytest.mark.parametrize("mission", ["tool-install", "bar-insertion", "bimanual-bench"])
def test_a_mission_for_two_hands_refuses_a_probe_in_place_of_one(mission: str) -> None:
    sets = {"robot.probe.mass_kg": 0.07, "robot.probe.length_m": 0.08}
    with pytest.raises(InputError, match="has a probe instead of a hand on its left arm"):
        plan_mission(load_description(mission, sets=sets))
    with pytest.raises(InputError, match="a probe instead of a hand on right_elbow_pitch"):
        check_hooks(ENDS["probe right"], mission)


@pytest.mark.parametrize("kind", ["hook", "gripper"])
def test_the_bench_of_two_arms_refuses_hands_without_pads(kind: str) -> None:
    """A gripper squeezed the box with its fingers' tips and dropped it."""
    sets = {"robot.arm.hand.kind": kind, "robot.arm.hand.length_m": 0.05}
    with pytest.raises(InputError, match=f"kind is '{kind}'; valid for bimanual-bench: 'ball'"):
        plan_mission(load_description("bimanual-bench", sets=sets))


def test_a_press_in_flight_is_evaluated_without_docking_gear() -> None:
    """The evaluation of a robot without gear ended with "no field of name f_docking_W"."""
    samples = np.zeros(3, [("t", float), ("phase", int), ("v_WB", float, 3)])
    assert len(_find_touches(samples, [], np.array([0.0, 0.0, -1.0]))) == 0


@pytest.mark.parametrize(("on", "arm"), [(None, "left"), ("right_elbow_pitch", "right")])
def test_a_bar_needs_both_hands(on: str | None, arm: str) -> None:
    with pytest.raises(ValidationError, match=f"two hands, but the {arm} arm has the probe"):
        change("bimanual", {"bar": BAR}, probe=PROBE | {"on": on})


@pytest.mark.parametrize(
    ("name", "arm", "apart"),
    [
        ("ars-lrm", {}, 0.32),
        ("ars-lrm", {"mount_y_m": 0.04}, 0.4),
        ("bimanual", {"after": {"tool": FIXED | {"y_m": 0.05}}}, 0.4),
    ],
)
def test_a_bar_is_between_the_hands_and_not_between_the_shoulders(
    name: str, arm: dict[str, Any], apart: float
) -> None:
    """Its middle was `separation_m` / 2 beside the left hand, 4 cm off with mount_y_m = 0.04."""
    robot = change(name, arm | {"bar": BAR})
    assert compute_hands_apart(robot) == apart
    q = posture(robot, "working")
    m, data = place(robot, q)
    hands = [data.site(f"hand{side}").xpos for side in range(2)]
    assert np.linalg.norm(hands[0] - hands[1]) == pytest.approx(apart, abs=1e-12)
    np.testing.assert_allclose(data.body("bar").xpos, 0.5 * (hands[0] + hands[1]), atol=1e-12)
    _, p_BC, _ = compute_body(build_body_model(robot), q)
    np.testing.assert_allclose(data.subtree_com[m.body("platform").id], p_BC, atol=1e-12)


def test_hands_that_are_not_opposite_each_other_cannot_hold_a_bar() -> None:
    """Arms that lean outward by 20 deg: the bar along y of the left hand points below the right."""
    roll = {"folded_deg": 20.0, "working_deg": 20.0}
    robot = change("bimanual", {"links": {"shoulder_roll": roll}, "bar": BAR})
    with pytest.raises(InputError, match="working posture it misses the right hand by 164 mm"):
        build_body_model(robot)


def test_hooks_are_as_far_apart_as_the_shoulders_are_mounted() -> None:
    assert compute_hooks_apart(load_robot("bimanual")[0]) == 0.3
    assert compute_hooks_apart(change("bimanual", {"mount_y_m": 0.05})) == 0.4
    plan = plan_mission(load_description("tool-install", sets={"robot.arm.mount_y_m": 0.05}))
    assert plan.blocked_by is not None and "the hands are 0.4 m apart" in plan.blocked_by


@pytest.mark.parametrize("key", ["mount_x_m", "mount_z_m"])
def test_the_mount_of_an_arm_on_a_pendulum_is_refused(key: str) -> None:
    """It had no effect."""
    with pytest.raises(InputError, match=rf"arm\.{key} is 0.1; valid: 0, since a pendulum"):
        load_robot("bimanual-longreach", [(f"robot.arm.{key}", 0.1)])
    load_robot("bimanual-longreach", [("robot.arm.mount_y_m", 0.01)])


def test_the_planar_model_counts_a_bracket() -> None:
    plain = load_robot("ars-lrm")[0]
    bracket = change("ars-lrm", {"before": {"base": FIXED}})
    short, long = (build_planar_lrm(build_scene(r, OPEN), r) for r in (plain, bracket))
    assert long.l_b == pytest.approx(short.l_b + 0.1, abs=1e-12)
    assert long.l_u == short.l_u


def build_stick(**link: Any) -> Robot:
    """The robot of the wall contact with one link in place of its arm."""
    tree = load_robot("f550-bridge")[0].model_dump()
    one = {"length_m": 0.35, "mass_kg": 0.12} | link
    servo = {"stall_torque_nm": 5.0, "no_load_speed_rad_s": 2.0}
    servos = {} if link["joint"] == "fixed" else {"motor": servo}
    tree["arm"] = {"links": {"stick": one}, "servos": servos}
    return Robot.model_validate(tree)


def plan_wall(robot: Robot) -> None:
    plan_mission(load_description("wall-contact")._replace(robot=robot))


def test_a_rigid_stick_is_refused_by_a_mission_that_presses_with_the_arm() -> None:
    """It flew for 110 s and ended with "the tip measured no contact"."""
    with pytest.raises(InputError, match="its probe on 'stick', which no driven joint moves"):
        plan_wall(build_stick(joint="fixed"))


@pytest.mark.parametrize("axis", ["x", "y"])
def test_joints_that_do_not_move_the_tip_along_the_probe_are_refused(axis: str) -> None:
    """The roll about the probe, and a hinge in line with the probe: the lever was 1e9 m."""
    robot = build_stick(joint="hinge", axis=axis, joint_min_deg=-90.0, joint_max_deg=90.0)
    with pytest.raises(InputError, match=r"move the tip along the probe by 0\.0 mm for each rad"):
        plan_wall(robot)


def test_a_slide_along_the_probe_can_press() -> None:
    robot = build_stick(joint="slide", axis="x", joint_min_m=0.0, joint_max_m=0.15)
    check_lever(robot, find_free_stance(robot, "side"))


def test_an_arm_that_can_straighten_does_not_press_stretched_out() -> None:
    """Stretched out, no joint moves the tip along the probe; this posture was preferred."""
    tree = load_robot("f550-bridge")[0].model_dump()
    for name, length in (("shoulder", 0.25), ("elbow", 0.12)):
        tree["arm"]["links"][name] |= {
            "length_m": length, "joint_min_deg": -90.0, "joint_max_deg": 90.0,
            "folded_deg": 0.0, "working_deg": 0.0,
        }  # fmt: skip
    robot = Robot.model_validate(tree)
    stance = find_free_stance(robot, "side")
    assert abs(np.degrees(stance.q[1])) > 10.0
    check_lever(robot, stance)
