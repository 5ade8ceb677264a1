"""Limits of imported joints and rotors that a file omits, or that are not what they seem."""

# ruff: noqa: E501

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import imported_models as models
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.loader import load_robot
from skywright.models.importing.importer import Imported, Request, import_robot


def take(file: Path, tmp_path: Path, **given: Any) -> tuple[Imported, Any]:
    made = import_robot(Request(file, **({"assume": True} | given)), tmp_path / "made")
    return made, load_robot(made.path)[0]


def notes_of(made: Imported, word: str) -> list[str]:
    return [note for note in made.notes if word in note]


@pytest.mark.parametrize(("joint", "most"), [("shoulder", "180 deg"), ("rail", "0.1 m")])
def test_a_joint_of_urdf_without_limits_moves_and_is_noted(
    tmp_path: Path, joint: str, most: str
) -> None:
    """URDF's default is 0 and 0; a joint that shall not move is written as `fixed`."""
    file = models.write_urdf_quad(tmp_path)
    head, name, rest = file.read_text().partition(f'<joint name="{joint}"')
    file.write_text(head + name + re.sub(r'lower="\S+" upper="\S+" ', "", rest, count=1))
    made, robot = take(file, tmp_path)
    assert made.joints == ["shoulder", "rail"]
    assert notes_of(made, "limit") == [
        f"joint {joint} has no lower and upper limit, which URDF reads as 0 and 0 (locked): "
        f"-{most} to {most} are assumed; --weld {joint} locks it"
    ]
    link_of = {"shoulder": "upper", "rail": "link_slider"}
    link = list_joints(robot)[made.joints.index(joint)].link
    ends = [key for key in load_robot(made.path)[1] if f".{link_of[joint]}.joint_m" in key]
    assert [load_robot(made.path)[1][key].kind for key in ends] == ["assumed"] * 2
    np.testing.assert_allclose(
        link.reach, np.array([-1, 1]) * (0.1 if link.joint == "slide" else np.pi)
    )
    again, _ = take(file, tmp_path / "locked", weld=(joint,))
    assert joint not in again.joints and not notes_of(again, "limit")


def test_continuous_joints_have_no_limits_without_a_note(tmp_path: Path) -> None:
    file = models.write_urdf_quad(tmp_path)
    text = file.read_text().replace(
        'name="shoulder" type="revolute"', 'name="shoulder" type="continuous"'
    )
    file.write_text(text)
    assert not notes_of(take(file, tmp_path)[0], "limit")


@pytest.mark.parametrize("kind", ["urdf", "sdf"])
def test_limits_in_degrees_are_suspected(tmp_path: Path, kind: str) -> None:
    """URDF and SDF have radians."""
    if kind == "urdf":
        file = models.write_urdf_quad(tmp_path)
        file.write_text(file.read_text().replace('"-1" upper="1.5"', '"-90" upper="90"'))
        made, robot = take(file, tmp_path)
        np.testing.assert_allclose(list_joints(robot)[0].link.reach, [-2 * np.pi, 2 * np.pi])
    else:
        arm = models.sdf_gripper(tmp_path)
        arm.write_text(re.sub("(<(low|upp)er>-?)1.5<", r"\g<1>90<", arm.read_text()))
        made, _ = take(models.write_quad(tmp_path), tmp_path, arm=arm, mount="0.1,0,-0.05,0,90,0")
    notes = notes_of(made, "are they in degrees?")
    assert len(notes) == 1
    assert "joint shoulder has limits of -90 and 90 rad, " in notes[0]


def test_rotors_whose_joints_turn_without_end_are_not_suspected(tmp_path: Path) -> None:
    assert not notes_of(take(models.write_hexa(tmp_path), tmp_path)[0], "degrees")


@pytest.mark.parametrize("efforts", [(40, 10), (10, 40)])
def test_the_weaker_finger_gives_the_force_of_a_gripper(
    tmp_path: Path, efforts: tuple[int, int]
) -> None:
    """Both fingers press on the same thing with the same force."""
    arm = models.sdf_gripper(tmp_path)
    left, right = arm.read_text().split('<joint name="slide1"')
    parts = [
        text.replace("<effort>12<", f"<effort>{effort}<")
        for text, effort in zip((left, right), efforts, strict=True)
    ]
    arm.write_text('<joint name="slide1"'.join(parts))
    made, robot = take(models.write_quad(tmp_path), tmp_path, arm=arm, mount="0.1,0,-0.05,0,90,0")
    assert robot.arm.hand.grip_force_n == 10.0
    assert notes_of(made, "of the gripper have") == [
        "joints arm/slide1 and arm/slide0 of the gripper have efforts of 10 and 40: the smaller one counts"
    ]


@pytest.mark.parametrize(("lag", "flies"), [(5.0, False), (0.08, False), (0.05, True)])
def test_a_lag_with_which_flights_fail_is_noted(tmp_path: Path, lag: float, flies: bool) -> None:
    """The robot of the first test of test_importing lost control at 0.08 s, and not at 0.05 s."""
    answers = {"robot.rotors.time_constant_s": lag}
    made, _ = take(models.write_quad(tmp_path), tmp_path, answers=answers)
    says = f"flights lose control: the rotors lag by {lag:g} s (robot.rotors.time_constant_s), "
    assert len(notes_of(made, says)) == (0 if flies else 1)
    file = models.write_hexa(tmp_path, ("<timeConstantUp>0.02<", f"<timeConstantUp>{lag}<"))
    assert len(notes_of(take(file, tmp_path / "hexa")[0], says)) == (0 if flies else 1)
