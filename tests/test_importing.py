"""Robots of other tools: what is read, what is asked, what is refused."""

# ruff: noqa: E501

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import imported_models as models
import skywright
from skywright import cli
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.loader import load_robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.capability import check_can_fly
from skywright.models.drawing import build_drawing, compute_part_poses, rotate_vectors
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.importing.tables import choose_frame
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip, posture
from skywright.models.rotors import build_rotors


def take(file: Path, tmp_path: Path, name: str = "made", **given: Any) -> tuple[Imported, Any]:
    """Import with guesses; returns what was made and the robot as it is read from its file."""
    made = import_robot(Request(file, **({"assume": True} | given)), tmp_path / name)
    assert made.deviations.worst()[1] < 1e-9, "the numbers are carried over, not rounded"
    return made, load_robot(made.path)[0]


def find_place(parts: Any, poses: Any, k: int) -> Any:
    """Place (3,) m of a part in W."""
    p = poses[k][0][0]
    while parts[k].parent >= 0:
        k = parts[k].parent
        p = poses[k][0][0] + rotate_vectors(poses[k][1], p[None])[0]
    return p


def test_mjcf_with_motors_at_sites(tmp_path: Path) -> None:
    made, robot = take(models.write_quad(tmp_path), tmp_path)
    rotors = build_rotors(robot.rotors)
    np.testing.assert_allclose(rotors.position[0], [-0.13, -0.17, 0.04], atol=1e-12)
    np.testing.assert_allclose(rotors.position[2], [0.15, 0.17, 0.09], atol=1e-12)
    np.testing.assert_allclose(rotors.axis, np.tile([0.0, 0.0, 1.0], (4, 1)), atol=1e-12)
    # gear's torque on the body is against the propeller's sense: -0.02 means it turns ccw
    assert robot.rotors.spin == ["ccw", "cw", "ccw", "cw"]
    assert (robot.rotors.thrust_min_n, robot.rotors.thrust_max_n) == (0.1, 12.0)
    assert robot.rotors.torque_per_thrust_m == pytest.approx(0.02)
    mass, com, _ = compute_body(build_body_model(robot), np.zeros(0))
    assert mass == pytest.approx(1.2)
    want = (0.4 * np.array([0.01, 0, 0.02]) + 0.2 * np.array([0.04, 0, 0.26])) / 1.2
    np.testing.assert_allclose(com, want, atol=1e-12)
    assert abs(robot.platform.inertia_xz_kgm2) > 1e-4
    check_can_fly(robot)
    sources = load_robot(made.path)[1]
    assert sources["robot.rotors.thrust_max_n"].kind == "imported"
    assert sources["robot.rotors.propeller_radius_m"].kind == "assumed"


def test_mjcf_without_rotors_is_refused_until_they_are_given(tmp_path: Path) -> None:
    file = models.write_one_site(tmp_path)
    with pytest.raises(InputError, match=r"1 rotors found .* --rotor"):
        take(file, tmp_path)
    assert not (tmp_path / "made").exists()
    hubs = ("0.03,0.03,0,ccw", "-0.03,0.03,0,cw", "-0.03,-0.03,0,ccw", "0.03,-0.03,0,cw")
    made, robot = take(file, tmp_path, rotors=hubs)
    assert made.rotors == 4
    assert robot.platform.mass_kg == pytest.approx(0.03)


def test_sdf_with_motor_plugins_in_two_files(tmp_path: Path) -> None:
    made, robot = take(models.write_hexa(tmp_path), tmp_path)
    r = robot.rotors
    assert r.thrust_coefficient_n_per_rad2s2 == models.KF
    assert r.thrust_max_n == pytest.approx(models.KF * models.FASTEST**2)
    assert (r.torque_per_thrust_m, r.time_constant_s) == (models.KM, 0.02)
    assert r.drag_coefficient_n_per_rads_mps == 8e-5
    assert r.spin == ["cw", "ccw"] * 3
    rotors = build_rotors(r)
    for i in range(6):
        # B is the base link's frame; the arms hang on it, so its own pose does not count
        turn = rot_z(np.pi / 3 * i)
        tilt = rot_x(0.5 if i % 2 else -0.5)
        np.testing.assert_allclose(rotors.position[i], turn @ [0.3, 0.0, 0.05], atol=1e-12)
        np.testing.assert_allclose(rotors.axis[i], (turn @ tilt)[:, 2], atol=1e-12)
    assert compute_body(build_body_model(robot), np.zeros(0))[0] == pytest.approx(2.1 + 6 * 0.02)
    assert any("rollingMomentCoefficient" in note for note in made.notes)


