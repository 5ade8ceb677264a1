"""Imported robots whose rotors move, or whose joints form loops."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import imported_models as models
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.rigid_body import build_body_model, compute_tip
from skywright.models.rotors import build_rotors

PLACES = [(0.3, 0.0), (0.15, 0.26), (-0.15, 0.26), (-0.3, 0.0), (-0.15, -0.26), (0.15, -0.26)]
MASS = '<inertial pos="0 0 0.001" mass="0.05" diaginertia="2e-5 3e-5 4e-5"/>'


def take(file: Path, folder: Path, **given: Any) -> tuple[Imported, Any]:
    made = import_robot(Request(file, **({"assume": True} | given)), folder / "made")
    return made, load_robot(made.path)[0]


def write_tilting(folder: Path, kind: str, boom: str, axis: str = "1 0 0") -> Path:
    """A hexarotor; its last rotor is on a boom, whose joint is a hinge, a slide or fixed."""
    names = {"hinge": "revolute", "slide": "prismatic"}
    if kind == "mjcf":
        joint = f'<joint name="tilt" type="{boom}" axis="{axis}" range="-0.5 0.5"/>'
        bodies = ""
        for i, (x, y) in enumerate(PLACES):
            pos = f'pos="{x} {y} 0.05"'
            moving = joint if i == 5 and boom != "fixed" else ""
            bodies += f'<body name="hub{i}" {pos}>{MASS}{moving}<site name="s{i}"/></body>'
        motors = "".join(
            f'<motor site="s{i}" gear="0 0 1 0 0 {0.02 * (-1) ** i}" ctrlrange="0 9"/>'
            for i in range(6)
        )
        body = MASS.replace("0.05", "2.0").replace("2e-5 3e-5 4e-5", "0.02 0.02 0.03")
        return models.write(
            folder / "hexa.xml",
            f"""<mujoco><compiler angle="radian"/><worldbody><body name="base"><freejoint/>{body}
{bodies}</body></worldbody><actuator>{motors}</actuator></mujoco>""",
        )
    parts = ""
    for i, (x, y) in enumerate([*PLACES, PLACES[5]]):
        at = (x, y, 0.03 if i == 6 else 0.05)
        link = "boom" if i == 6 else f"rotor_{i}"
        over = "boom" if i == 5 else "base"
        joint = names.get(boom, boom) if i == 6 else "revolute" if kind == "sdf" else "continuous"
        way, name = (axis, "tilt") if i == 6 else ("0 0 1", f"spin{i}")
        if kind == "sdf":
            parts += f"""<link name="{link}"><pose>{at[0]} {at[1]} {at[2]} 0 0 0</pose>
{models.inertial("sdf", 0.02, "0 0 0.01", models.SMALL)}</link><joint name="{name}" type="{joint}">
<parent>{over}</parent><child>{link}</child><axis><xyz>{way}</xyz><limit>
<lower>{-0.5 if i == 6 else -1e16}</lower><upper>{0.5 if i == 6 else 1e16}</upper></limit></axis>
</joint>"""
            if i < 6:
                parts += f"""<plugin filename="motor" name="m{i}"><jointName>spin{i}</jointName>
