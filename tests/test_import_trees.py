"""What a file holds beside the robot, how an arm's file is joined to it, and coupled joints.

Masses and places are computed by hand from the files, or by MuJoCo from each file alone.
"""

# ruff: noqa: E501

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import imported_models as models
from skywright.description.robot.limbs import list_servos
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.importing.opening import hear_mujoco, open_file
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip

HUBS = [(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]


def take(file: Path, tmp_path: Path, name: str = "made", **given: Any) -> tuple[Imported, Any]:
    """Import with guesses; return what was made and the robot as it is read from its file."""
    made = import_robot(Request(file, **({"assume": True} | given)), tmp_path / name)
    return made, load_robot(made.path)[0]


def sum_mass(robot: Any, joints: int) -> float:
    return float(compute_body(build_body_model(robot), np.zeros(joints))[0])


def link(name: str, mass: float = 0.1) -> str:
    return f'<link name="{name}">{models.inertial("urdf", mass, "0.05 0 0", models.SMALL)}</link>'


def joint(name: str, parent: str, child: str, inside: str = "", kind: str = "revolute") -> str:
    limit = '<limit lower="-1" upper="1" effort="2" velocity="3"/>' if kind == "revolute" else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>{limit}{inside}</joint>'
    )


def write_urdf(tmp_path: Path, more: str = "", first: str = "") -> Path:
    """A quadrotor of 1.28 kg with the rotors prop_0 to prop_3."""
    rotors = "".join(
        link(f"prop_{i}", 0.02)
        + joint(f"turn_{i}", "base", f"prop_{i}", kind="continuous").replace(
            '"0.1 0 0"', f'"{x} {y} 0"'
        ).replace('"0 1 0"', '"0 0 1"')
        for i, (x, y) in enumerate(HUBS)
    )  # fmt: skip
    text = f'<robot name="q">{first}{link("base", 1.2)}{rotors}{more}</robot>'
    return models.write(tmp_path / "quad.urdf", text)


def mjcf_arm(root: str = 'name="base"', compiler: str = "", before: str = "", after: str = "",
             hinge: str = 'range="-57 57"') -> str:  # fmt: skip
    """An arm of 0.3 kg with one joint, its tip at (0.3, 0, 0) m in its root."""
    return f"""<mujoco><compiler {compiler}/><worldbody>{before}<body {root}>
<inertial pos="0 0 0" mass=".2" diaginertia="1e-4 1e-4 1e-4"/>
<body name="l1" pos="0.1 0 0"><joint name="j1" axis="0 1 0" {hinge}/>
<inertial pos=".05 0 0" mass=".1" diaginertia="1e-4 1e-4 1e-4"/><body name="tip" pos=".2 0 0"/></body>
</body></worldbody>{after}</mujoco>"""


def serve(tmp_path: Path, text: str) -> Path:
    return models.write(tmp_path / "arm.xml", text)


# what is not part of the robot


def test_a_second_body_that_flies_is_left_out_with_its_mass(tmp_path: Path) -> None:
    """In either order: the tree with rotors is the robot."""
    file = models.write_quad(tmp_path)
    text, box = file.read_text(), '<body name="box"><freejoint/><geom size=".1" mass="0.7"/></body>'
    for i, place in enumerate(("<worldbody>", "</worldbody>")):
        file.write_text(text.replace(place, place + box if i == 0 else box + place))
        made, robot = take(file, tmp_path, f"made{i}")
        assert sum_mass(robot, 0) == pytest.approx(1.2)
        assert any("left out: 'box' of quad.xml" in n and "0.7 kg" in n for n in made.notes)
    with pytest.raises(InputError, match=r"0 rotors found"):
        take(file, tmp_path, "other", body="box")