def test_urdf_keeps_the_mass_of_its_root(tmp_path: Path) -> None:
    """MuJoCo's reader alone welds the root link to the world and drops its 0.55 kg.

    Pinocchio, which reads the URDF by itself, has the same mass and centre at other postures.
    """
    file = models.write_urdf_quad(tmp_path)
    made, robot = take(file, tmp_path)
    assert made.joints == ["shoulder", "rail"]
    assert robot.rotors.spin == ["ccw", "cw", "ccw", "cw"]
    assert load_robot(made.path)[1]["robot.rotors.spin"].kind == "assumed"
    check_can_fly(robot)
    own = build_body_model(robot)
    other = pin.buildModelFromXML(file.read_text(), pin.JointModelFreeFlyer())
    data = other.createData()
    index = {name: other.joints[other.getJointId(name)].idx_q for name in made.joints}
    assert compute_body(own, np.zeros(2))[0] == pytest.approx(0.55 + 4 * 0.03 + 0.08 + 0.05)
    for q in ([0.0, 0.0], [1.1, 0.07], [-0.8, 0.12]):
        full = pin.neutral(other)
        full[[index["shoulder"], index["rail"]]] = q
        mass, com, _ = compute_body(own, np.array(q))
        assert mass == pytest.approx(pin.computeTotalMass(other))
        np.testing.assert_allclose(com, pin.centerOfMass(other, data, full), atol=1e-9)
        pin.framesForwardKinematics(other, data, full)
        place = data.oMf[other.getFrameId("tool0")].translation
        np.testing.assert_allclose(compute_tip(own, np.array(q))[0], place, atol=1e-9)
    rail = list_joints(robot)[1].link
    assert (rail.joint, *rail.reach) == ("slide", 0.0, 0.12)
    assert [s.stall_torque_nm for _, s in list_servos(robot)] == [1.2, 30.0]
    assert [s.no_load_speed_rad_s for _, s in list_servos(robot)] == [5.0, 0.2]


def test_assumed_senses_alternate_around_the_platform(tmp_path: Path) -> None:
    """PX4's order of rotors is crosswise: in it, neighbours would turn the same way."""
    file = models.write_urdf_quad(tmp_path)
    text = file.read_text()
    first, second = '"0.2 0.2 0.03"', '"-0.2 0.2 0.03"'
    file.write_text(text.replace(first, "%").replace(second, first).replace("%", second))
    made, robot = take(file, tmp_path)
    assert robot.rotors.spin == ["cw", "ccw", "ccw", "cw"]
    assert not any("does not fly" in note for note in made.notes)


@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
@pytest.mark.parametrize("carrier", ["quad", "hexa"])
def test_an_arm_from_a_file_of_its_own(tmp_path: Path, carrier: str, kind: str) -> None:
    platform = models.write_quad(tmp_path) if carrier == "quad" else models.write_hexa(tmp_path)
    arm = models.urdf_arm(tmp_path) if kind == "urdf" else models.mjcf_arm(tmp_path)
    made, robot = take(platform, tmp_path, arm=arm, mount="0.05,0,-0.05,180,0,0")
    alone = take(platform, tmp_path, "alone")[1]
    n, mass = (4, 0.09 + 4 * 0.1 + 0.1 + 0.002) if kind == "urdf" else (6, 0.5 + 1.65 + 0.032)
    assert made.joints == [f"arm/{'joint' if kind == 'urdf' else 'j'}{i + (kind == 'urdf')}"
                           for i in range(n)]  # fmt: skip
    assert any(note.endswith(f"a gripper of {58 if kind == 'urdf' else 50} mm")
               for note in made.notes)  # fmt: skip
    hand = robot.arm.hand
    assert hand.kind == "gripper"
    assert hand.stroke_m == pytest.approx(0.058 if kind == "urdf" else 0.05)
    if kind == "urdf":
        assert hand.grip_force_n == 1.0  # of the finger's joint
    drawing = build_drawing(robot, World(name="nowhere"))
    folded = np.array([posture(robot, "folded")])
    poses = compute_part_poses(drawing, np.zeros((1, 3)), np.eye(4)[:1], folded, np.zeros(1),
                               opening=np.array([[0.03]]))  # fmt: skip
    fingers = [k for k, part in enumerate(drawing.parts) if part.motion == "finger"]
    apart = np.diff([find_place(drawing.parts, poses, k) for k in fingers], axis=0)[0]
    np.testing.assert_allclose(np.abs(apart), [0.0, 0.03 + 2.0 * hand.radius_m, 0.0], atol=1e-9)
    both, one = (
        compute_body(build_body_model(r), np.zeros(k))[0] for r, k in ((robot, n), (alone, 0))
    )
    assert both - one == pytest.approx(mass)
    tip, _ = compute_tip(build_body_model(robot), np.zeros(n))
    if kind == "urdf":  # upside down: up along the arm is down in B
        np.testing.assert_allclose(
            tip, [0.05 + 0.012 + 0.024 + 0.124 + 0.126, 0.0, -0.05 - 0.205], atol=1e-9
        )
    sources = load_robot(made.path)[1]
    torque = {s.kind for key, s in sources.items() if key.endswith("stall_torque_nm")}
    assert torque == ({"assumed"} if kind == "urdf" else {"imported"})  # 1000 N m is nobody's