<linkName>{link}</linkName><turningDirection>{"ccw" if i % 2 else "cw"}</turningDirection>
<maxRotVelocity>900</maxRotVelocity><motorConstant>9e-6</motorConstant></plugin>"""
        else:
            place = "0 0 0.02" if i == 5 else " ".join(map(str, at))
            parts += f"""<link name="{link}">
{models.inertial("urdf", 0.02, "0 0 0.01", models.SMALL)}</link>
<joint name="{name}" type="{joint}"><parent link="{over}"/><child link="{link}"/>
<origin xyz="{place}"/><axis xyz="{way}"/>
<limit lower="-0.5" upper="0.5" effort="1" velocity="5"/></joint>"""
    base = f'<link name="base">{models.inertial(kind, 2.0, "0 0 0", models.BODY)}</link>{parts}'
    if kind == "sdf":
        text = f'<sdf version="1.9"><model name="h">{base}</model></sdf>'
        return models.write(folder / "hexa" / "model.sdf", text)
    return models.write(folder / "hexa.urdf", f'<robot name="h">{base}</robot>')


@pytest.mark.parametrize("boom", ["hinge", "slide"])
@pytest.mark.parametrize("kind", ["sdf", "urdf", "mjcf"])
def test_a_rotor_on_a_moving_boom_is_refused(tmp_path: Path, kind: str, boom: str) -> None:
    """Frozen by --weld, or fixed in the file, it is a rotor like the others."""
    file = write_tilting(tmp_path, kind, boom)
    with pytest.raises(InputError, match=r"hexa.*: joint 'tilt' moves rotor 6, .*--weld tilt"):
        take(file, tmp_path)
    for weld in (("tilt",), ("*",)):
        made, robot = take(file, tmp_path / weld[0].replace("*", "all"), weld=weld)
        assert (made.joints, made.rotors) == ([], 6)
        rotors = build_rotors(robot.rotors)
        np.testing.assert_allclose(rotors.axis, np.tile([0.0, 0.0, 1.0], (6, 1)), atol=1e-9)
        np.testing.assert_allclose(rotors.position[:, :2], PLACES, atol=1e-9)
    assert take(write_tilting(tmp_path, kind, "fixed"), tmp_path)[0].rotors == 6


@pytest.mark.parametrize("kind", ["sdf", "urdf", "mjcf"])
def test_a_boom_beside_an_arm_is_refused_too(tmp_path: Path, kind: str) -> None:
    """Its joint does not lead to the tip, so it would be frozen."""
    arm = models.urdf_arm(tmp_path)
    options = {"arm": arm, "mount": "0.05,0,-0.05,180,0,0"}
    with pytest.raises(InputError, match=r"joint 'tilt' moves rotor 6"):
        take(write_tilting(tmp_path, kind, "hinge"), tmp_path, **options)
    made, _ = take(write_tilting(tmp_path, kind, "hinge"), tmp_path, weld=("tilt",), **options)
    assert made.joints == [f"arm/joint{i}" for i in range(1, 5)]


def test_a_joint_that_turns_a_propeller_moves_no_rotor(tmp_path: Path) -> None:
    """Its axis is that of the thrust, through the site; rotors given by hand have no link."""
    arm = models.urdf_arm(tmp_path)
    options = {"arm": arm, "mount": "0.05,0,-0.05,180,0,0"}
    file = write_tilting(tmp_path, "mjcf", "hinge", "0 0 1")
    assert take(file, tmp_path, **options)[0].rotors == 6
    file.write_text(file.read_text().replace('<site name="s5"', '<site name="s5" pos=".01 0 0"'))
    with pytest.raises(InputError, match=r"joint 'tilt' moves rotor 6"):
        take(file, tmp_path / "beside", **options)
    given = tuple(f"{x},{y},0.05,{'ccw' if i % 2 else 'cw'}" for i, (x, y) in enumerate(PLACES))
    assert take(file, tmp_path / "given", rotors=given, **options)[0].rotors == 6


def write_loop(folder: Path, equality: str, table: str = "") -> Path:
    """A quadrotor with two links in a row, and a crank beside the second one."""
    file = models.write_quad(folder)
    arm = f"""<body name="upper" pos="0 0 -0.05"><joint name="a" axis="0 1 0" range="-60 60"/>{MASS}