def test_several_bodies_with_rotors_are_refused_until_one_is_chosen(tmp_path: Path) -> None:
    file = models.write_quad(tmp_path)
    text = file.read_text()
    second = '<body name="two"><freejoint/><geom size=".1" mass="0.7"/><site name="t"/></body>'
    text = text.replace("</worldbody>", f"{second}</worldbody>")
    file.write_text(text.replace("<actuator>", '<actuator><motor site="t" gear="0 0 1 0 0 .1"/>'))
    with pytest.raises(InputError, match=r"2 bodies have rotors \('quad', 'two'\).*--body"):
        take(file, tmp_path)
    made, robot = take(file, tmp_path, body="quad")
    assert sum_mass(robot, 0) == pytest.approx(1.2)
    assert any("'two'" in note for note in made.notes)


def test_several_bodies_without_rotors_are_refused(tmp_path: Path) -> None:
    body = '<body name="{}"><freejoint/><geom size=".1" mass="1"/></body>'
    text = "".join(body.format(name) for name in ("a", "b"))
    file = models.write(tmp_path / "two.xml", f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    with pytest.raises(InputError, match=r"2 bodies are there and none of them has rotors.*--body"):
        take(file, tmp_path)


@pytest.mark.parametrize("first", [True, False])
def test_a_urdf_with_two_roots_is_refused(tmp_path: Path, first: bool) -> None:
    """MuJoCo drops the second tree."""
    more = link("payload", 0.5)
    file = write_urdf(tmp_path, first=more) if first else write_urdf(tmp_path, more)
    names = "'payload', 'base'" if first else "'base', 'payload'"
    with pytest.raises(InputError, match=rf"2 links are not the child of a joint \({names}\)"):
        take(file, tmp_path)


@pytest.mark.parametrize("first", [True, False])
def test_what_is_fixed_to_the_world_of_a_urdf_is_left_out(tmp_path: Path, first: bool) -> None:
    table = link("table", 3.0) + joint("t", "world", "table", kind="fixed")
    camera = '<link name="camera"/>' + joint("c", "world", "camera", kind="fixed")
    base = joint("b", "world", "base", kind="fixed")
    joints = table + camera + base if first else base + camera + table
    made, robot = take(write_urdf(tmp_path, first=f'<link name="world"/>{joints}'), tmp_path)
    assert sum_mass(robot, 0) == pytest.approx(1.28)
    assert any("left out: 'table' of quad.urdf" in n and "3 kg" in n for n in made.notes)


def test_the_arm_is_the_tree_with_joints(tmp_path: Path) -> None:
    """Not the table before it, and not the ball that is to be grasped."""
    table = '<body name="table"><geom size=".1" mass="8"/></body>'
    ball = '<body name="ball"><freejoint/><geom size=".1" mass="0.4"/></body>'
    arm = serve(tmp_path, mjcf_arm(before=table + ball))
    made, robot = take(models.write_quad(tmp_path), tmp_path, arm=arm)
    assert made.joints == ["arm/j1"]
    assert sum_mass(robot, 1) == pytest.approx(1.2 + 0.3)
    left_out = [note for note in made.notes if note.startswith("left out: ")]
    assert len(left_out) == 2 and "8 kg" in left_out[0] and "0.4 kg" in left_out[1]
    second = '<body name="other"><joint name="k"/><geom size=".1"/></body>'
    serve(tmp_path, mjcf_arm(before=second))
    with pytest.raises(InputError, match=r"2 bodies have joints \('other', 'base'\)"):
        take(models.write_quad(tmp_path), tmp_path, "two", arm=arm)


# an arm from a file of its own


@pytest.mark.parametrize("pose", [
    "", 'quat="0.6 0 0 0.8"', 'euler="0 0 90"', 'axisangle="0 0 1 90"',
    'xyaxes="0 1 0 -1 0 0"', 'zaxis="1 0 0"', 'pos="1 2 3" euler="10 20 30"', 'mocap="true"',
])  # fmt: skip
def test_the_mount_alone_places_the_arm(tmp_path: Path, pose: str) -> None:
    arm = serve(tmp_path, mjcf_arm(f'name="base" {pose}'))
    _, robot = take(models.write_quad(tmp_path), tmp_path, arm=arm, mount="0.05,0.1,-0.1,0,0,90")
    tip = compute_tip(build_body_model(robot), np.zeros(1))[0]
    np.testing.assert_allclose(tip, [0.05, 0.1 + 0.3, -0.1], atol=1e-9)


@pytest.mark.parametrize("base", ["", 'settotalmass="2.5"'])
@pytest.mark.parametrize(
    "compiler", ["", 'settotalmass="3"', 'settotalmass="0.6" boundmass="0.15"']
)
def test_each_file_keeps_its_total_mass(tmp_path: Path, base: str, compiler: str) -> None:
    """MuJoCo alone would apply the setting of the first file to both."""
    file, arm = models.write_quad(tmp_path), serve(tmp_path, mjcf_arm(compiler=compiler))
    file.write_text(file.read_text().replace('autolimits="true"', f'autolimits="true" {base}'))
    with hear_mujoco([]):  # else it writes a log of its warning
        own = mujoco.MjModel.from_xml_path(str(arm))
    made, robot = take(file, tmp_path, arm=arm)
    parts, moved = (float(own.body_subtreemass[b]) for b in (1, 2))
    assert sum_mass(robot, 1) == pytest.approx((2.5 if base else 1.2) + parts)
    (child,) = robot.arm.links.values()
    assert child.mass_kg == pytest.approx(moved)
    if "boundmass" not in compiler:  # else the frame of the tip has a mass of its own
        assert child.inertia_xx_kgm2 == pytest.approx(float(own.body_inertia[2][0]), rel=1e-6)
    assert made.deviations.worst()[1] < 1e-9


MOTOR = '<motor joint="j1" gear="5" ctrlrange="-1.4 1.4"/>'


@pytest.mark.parametrize(("joints", "drive", "most"), [
    ('actuatorfrcrange="-6 6"', "", 6.0),
    ('actuatorfrcrange="-6 6"', MOTOR, 6.0),
    ('actuatorfrcrange="-9 9"', MOTOR, 7.0),
    ("", MOTOR, 1.4 * 5.0),
    ("", MOTOR.replace("gear", 'forcerange="-0.5 0.5" gear'), 0.5 * 5.0),
    ("", '<general joint="j1" gainprm="3" ctrlrange="-2 2"/>', 6.0),
    ("", '<general joint="j1" gainprm="3" ctrlrange="-1 2"/>', 3.0),  # in both directions
    ("", '<position joint="j1" kp="50" ctrlrange="-1 1"/>', None),  # the control is an angle
    ("", '<position joint="j1" kp="50" ctrlrange="-1 1" forcerange="-4 4"/>', 4.0),
])  # fmt: skip
def test_the_effort_of_an_mjcf_joint(
    tmp_path: Path, joints: str, drive: str, most: float | None
) -> None:
    text = mjcf_arm(hinge=f'range="-57 57" {joints}', after=f"<actuator>{drive}</actuator>")
    made, robot = take(models.write_quad(tmp_path), tmp_path, arm=serve(tmp_path, text))
    ((name, servo),) = list_servos(robot)
    source = load_robot(made.path)[1][f"robot.arm.{name}.stall_torque_nm"]
    assert source.kind == ("assumed" if most is None else "imported")
    if most is not None:
        assert servo.stall_torque_nm == pytest.approx(most)


def test_an_urdf_s_speed_limits_stay_beside_an_mjcf_arm(tmp_path: Path) -> None:
    """MuJoCo reads the efforts of a URDF as limits of joints, without the speeds."""
    file = models.write_urdf_quad(tmp_path)
    _, robot = take(file, tmp_path, arm=serve(tmp_path, mjcf_arm(hinge="")), tip="tool0",
                    weld=("arm/j1",))  # fmt: skip
    assert [s.no_load_speed_rad_s for _, s in list_servos(robot)] == [5.0, 0.2]


# coupled joints


def write_serial(tmp_path: Path, more: str = "") -> Path:
    """An arm of three joints in a row, of which j3 follows j2."""
    text = (
        link("b") + link("l1") + link("l2") + link("l3") + joint("j1", "b", "l1")
        + joint("j2", "l1", "l2") + joint("j3", "l2", "l3", '<mimic joint="j2" multiplier="-1"/>')
        + '<link name="tcp"/>' + joint("t", "l3", "tcp", kind="fixed") + more
    )  # fmt: skip
    return models.write(tmp_path / "arm.urdf", f'<robot name="a">{text}</robot>')


def test_coupled_joints_in_a_row_are_refused_with_the_reason(tmp_path: Path) -> None:
    arm, file = write_serial(tmp_path), models.write_quad(tmp_path)
    with pytest.raises(InputError, match=r"arm/j2 and arm/j3 .* are coupled .*--weld arm/j3"):
        take(file, tmp_path, arm=arm)
    made, _ = take(file, tmp_path, arm=arm, weld=("arm/j3",))
    assert made.joints == ["arm/j1", "arm/j2"]
    assert "joint arm/j3 is frozen: as asked" in made.notes
    arm.write_text(arm.read_text().replace('<mimic joint="j2" multiplier="-1"/>', ""))
    assert take(file, tmp_path, "free", arm=arm)[0].joints == ["arm/j1", "arm/j2", "arm/j3"]


def test_a_mimic_of_sdf_couples_as_that_of_urdf(tmp_path: Path) -> None:
    """follower = multiplier (leader - reference) + offset (SDF 1.11)."""
    text = f"""<link name="base">{models.inertial("sdf", 0.1, "0 0 0", models.SMALL)}</link>"""
    more = """<mimic joint="j1"><multiplier>2</multiplier><offset>0.5</offset>
<reference>0.1</reference></mimic>"""
    for k, above in enumerate(("base", "l1", "l2"), start=1):
        text += f"""<link name="l{k}"><pose relative_to="{above}">0.2 0 0 0 0 0</pose>
{models.inertial("sdf", 0.1, "0 0 0", models.SMALL)}</link>
<joint name="j{k}" type="revolute"><parent>{above}</parent><child>l{k}</child>
<axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>1</upper></limit>
{more if k == 3 else ""}</axis></joint>"""
    sdf = '<sdf version="1.11"><model name="arm">{}</model></sdf>'
    arm = models.write(tmp_path / "arm.sdf", sdf.format(text))
    model = open_file(arm).spec.compile()
    assert model.neq == 1 and model.eq_data[0, :2] == pytest.approx((0.3, 2.0))
    file = models.write_quad(tmp_path)
    with pytest.raises(InputError, match=r"arm/j1 and arm/j3 .* are coupled .*--weld"):
        take(file, tmp_path, arm=arm)
    for wrong in ("j3", "j9", ""):
        arm.write_text(sdf.format(text.replace('joint="j1"', f'joint="{wrong}"')))
        with pytest.raises(InputError, match=f"'j3': <mimic> joint='{wrong}'; valid: another"):
            take(file, tmp_path, arm=arm)


def test_a_rod_that_moves_with_an_arm_s_joint_is_no_finger(tmp_path: Path) -> None:
    """A parallel linkage: the rod is beside the joint, and the arm goes on beyond the joint."""
    rod = link("rod") + joint("k", "l1", "rod", '<mimic joint="j2"/>')
    arm = write_serial(tmp_path, rod)
    arm.write_text(arm.read_text().replace('<mimic joint="j2" multiplier="-1"/>', ""))
    made, _ = take(models.write_quad(tmp_path), tmp_path, arm=arm)
    assert made.joints == ["arm/j1", "arm/j2", "arm/j3"]
    reason = "does not lead to the tip arm/tcp (in the file it moves with arm/j2)"
    assert f"joint arm/k is frozen: {reason}" in made.notes


@pytest.mark.parametrize("one_motor", [True, False])
def test_fingers_with_coupled_joints_of_their_own_stay_fingers(
    tmp_path: Path, one_motor: bool
) -> None:
    """A hand of three fingers with two joints each; one motor moves all, or each its own."""
    text = link("b") + link("palm") + joint("j1", "b", "palm")
    for k in range(3):
        leader = "f0" if one_motor else f"f{k}"
        follows = f'<mimic joint="{leader}"/>' if leader != f"f{k}" else ""
        text += link(f"finger{k}", 0.01) + joint(f"f{k}", "palm", f"finger{k}", follows)
        text += link(f"end{k}", 0.01)
        text += joint(f"e{k}", f"finger{k}", f"end{k}", f'<mimic joint="{leader}"/>')
    arm = models.write(tmp_path / "hand.urdf", f'<robot name="h">{text}</robot>')
    made, _ = take(models.write_quad(tmp_path), tmp_path, arm=arm)
    assert made.joints == ["arm/j1"]
    assert sum("is frozen: a finger of the gripper" in note for note in made.notes) == 6


# names


@pytest.mark.parametrize(
    ("first", "second"), [("Gelenk_ä", "Gelenk_ö"), ("关节", "机器人"), ("😀", "l\x7fb")]
)
def test_names_that_are_not_ascii(tmp_path: Path, first: str, second: str) -> None:
    more = (
        link(first) + link(second) + joint("j\x7f1😀", "base", first) + joint("j2", first, second)
    )
    made, robot = take(write_urdf(tmp_path, more), tmp_path)
    assert made.joints == ["j\x7f1😀", "j2"]
    names = list(robot.arm.links)
    assert len(set(names)) == 2 and all(name.isascii() for name in names)
    note = load_robot(made.path)[1][f"robot.arm.{names[0]}.mass_kg"].note
    assert note == f"link {first}"


# rotors


def test_parts_around_rotors_are_no_rotors(tmp_path: Path) -> None:
    more = "".join(
        link(f"{name}_{i}", 0.01)
        + joint(f"{name}{i}", "base", f"{name}_{i}", kind="fixed")
        for name in ("prop_guard", "rotor_arm", "prop_motor_mount") for i in range(4)
    )  # fmt: skip
    made, robot = take(write_urdf(tmp_path, more), tmp_path)
    assert made.rotors == 4
    np.testing.assert_allclose(robot.rotors.radius_m, 4 * [0.2 * np.sqrt(2.0)], rtol=1e-9)
    assert "links taken as rotors by their names: prop_0, prop_1, prop_2, prop_3" in made.notes


def test_propellers_above_each_other_do_not_limit_the_radius(tmp_path: Path) -> None:
    """A coaxial X8 with 0.05 m between its propellers and 0.6 m between its arms."""
    hubs = [(1.5 * x, 1.5 * y, z) for x, y in HUBS for z in (0.0, 0.05)]
    rotors = tuple(f"{x},{y},{z},{'cw' if i % 2 else 'ccw'}" for i, (x, y, z) in enumerate(hubs))
    _, robot = take(models.write_one_site(tmp_path), tmp_path, rotors=rotors)
    assert robot.rotors.propeller_radius_m == pytest.approx(0.45 * 0.6)
    cube = tuple(
        f"{x},{y},{z},ccw,{x},{y},{z}"
        for x in (-0.1, 0.1)
        for y in (-0.1, 0.1)
        for z in (-0.1, 0.1)
    )
    _, other = take(models.write_one_site(tmp_path), tmp_path, "cube", rotors=cube)
    assert other.rotors.propeller_radius_m == pytest.approx(0.45 * 0.2)


def test_joints_that_turn_rotors_can_be_frozen(tmp_path: Path) -> None:
    rotors = tuple(f"{x},{y},0,{'cw' if i % 2 else 'ccw'}" for i, (x, y) in enumerate(HUBS))
    file = write_urdf(tmp_path)
    with pytest.raises(InputError, match=r"propellers.*--weld turn_0 --weld turn_1") as error:
        take(file, tmp_path, rotors=rotors)
    joints = str(error.value).split("--weld ")[1:]
    made, robot = take(file, tmp_path, rotors=rotors, weld=tuple(name.strip() for name in joints))
    assert made.joints == [] and sum_mass(robot, 0) == pytest.approx(1.28)