def test_sliding_fingers_of_sdf_become_a_gripper(tmp_path: Path) -> None:
    """Stroke, force and speed are those of the joints; the fingers end at twice their centres."""
    made, robot = take(models.write_quad(tmp_path), tmp_path, arm=models.sdf_gripper(tmp_path),
                       mount="0.1,0,-0.05,0,90,0")  # fmt: skip
    hand, sources = robot.arm.hand, load_robot(made.path)[1]
    assert made.gripper
    assert made.joints == ["arm/shoulder"]
    assert (hand.kind, hand.grip_force_n) == ("gripper", 12.0)
    assert hand.stroke_m == pytest.approx(0.06)
    assert hand.grip_speed_mps == pytest.approx(0.16)
    assert hand.length_m == pytest.approx(0.04)
    assert sources["robot.arm.hand.stroke_m"].kind == "imported"
    tip, _ = compute_tip(build_body_model(robot), np.zeros(1))
    np.testing.assert_allclose(tip, [0.1, 0.0, -0.05 - 0.1 - 0.05 - 0.04], atol=1e-9)


@pytest.mark.parametrize("kind", ["urdf", "mjcf", "sdf"])
def test_turning_fingers_become_a_gripper(tmp_path: Path, kind: str) -> None:
    """Pivots and angles are those of the joints; torque and speed become those of the pads."""
    made, robot = take(models.write_quad(tmp_path), tmp_path, mount="0.1,0,-0.05,0,90,0",
                       arm=models.turning_gripper(tmp_path, kind))  # fmt: skip
    hand, sources = robot.arm.hand, load_robot(made.path)[1]
    assert made.gripper and made.joints == ["arm/shoulder"]
    assert (hand.kind, hand.finger) == ("gripper", "turn")
    assert hand.pivot_m == pytest.approx(models.PIVOT)
    angles = np.degrees(models.LEAN + np.array(models.SPAN))
    np.testing.assert_allclose([hand.closed_deg, hand.open_deg], angles, atol=1e-9)
    # to the tip of the URDF file, or twice as far as the centres of mass
    assert hand.length_m == pytest.approx(0.05 if kind == "urdf" else 2.0 * models.AWAY)
    assert hand.mass_kg == pytest.approx(0.016)
    assert hand.grip_force_n == pytest.approx(0.6 / hand.length_m)
    if kind != "mjcf":
        assert hand.grip_speed_mps == pytest.approx(2.0 * hand.length_m * 2.0)
    assert sources["robot.arm.hand.grip_force_n"].kind == "derived"
    assert any("a gripper whose fingers turn by 57.3 deg" in note for note in made.notes)
    # in B, the arm hanging: pads beside the tip, the fingers' way along y
    drawing = build_drawing(robot, World(name="nowhere"))
    poses = compute_part_poses(drawing, np.zeros((1, 3)), np.eye(4)[:1], np.zeros((1, 1)),
                               np.zeros(1), opening=np.array([[0.03]]))  # fmt: skip
    fingers = [k for k, part in enumerate(drawing.parts) if part.motion == "turning finger"]
    pivots = sorted(find_place(drawing.parts, poses, k).tolist() for k in fingers)
    want = [[0.1, side * models.PIVOT, -0.05 - models.PALM] for side in (-1.0, 1.0)]
    np.testing.assert_allclose(sorted(pivots, key=lambda p: p[1]), want, atol=1e-9)


@pytest.mark.parametrize(("old", "new", "times"), [
    ('mass value="0.004"', 'mass value="1e-5"', 4),
    ("0.01 0 0", "-0.02 0 0", 4),  # centres behind the pivots
    ('multiplier="-1"', 'multiplier="1"', 1),  # both to the same side
    ('<axis xyz="0 0 1"/>', '<axis xyz="0 1 1"/>', 1),  # in two planes
    ('upper="0.3" effort', 'upper="-0.69" effort', 2),
    (f"{models.PALM} {-models.PIVOT} 0", f"{models.PALM + 0.02} {-models.PIVOT} 0", 1),
    (f"{models.PALM} {-models.PIVOT} 0", f"{models.PALM} {models.PIVOT} 0", 1),  # scissors
    ('"pad1" type="fixed"><', '"pad1" type="revolute"><limit lower="-1" upper="1"/><', 1),
    ('"turn1" type="revolute"><', '"turn1" type="fixed"><', 1),
])  # fmt: skip
def test_hinges_that_are_no_fingers_of_a_gripper_are_frozen(
    tmp_path: Path, old: str, new: str, times: int
) -> None:
    arm = models.turning_gripper(tmp_path, "urdf")
    text = arm.read_text()
    assert text.count(old) == times or times == 1
    arm.write_text(text.replace(old, new, times))
    made, _ = take(models.write_quad(tmp_path), tmp_path, arm=arm, mount="0,0,-0.05,0,90,0",
                   tip="arm/tcp")  # fmt: skip
    assert not made.gripper and made.joints == ["arm/shoulder"]
    assert any(note.startswith("joint arm/turn0 is frozen: ") for note in made.notes)