<body name="lower" pos="0.1 0 0"><joint name="b" axis="0 1 0" range="-60 60"/>{MASS}
<body name="tcp" pos="0.1 0 0"/></body>
<body name="crank" pos="0 0.1 0"><joint name="c" axis="0 1 0"/>{MASS}</body></body>"""
    text = file.read_text().replace("</body></worldbody>", f"{arm}</body>{table}</worldbody>")
    text = text.replace("</worldbody>", f"</worldbody><equality>{equality}</equality>")
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("equality", "joints"),
    [
        ('<connect name="e" body1="lower" body2="quad" anchor="0 0 0.1"/>', ["a", "b"]),
        ('<weld name="e" body1="upper" body2="lower"/>', ["b"]),
        ('<connect name="e" body1="crank" body2="lower" anchor="0 0 0.1"/>', ["b"]),
        ('<weld name="e" site1="s0" site2="s1"/>', []),
        ('<connect name="e" body1="crank" body2="upper" anchor="0 0 0.1"/>', []),
    ],
)
def test_a_loop_of_the_arm_is_refused(tmp_path: Path, equality: str, joints: list[str]) -> None:
    """Loops of frozen joints, as in the linkage of a finger, are rigid and noted."""
    file = write_loop(tmp_path, equality)
    if joints:
        over = ", ".join(map(repr, joints))
        weld = " ".join(f"--weld {name}" for name in joints)
        with pytest.raises(InputError, match=f"'e' .* closes a loop over joint {over}: .*{weld}$"):
            take(file, tmp_path, tip="tcp")
        made, _ = take(file, tmp_path, tip="tcp", weld=tuple(joints))
    else:
        made, _ = take(file, tmp_path, tip="tcp")
    left = [name for name in ("a", "b") if name not in joints]
    assert made.joints == left
    assert any(note.startswith("left out: equality 'e'") for note in made.notes)


def test_other_equalities_close_no_loop(tmp_path: Path) -> None:
    off = '<connect name="e" body1="lower" body2="quad" anchor="0 0 0.1" active="false"/>'
    assert take(write_loop(tmp_path, off), tmp_path / "off", tip="tcp")[0].joints == ["a", "b"]
    rope = '<connect name="e" body1="lower" body2="table" anchor="0 0 0.1"/>'
    table = '<body name="table"><geom size="0.1"/></body>'
    made, _ = take(write_loop(tmp_path, rope, table), tmp_path / "rope", tip="tcp")
    assert made.joints == ["a", "b"]
    assert any("of which one does not belong to the robot" in note for note in made.notes)


def test_a_tendon_that_couples_joints_of_the_arm_is_refused(tmp_path: Path) -> None:
    """MuJoCo keeps its length: one joint follows the other."""
    file = write_loop(tmp_path, '<tendon name="e" tendon1="t"/>')
    joints = '<joint joint="a" coef="1"/><joint joint="b" coef="1"/>'
    fixed = f'<tendon><fixed name="t">{joints}</fixed></tendon>'
    file.write_text(file.read_text().replace("</mujoco>", f"{fixed}</mujoco>"))
    says = r"quad.xml: equality 'e' of tendon 't' constrains joint 'a', 'b' .*--weld a --weld b$"
    with pytest.raises(InputError, match=says):
        take(file, tmp_path, tip="tcp")
    made, _ = take(file, tmp_path, tip="tcp", weld=("a", "b"))
    assert made.joints == []
    assert any(note.startswith("left out: equality 'e' of tendon 't'") for note in made.notes)


@pytest.mark.parametrize(("tendon", "joints"), [
    ('<spatial name="t" limited="true" range="0 1"><site site="s0"/><site site="end"/></spatial>',
     "'a', 'b'"),
    ('<fixed name="t"><joint joint="b" coef="1"/></fixed>', "'b'"),
    ('<fixed name="t"><joint joint="c" coef="1"/></fixed>', ""),
])  # fmt: skip
def test_a_tendon_that_moves_the_arm_is_noted(tmp_path: Path, tendon: str, joints: str) -> None:
    file = write_loop(tmp_path, "")
    text = file.read_text().replace('<body name="tcp"', '<site name="end"/><body name="tcp"')
    file.write_text(text.replace("</mujoco>", f"<tendon>{tendon}</tendon></mujoco>"))
    made, _ = take(file, tmp_path, tip="tcp")
    notes = [note for note in made.notes if "tendon" in note]
    says = f"left out: tendon 't' of joint {joints}, with its limits, springs and actuators"
    assert notes == ([says] if joints else [])


def test_a_joint_that_an_equality_holds_is_frozen_where_mujoco_holds_it(tmp_path: Path) -> None:
    """Its position is `ref` plus the first number of `polycoef`."""
    held = '<joint name="e" joint1="b" polycoef="0.3 0 0 0 0" solref="0.002 1"/>'
    file = write_loop(tmp_path, held)
    file.write_text(file.read_text().replace('name="b" axis', 'name="b" ref="10" axis'))
    made, robot = take(file, tmp_path, tip="tcp")
    assert made.joints == ["a"]
    at = 0.3 + np.radians(10.0)
    assert f"joint b is frozen: an equality holds it at {at:.6g}" in made.notes
    text = re.sub("<(mesh|texture|material|geom class)[^>]*>", "", file.read_text())  # no files
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 2000)
    b = model.joint("b").qposadr[0]
    assert data.qpos[b] == pytest.approx(at, abs=1e-3)
    # the tip in the frame of the first link's joint, joint a at zero
    data.qpos[7:] = 0.0
    data.qpos[b], data.qpos[:7] = at, [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    tip, _ = compute_tip(build_body_model(robot), np.zeros(1))
    np.testing.assert_allclose(tip, data.body("tcp").xpos, atol=1e-9)


def test_an_equality_with_a_joint_of_another_body_is_noted(tmp_path: Path) -> None:
    table = '<body name="table"><joint name="far"/><geom size="0.1"/></body>'
    file = write_loop(tmp_path, '<joint name="e" joint1="a" joint2="far"/>', table)
    made, _ = take(file, tmp_path, tip="tcp")
    assert made.joints == ["a", "b"]
    assert "left out: equality 'e', of which a part does not belong to the robot" in made.notes


@pytest.mark.parametrize(("part", "says"), [
    ("<static>true</static>", "left out: <static> of the model, which does not move in the file"),
    ('<joint name="stand" type="fixed"><parent>world</parent><child>base</child></joint>',
     "left out: joint 'stand' between the world and link 'base'"),
])  # fmt: skip
def test_what_holds_a_model_of_sdf_in_the_world_is_noted(
    tmp_path: Path, part: str, says: str
) -> None:
    file = models.write_hexa(tmp_path, ("</model>", f"{part}</model>"))
    made, _ = take(file, tmp_path)
    assert says in made.notes


def write_propellers(folder: Path, name: str, more: str = "") -> Path:
    """A hexarotor with a spinning propeller at each motor; `name` of the joints, with {i}."""
    file = write_tilting(folder, "mjcf", "fixed")
    text = file.read_text()
    for i in range(6):
        joint = f'<joint {name.format(i=i)} axis="0 0 {(-1) ** i}"/>'
        text = text.replace(f'<site name="s{i}"', f'{joint}<site name="s{i}"')
    file.write_text(text.replace('<site name="s5"/>', f'<site name="s5"/>{more}'))
    return file


@pytest.mark.parametrize("name", ['name="spin{i}"', ""])
def test_joints_that_turn_propellers_are_frozen(tmp_path: Path, name: str) -> None:
    """Motors act on sites of the propellers; an arm keeps its joints."""
    file = write_propellers(tmp_path, name)
    made, robot = take(file, tmp_path)
    names = [f"spin{i}" if name else f"joint of hub{i}" for i in range(6)]
    assert made.joints == []
    assert f"joint {', '.join(names)} is frozen: it turns a propeller only" in made.notes
    rotors = build_rotors(robot.rotors)
    np.testing.assert_allclose(rotors.position[:, :2], PLACES, atol=1e-9)
    np.testing.assert_allclose(rotors.axis, np.tile([0.0, 0.0, 1.0], (6, 1)), atol=1e-9)
    _, fixed = take(write_tilting(tmp_path / "fixed", "mjcf", "fixed"), tmp_path / "fixed")
    assert robot.platform == fixed.platform
    arm = {"arm": models.urdf_arm(tmp_path), "mount": "0.05,0,-0.05,180,0,0"}
    made, _ = take(write_propellers(tmp_path, name), tmp_path / "arm", **arm)
    assert made.joints == [f"arm/joint{i}" for i in range(1, 5)]


def test_a_joint_that_turns_more_than_a_propeller_is_not_frozen(tmp_path: Path) -> None:
    """Below the rotor hangs a link with a joint of its own."""
    knee = '<joint name="knee" axis="0 1 0" range="-1 1"/>'
    limb = f'<body name="limb" pos="0 0 -.1">{knee}{MASS}</body>'
    made, _ = take(write_propellers(tmp_path, 'name="spin{i}"', limb), tmp_path)
    assert made.joints == ["spin5", "knee"]