@pytest.mark.parametrize(
    "change", [{"fingers": 3}, {"fingers": 1}, {"turned": "0 0 1"}], ids=lambda c: next(iter(c))
)
def test_other_fingers_are_frozen_or_joints_of_the_arm(
    tmp_path: Path, change: dict[str, Any]
) -> None:
    made, robot = take(models.write_quad(tmp_path), tmp_path,
                       arm=models.sdf_gripper(tmp_path, **change), mount="0,0,-0.05,0,90,0")  # fmt: skip
    assert not made.gripper
    assert robot.arm.hand.kind == "ball"


@pytest.mark.parametrize("change", [
    (r"<upper>0.03</upper>", "<upper>1e15</upper>"),  # limits that are none
    (r"<upper>0.03</upper>", "<upper>1e-9</upper>"),
    (r"<mass>0.02</mass>", "<mass>1e-7</mass>"),
    (r"<xyz>0 -?1.0 0</xyz>", "<xyz>1 0 0</xyz>"),  # along the arm
])  # fmt: skip
def test_slides_that_are_no_fingers_of_a_gripper_are_frozen(
    tmp_path: Path, change: tuple[str, str]
) -> None:
    arm = models.sdf_gripper(tmp_path)
    arm.write_text(re.sub(*change, arm.read_text()))
    made, robot = take(models.write_quad(tmp_path), tmp_path, arm=arm, mount="0,0,-0.05,0,90,0")
    assert not made.gripper and robot.arm.hand.kind == "ball"
    assert sum("is frozen: a finger of the gripper" in note for note in made.notes) == 2


def test_fingers_that_leave_no_palm_are_refused_and_can_be_welded(tmp_path: Path) -> None:
    arm = models.sdf_gripper(tmp_path, mass=2.0)
    file = models.write_quad(tmp_path)
    with pytest.raises(InputError, match=r"without the fingers \(4 kg\).*--weld arm/slide"):
        take(file, tmp_path, arm=arm, mount="0,0,-0.05,0,90,0")
    made, _ = take(file, tmp_path, arm=arm, mount="0,0,-0.05,0,90,0", weld=("arm/slide0",))
    assert not made.gripper


def test_heavy_fingers_leave_a_body_behind(tmp_path: Path) -> None:
    """Fingers of 0.4 kg on a palm of 50 g: what cannot be taken off the palm stays there."""
    arm = models.sdf_gripper(tmp_path, mass=0.4)
    made, robot = take(models.write_quad(tmp_path), tmp_path, arm=arm, mount="0,0,-0.05,0,90,0")
    source = load_robot(made.path)[1]["robot.arm.hand.mass_kg"]
    assert robot.arm.hand.mass_kg < 0.8
    assert (source.kind, "the palm is light" in source.note) == ("derived", True)


def test_what_is_missing_is_asked_or_listed(tmp_path: Path) -> None:
    file = models.write_quad(tmp_path)
    with pytest.raises(
        InputError, match=r"propeller_radius_m.*time_constant_s.*energy_wh.*--assume"
    ):
        take(file, tmp_path, assume=False)
    asked = []

    def answer(question: Any, check: Any) -> Any:
        asked.append(question.key)
        with pytest.raises(InputError, match=r"is -1|is the text"):
            check(-1 if len(asked) > 1 else "wide")
        given = question.guess if len(asked) > 1 else 0.11
        check(given)
        return given

    answers = {"robot.battery.energy_wh": 80.0, "robot.platform.gear_height_m": 0.3}
    made = import_robot(Request(file, answers=answers), tmp_path / "asked", answer)
    assert asked == [f"robot.rotors.{key}" for key in (
        "propeller_radius_m", "thrust_coefficient_n_per_rad2s2", "time_constant_s")]  # fmt: skip
    robot, sources = load_robot(made.path)
    assert (robot.battery.energy_wh, robot.platform.gear_height_m) == (80.0, 0.3)
    kinds = [sources[key].kind for key in (*answers, *asked)]
    assert kinds == ["asked"] * 3 + ["assumed"] * 2, "an accepted guess remains a guess"
    assert sources["robot.rotors.time_constant_s"].range == (0.015, 0.06)


def test_a_wrong_answer_on_the_terminal_is_asked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = models.write_quad(tmp_path), tmp_path / "one"
    monkeypatch.setattr("click.testing._NamedTextIOWrapper.isatty", lambda _: True, raising=False)
    result = CliRunner().invoke(
        cli.main, ["import", str(file), "--out", str(out)], input="wide\n-1\n0.12\n\n[1]\n\n\n"
    )
    assert result.exit_code == 0, result.output
    assert result.output.count("Error: robot.rotors.propeller_radius_m is") == 2
    assert result.output.count("Error: robot.rotors.time_constant_s is a list of 1") == 1
    assert load_robot(out / "robot.toml")[0].rotors.propeller_radius_m == 0.12


def test_the_command_writes_once_and_says_what_it_did(tmp_path: Path) -> None:
    file, out = models.write_quad(tmp_path), tmp_path / "one"
    args = ["import", str(file), "--assume", "--out", str(out), "--json"]
    first = CliRunner().invoke(cli.main, args)
    assert first.exit_code == 0, first.output
    told = json.loads(first.output)
    assert (told["kind"], told["rotors"], told["joints"]) == ("MJCF", 4, [])
    assert told["deviations"]["mass"] < 1e-12
    again = CliRunner().invoke(cli.main, args)
    assert again.exit_code == 2
    assert "exists" in again.output
    wrong = CliRunner().invoke(cli.main, [*args[:3], "--out", str(tmp_path / "two"), "--set",
                                          "robot.rotors.radius=1"])  # fmt: skip
    assert wrong.exit_code == 2
    assert "radius_m" in wrong.output
    assert not (tmp_path / "two").exists()


BAD = {
    "entities": '<!DOCTYPE m [<!ENTITY a "b">]><mujoco>&a;</mujoco>',
    "half": "<mujoco><worldbody>",
    "other": "<html/>",
    "template": "<sdf><model name='m'><link name='{{ x }}'/></model></sdf>",
    "xacro": "<robot xmlns:xacro='http://www.ros.org/wiki/xacro' name='r'><xacro:include filename='x'/></robot>",
    "deep": "<mujoco><worldbody>" + "<body>" * 100_000 + "</body>" * 100_000 + "</worldbody></mujoco>",
    "wide": "<robot name='r'>" + "".join(f"<link name='l{i}'/>" for i in range(100_000)) + "</robot>",
    "nothing": "<robot name='r'/>",
    "self": "<mujoco><include file='bad.xml'/></mujoco>",
    "missing": "<mujoco><include file='elsewhere.xml'/></mujoco>",
    "no model": "<sdf version='1.9'><world name='w'/></sdf>",
    "lost": "<sdf version='1.9'><model name='m'><include><uri>model://lost</uri></include></model></sdf>",
    "nan": "<robot name='r'><link name='a'><inertial><mass value='nan'/><inertia ixx='1' ixy='0' "
    "ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link></robot>",
    "nan sdf": "<sdf version='1.9'><model name='m'><link name='a'><inertial><mass>nan</mass>"
    "</inertial></link></model></sdf>",
    "unphysical": "<robot name='r'><link name='a'><inertial><mass value='1'/><inertia ixx='1' ixy='0' "
    "ixz='0' iyy='1' iyz='0' izz='9'/></inertial></link></robot>",
    "planar": "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='planar'>"
    "<parent link='a'/><child link='b'/></joint></robot>",
    "loop": "<sdf version='1.9'><model name='m'><link name='a'/><link name='b'/>"
    "<joint name='j' type='fixed'><parent>a</parent><child>b</child></joint>"
    "<joint name='k' type='fixed'><parent>b</parent><child>a</child></joint></model></sdf>",
    "circular frames": "<sdf version='1.9'><model name='m'><link name='a'><pose relative_to='f'>"
    "0 0 0 0 0 0</pose></link><frame name='f'><pose relative_to='a'>0 0 0 0 0 0</pose></frame>"
    "<link name='b'/><joint name='j' type='fixed'><parent>b</parent><child>a</child></joint></model></sdf>",
    "ball": "<mujoco><worldbody><body name='a'><freejoint/><geom size='.1'/><body><joint type='ball'/>"
    "<geom size='.1'/></body></body></worldbody></mujoco>",
    "two joints": "<mujoco><worldbody><body name='a'><freejoint/><geom size='.1'/><body name='b'>"
    "<joint axis='1 0 0'/><joint axis='0 1 0'/><geom size='.1'/></body><site name='s0' pos='1 0 0'/>"
    "<site name='s1' pos='0 1 0'/><site name='s2'/></body></worldbody><actuator>"
    + "".join(f"<motor site='s{i}' gear='0 0 1 0 0 .1'/>" for i in range(3))
    + "</actuator></mujoco>",
    "mesh": "<mujoco><asset><mesh name='x' file='x.obj'/></asset><worldbody><body name='a'><freejoint/>"
    "<geom type='mesh' mesh='x'/></body></worldbody></mujoco>",
    "no free": "<mujoco><worldbody><body name='a'><geom size='.1'/></body></worldbody></mujoco>",
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_files_give_one_line(tmp_path: Path, name: str) -> None:
    file = tmp_path / "bad.xml"
    file.write_text(BAD[name], encoding="utf-8")
    out = tmp_path / "made"
    result = CliRunner().invoke(cli.main, ["import", str(file), "--assume", "--out", str(out)])
    assert result.exit_code == 2, result.output
    line = result.output.strip()
    assert "\n" not in line
    assert len(line) < 1500
    assert not out.exists()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"mount": "1,2"}, "--mount"),
        ({"mount": "1,2,3", "arm": None}, "--mount 1,2,3: only with --arm"),
        ({"mount": "1,2,nan"}, "--mount"),
        ({"tip": "elbow"}, "neither a body"),
        ({"weld": ("nothing",)}, "is no joint"),
        ({"body": "arm"}, "does not fly"),
        ({"rotors": ("1,2,3",)}, "--rotor"),
        ({"rotors": ("1,2,3,up",)}, "--rotor"),
        ({"answers": {"platform.mass_kg": 1.0}}, "keys of the robot file"),
        ({"answers": {"robot.platform.mass_kg": 9.0}}, "deviates .* in mass"),
        ({"answers": {"robot.platform.mass_kg": -9.0}}, "greater than 0"),
        ({"answers": {"robot.rotors.time_constant_s": "abc"}}, "is the text 'abc'"),
        ({"answers": {"robot.rotors.time_constant_s": [1, 2]}}, "is a list of 2"),
        ({"answers": {"robot.rotors.time_constant_s": 10**400}}, "robot.rotors.time_constant_s"),
        ({"answers": {"robot.platform": 1}}, "robot.platform"),
        ({"answers": {"robot.": 1}}, "unknown key"),
    ],
)
def test_wrong_options_are_refused(tmp_path: Path, given: dict[str, Any], says: str) -> None:
    arm = models.urdf_arm(tmp_path)
    with pytest.raises(InputError, match=says):
        take(models.write_quad(tmp_path), tmp_path, **({"arm": arm} | given))
    assert not (tmp_path / "made").exists()


def test_a_refused_robot_file_is_named_as_asked_for(tmp_path: Path) -> None:
    """Not as the scratch file that the command had written."""
    file = models.write_quad(tmp_path)
    file.write_text(file.read_text().replace('mass=".4"', 'mass="4e6"'))
    with pytest.raises(InputError, match=r"quad.xml as .*made/robot.toml: robot.platform.mass_kg"):
        take(file, tmp_path)


def test_rotors_that_differ_are_refused(tmp_path: Path) -> None:
    first = f"<motorConstant>{models.KF}</motorConstant>"
    file = models.write_hexa(tmp_path)
    text = file.read_text()
    file.write_text(text.replace(first, "<motorConstant>1e-5</motorConstant>", 1))
    with pytest.raises(InputError, match="rotors differ in thrust"):
        take(file, tmp_path)
    wrong = models.write_hexa(tmp_path, ("<linkName>rotor_3<", "<linkName>rotor_9<"))
    with pytest.raises(InputError, match="no such link or joint"):
        take(wrong, tmp_path)


def write_limits(tmp_path: Path, kind: str, low: float, high: float) -> Path:
    """A robot with other limits of the joint `shoulder`, in URDF or SDF."""
    if kind == "urdf":
        file = models.write_urdf_quad(tmp_path)
        new = f'lower="{low}" upper="{high}"'
        file.write_text(file.read_text().replace('lower="-1" upper="1.5"', new))
        return file
    joint = f"""<link name="upper"><pose>0.1 0 -0.1 0 0 0</pose>
{models.inertial("sdf", 0.1, "0.05 0 0", models.SMALL)}</link><joint name="shoulder" type="revolute">
<parent>base</parent><child>upper</child><axis><xyz>0 1 0</xyz>
<limit><lower>{low}</lower><upper>{high}</upper></limit></axis></joint></model>"""
    return models.write_hexa(tmp_path, ("</model>", joint))


@pytest.mark.parametrize("kind", ["urdf", "sdf"])
def test_a_joint_with_equal_limits_is_locked_there(tmp_path: Path, kind: str) -> None:
    made, robot = take(write_limits(tmp_path, kind, 0.7, 0.7), tmp_path)
    assert "shoulder" not in made.joints
    assert "joint shoulder is frozen: both its limits are 0.7" in made.notes
    assert not any("MuJoCo" in note for note in made.notes)
    turned = take(write_limits(tmp_path, kind, -0.7, 0.9), tmp_path, "turned")[1]
    n = len(list_joints(turned))
    q = np.zeros(n)
    q[0] = 0.7
    for mine, other in zip(
        compute_body(build_body_model(robot), np.zeros(n - 1)),
        compute_body(build_body_model(turned), q),
        strict=True,
    ):
        np.testing.assert_allclose(np.asarray(mine), np.asarray(other), atol=1e-9)


@pytest.mark.parametrize("kind", ["urdf", "sdf"])
def test_reversed_limits_are_refused(tmp_path: Path, kind: str) -> None:
    file = write_limits(tmp_path, kind, 1.5, -1)
    with pytest.raises(InputError, match=r"'shoulder': lower limit 1.5 is above upper limit -1"):
        take(file, tmp_path)


def test_a_limit_on_one_side_is_kept(tmp_path: Path) -> None:
    robot = take(write_limits(tmp_path, "sdf", -1e16, 0.5), tmp_path)[1]
    link = list_joints(robot)[0].link
    assert link.joint_min_deg == -360.0
    assert link.joint_max_deg == pytest.approx(np.degrees(0.5))


def test_a_tip_at_the_last_joint_is_refused(tmp_path: Path) -> None:
    file = models.write_urdf_quad(tmp_path)
    text = file.read_text().replace('xyz="0 0 -0.03"', 'xyz="0 0 0"')
    file.write_text(text.replace('xyz="0.02 0.01 -0.08"', 'xyz="0 0 0"'))
    with pytest.raises(InputError, match=r"at joint 'rail', the last.*--tip.*--weld rail"):
        take(file, tmp_path)
    assert take(file, tmp_path, weld=("rail",))[0].joints == ["shoulder"]


CHANGES = {
    "nan": ('mass=".4"', 'mass="nan"', "mass of <geom> is 'nan'"),
    "thrust": ("0.1 12", "12 0.1", "ctrlrange of actuator '' is 12 0.1"),
    "include": ("<worldbody>", "<include/><worldbody>", "an <include> without file"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_mujoco_leaves_out_without_a_word_is_refused(tmp_path: Path, name: str) -> None:
    old, new, says = CHANGES[name]
    file = models.write_quad(tmp_path)
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(InputError, match=says):
        take(file, tmp_path)


def test_mujoco_writes_no_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its URDF reader warns of equal limits, on the terminal and in MUJOCO_LOG.TXT."""
    file = write_limits(tmp_path, "urdf", 0.7, 0.7)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("skywright.models.importing.opening._find_locked", lambda *_: {})
    made = take(file, tmp_path)[0]
    assert any("MuJoCo: joint 'shoulder' has equal" in note for note in made.notes)
    assert not list(tmp_path.glob("MUJOCO*"))


@pytest.mark.filterwarnings("error")
def test_sdf_with_numbers_that_cannot_be(tmp_path: Path) -> None:
    constant = f"<motorConstant>{models.KF}</motorConstant>"
    negative = models.write_hexa(tmp_path, (constant, constant.replace(">9", ">-9")))
    with pytest.raises(InputError, match="motorConstant is -9e-06; valid: 0 or more"):
        take(negative, tmp_path)
    empty = models.write_hexa(tmp_path, ("<uri>model://hexa_base</uri>", ""))
    with pytest.raises(InputError, match="an <include> without <uri>"):
        take(empty, tmp_path)
    file = models.write_hexa(tmp_path)
    base = tmp_path / "hexa_base" / "model.sdf"
    quaternion = '<pose rotation_format="quat_xyzw">0 0 0 0 0 0 0</pose>'
    base.write_text(base.read_text().replace("<pose>0 0 0.02 0 0 0.4</pose>", quaternion))
    with pytest.raises(InputError, match="the quaternion is zero"):
        take(file, tmp_path)


def test_two_rotors_at_one_place_are_told(tmp_path: Path) -> None:
    file = models.write_urdf_quad(tmp_path)
    file.write_text(file.read_text().replace('xyz="-0.2 0.2 0.03"', 'xyz="0.2 0.2 0.03"'))
    made = take(file, tmp_path)[0]
    assert "rotors 1 and 2 are at one place: is one there twice?" in made.notes


PAYLOAD = """<sdf version="{version}"><model name="box"><pose>0 0 0.3 0 0 0</pose>
<link name="case"><pose>0.1 0 0 0 0 0.5</pose>{inertial}</link>
<link name="lid"><pose>0.1 0.2 0 0 0 0.6</pose>{inertial}</link>
<frame name="handle" attached_to="lid"><pose>0 0 0.05 0 0.3 0</pose></frame>
<joint name="hinge" type="revolute"><parent>case</parent><child>lid</child>
<axis><xyz>1 0 0</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis></joint></model></sdf>"""


@pytest.mark.parametrize("version", ["1.4", "1.9"])
@pytest.mark.parametrize(
    ("include", "scope", "origin", "turn"),
    [
        ('<include merge="true"><uri>box</uri>', "", [0, 0, 0.3], 0),
        ('<include merge="true"><uri>box</uri><pose>1 2 3 0 0 0</pose>', "", [1, 2, 3], 0),
        ('<include><uri>box</uri><name>b</name><pose degrees="true">1 0 0 0 0 90</pose>',
         "b::", [1, 0, 0], 90),
        ('<include><uri>box</uri><pose relative_to="base">0 0 1 0 0 0</pose>',
         "box::", None, None),
        ('<include merge="true"><uri>box</uri><placement_frame>handle</placement_frame>'
         "<pose>0.1 0.2 0.05 0 0.3 0.6</pose>", "", [0, 0, 0], 0),
    ],
)  # fmt: skip
def test_sdf_includes_have_poses_and_names(
    tmp_path: Path, version: str, include: str, scope: str, origin: Any, turn: Any
) -> None:
    """Where the parts of an included model are, by hand from the file."""
    inertial = models.inertial("sdf", 0.1, "0.03 0 0", models.SMALL)
    text = PAYLOAD.format(version=version, inertial=inertial)
    models.write(tmp_path / "box" / "model.sdf", text)
    joint = f"""{include}</include><joint name="mount" type="fixed"><parent>base</parent>
<child>{scope}case</child></joint></model>"""
    file = models.write_hexa(tmp_path, ("</model>", joint))
    made, robot = take(file, tmp_path)
    # B is the frame of the link `base`, which is at (0, 0, 0.24 + 0.02) in the model, yaw 0.4
    R_B, p_B = rot_z(0.4), np.array([0.0, 0.0, 0.26])
    if origin is None:
        R, p = R_B, p_B + np.array([0.0, 0.0, 1.0])
    else:
        R, p = rot_z(np.radians(turn)), np.array(origin)
    assert made.joints == [f"{scope}hinge"]
    link = list_joints(robot)[0].link
    place = R_B.T @ (p + R @ np.array([0.1, 0.2, 0.0]) - p_B)
    np.testing.assert_allclose(np.array([link.x_m, link.y_m, link.z_m]), place, atol=1e-9)
    axis = R_B.T @ R @ (np.eye(3) if version == "1.4" else rot_z(0.6))[:, 0]
    roll, pitch, yaw = np.radians([link.roll_deg, link.pitch_deg, link.yaw_deg])
    frame = rot_z(yaw) @ rot_y(pitch) @ rot_x(roll)
    np.testing.assert_allclose(frame[:, "xyz".index(link.axis)], axis, atol=1e-9)


def test_sdf_with_a_nested_model_and_an_undeclared_prefix(tmp_path: Path) -> None:
    inertial = models.inertial("sdf", 0.1, "0.03 0 0", models.SMALL)
    box = PAYLOAD.format(version="1.9", inertial=inertial).partition(">")[2].removesuffix("</sdf>")
    nested = f"""{box}<joint name="mount" type="fixed" gz:kind="clamp"><parent>base</parent>
<child>box::case</child></joint></model>"""
    made, _ = take(models.write_hexa(tmp_path, ("</model></sdf>", f"{nested}</sdf>")), tmp_path)
    assert made.joints == ["box::hinge"]


def test_joints_can_be_welded(tmp_path: Path) -> None:
    file, arm = models.write_quad(tmp_path), models.mjcf_arm(tmp_path)
    made, robot = take(file, tmp_path, arm=arm, weld=("arm/j3", "arm/j5"))
    assert made.joints == ["arm/j0", "arm/j1", "arm/j2", "arm/j4"]
    assert len(list_servos(robot)) == 4
    none = take(file, tmp_path, "none", arm=arm, weld=("*",))[1]
    assert none.arm is None
    masses = [compute_body(build_body_model(r), np.zeros(n))[0] for r, n in ((robot, 4), (none, 0))]
    assert masses[0] == pytest.approx(masses[1])


def test_a_robot_that_cannot_fly_is_written_with_the_reason(tmp_path: Path) -> None:
    """A public quadrotor has equal senses on one side: roll and yaw cannot be told apart."""
    file = models.write_quad(tmp_path)
    motors = file.read_text()
    swapped = {1: "0 0 1 0 0 0.02", 2: "0 0 1 0 0 0.02", 3: "0 0 1 0 0 -0.02"}
    tree = ET.fromstring(motors)
    for i, motor in enumerate(tree.iter("motor")):
        motor.set("gear", swapped.get(i, motor.get("gear", "")))
    file.write_text(ET.tostring(tree, encoding="unicode"))
    made, _ = take(file, tmp_path)
    assert any("does not fly as the file describes it" in note for note in made.notes)
    spins = {"robot.rotors.spin": ["ccw", "cw", "ccw", "cw"]}
    mended, robot = take(file, tmp_path, "mended", answers=spins)
    assert not any("does not fly" in note for note in mended.notes)
    check_can_fly(robot)


numbers = st.floats(-0.5, 0.5).map(lambda x: round(x, 3))


@settings(max_examples=100, deadline=None)
@given(axis=st.tuples(numbers, numbers, numbers), d=st.tuples(numbers, numbers, numbers))
def test_link_frames_have_the_joint_s_axis(axis: Any, d: Any) -> None:
    size = np.linalg.norm(axis)
    if size < 0.05:
        return
    a, way = np.array(axis) / size, np.array(d)
    R, letter, along, length = choose_frame(a, way)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) > 0.0
    np.testing.assert_allclose(R[:, "xyz".index(letter)], a, atol=1e-12)
    link = R[:, 0] if along == "x" else -R[:, 2]
    assert length > 0.0
    assert link @ way >= -1e-9
    assert length <= np.linalg.norm(way) + 2e-6


def test_the_written_file_is_xml_free_and_sourced(tmp_path: Path) -> None:
    """Each number has a source; text of the file cannot break out of its string."""
    file = models.write_quad(tmp_path)
    tree = ET.parse(file)
    for body in tree.iter("body"):
        body.set("name", 'quad" }\n[robot.control]\nrate_hz = 1 # ')
    tree.write(file)
    made, robot = take(file, tmp_path)
    assert robot.control.rate_hz == 500.0
    assert made.counts["imported"] > 15


def test_an_imported_robot_flies(tmp_path: Path) -> None:
    file, arm = models.write_quad(tmp_path), models.urdf_arm(tmp_path)
    made, _ = take(file, tmp_path, arm=arm, mount="0.05,0,-0.05,180,0,0")
    points = [{"x_m": 0.5, "y_m": 0.0, "z_m": 1.2, "hold_s": 1.0}]
    sets = {"mission.timestep_ms": 2, "mission.task.points": points}
    description = skywright.load("waypoints", robot=str(made.path), sets=sets)
    result = skywright.run(description, report=False, out=tmp_path / "run")
    assert result.outcome == "succeeded", result.metrics
