"""Thrusts of rotors that MJCF describes as actuators at sites, compared with MuJoCo."""

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
from skywright.models.rotors import build_rotors

PLACES = [(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]


def write_quad(folder: Path, actuator: str, torque: float = 0.02) -> Path:
    """A quadrotor of 1.5 kg; `actuator` are the attributes of its actuators, {i} their number.

    {gear} is a gear of thrust and drag torque.
    """
    sites = "".join(f'<site name="s{i}" pos="{x} {y} .05"/>' for i, (x, y) in enumerate(PLACES))
    drives = "".join(
        f'<general site="s{i}" {actuator.format(i=i, gear=f"0 0 1 0 0 {torque * (-1) ** (i + 1)}")}/>'
        for i in range(4)
    )
    return models.write(
        folder / "quad.xml",
        f"""<mujoco><compiler autolimits="true"/><worldbody><body name="base"><freejoint/>
<inertial pos="0 0 0" mass="1.5" diaginertia="0.02 0.03 0.04"/>{sites}
<site name="fix" euler="30 0 0"/></body></worldbody><actuator>{drives}</actuator></mujoco>""",
    )


def take(file: Path, tmp_path: Path, **given: Any) -> tuple[Imported, Any]:
    made = import_robot(Request(file, **({"assume": True} | given)), tmp_path / "made")
    return made, load_robot(made.path)[0]


def measure(file: Path) -> list[float]:
    """Least and largest force (N) along z that MuJoCo's first rotor makes at rest."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    forces = []
    for control in np.linspace(-20.0, 20.0, 9 if model.na else 81):
        mujoco.mj_resetData(model, data)
        data.ctrl[0] = control
        for _ in range(500 if model.na else 0):  # until the activation is at rest
            mujoco.mj_step(model, data)
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        forces.append(float(data.actuator_force[0] * model.actuator_gear[0, 2]))
    return [min(forces), max(forces)]


@pytest.mark.parametrize("actuator", [
    'gear="{gear}" ctrlrange="0 12" forcerange="0 6"',
    'gear="{gear}" ctrlrange="0 1" gainprm="12" biastype="affine" biasprm="3 0 0"',
    'gear="{gear}" ctrlrange="0.1 1" gainprm="12" biastype="affine" biasprm="3 0 0" forcerange="0 9"',
    'gear="{gear}" ctrlrange="0 12" biasprm="3 0 0"',  # without biastype, no bias
    'gear="{gear}" ctrlrange="0 1" gaintype="affine" gainprm="12 5 0"',  # the length is zero
    'gear="0 0 2 0 0 {i}" ctrlrange="0.2 4" forcerange="1 3"',
    'gear="{gear}" ctrlrange="-12 -1" gainprm="-1"',
    'gear="{gear}" forcerange="0.5 6"',
    'gear="{gear}" ctrlrange="0 12" dyntype="filter" dynprm="0.05" actlimited="true" actrange="1 7"',
])  # fmt: skip
def test_thrusts_are_those_of_mujoco_at_rest(tmp_path: Path, actuator: str) -> None:
    actuator = actuator.replace("0 0 {i}", "0 0 0.04") if "{i}" in actuator else actuator
    file = write_quad(tmp_path, actuator)
    _, robot = take(file, tmp_path, answers={"robot.rotors.spin": ["ccw", "cw"] * 2})
    span = [robot.rotors.thrust_min_n, robot.rotors.thrust_max_n]
    assert span == pytest.approx(measure(file))
    assert robot.rotors.torque_per_thrust_m == pytest.approx(0.02)
    assert load_robot(tmp_path / "made" / "robot.toml")[1]["robot.rotors.thrust_max_n"].kind == (
        "imported"
    )


def test_a_thrust_whose_control_is_negative_points_where_mujoco_pushes(tmp_path: Path) -> None:
    file = write_quad(tmp_path, 'gear="{gear}" ctrlrange="-12 0"')
    file.write_text(file.read_text().replace('gear="0 0 1 0 0', 'gear="0 0 -1 0 0'))
    _, robot = take(file, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    data.ctrl[0] = -12.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[2] == pytest.approx(12.0)
    assert data.qfrc_actuator[5] > 0.0  # on the body: the propeller turns cw
    assert (robot.rotors.thrust_min_n, robot.rotors.thrust_max_n) == (0.0, 12.0)
    np.testing.assert_allclose(robot.rotors.alpha_deg, 0.0, atol=1e-9)
    assert robot.rotors.spin == ["cw", "ccw", "cw", "ccw"]


@pytest.mark.parametrize("kind", ["filter", "filterexact"])
def test_the_lag_of_an_actuator_is_that_of_its_filter(tmp_path: Path, kind: str) -> None:
    """MuJoCo's force reaches 63 % of a step after `dynprm`; the attitude loop follows from it."""
    file = write_quad(tmp_path, f'gear="{{gear}}" ctrlrange="0 12" dyntype="{kind}" dynprm="0.12"')
    _, robot = take(file, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep = 1e-4
    data = mujoco.MjData(model)
    data.ctrl[:] = 12.0
    while data.actuator_force[0] < 12.0 * (1.0 - np.exp(-1.0)):
        mujoco.mj_step(model, data)
    assert robot.rotors.time_constant_s == pytest.approx(data.time, rel=5e-3) == 0.12
    sources = load_robot(tmp_path / "made" / "robot.toml")[1]
    assert sources["robot.rotors.time_constant_s"].kind == "imported"
    assert robot.control.attitude_bandwidth_rad_s == 3.0


@pytest.mark.parametrize(("actuator", "says"), [
    ('gear="{gear}" ctrlrange="-12 12"', "left out: thrust below zero (the file has -12 N)"),
    ('gear="{gear}" ctrlrange="0 12" biastype="affine" biasprm="0 0 -.1"',
     "left out: thrust that depends on the velocity"),
])  # fmt: skip
def test_what_a_rotor_cannot_do_is_noted(tmp_path: Path, actuator: str, says: str) -> None:
    made, robot = take(write_quad(tmp_path, actuator), tmp_path)
    assert sum(note.startswith(says) for note in made.notes) == 1
    assert (robot.rotors.thrust_min_n, robot.rotors.thrust_max_n) == (0.0, 12.0)


@pytest.mark.parametrize(("actuator", "says"), [
    ('refsite="fix" gear="{gear}" ctrlrange="0 12"',
     r"quad.xml: actuator of site 's0' has the refsite 'fix', so .*; give the rotors with --rotor"),
    ('name="m{i}" gear="{gear}" ctrlrange="0 12" dyntype="integrator" actrange="0 3"',
     r"quad.xml: actuator 'm0' has dyntype integrator, .*valid for rotors: dyntype none, filter"),
])  # fmt: skip
def test_actuators_that_are_no_rotors_are_named(tmp_path: Path, actuator: str, says: str) -> None:
    file = write_quad(tmp_path, actuator)
    with pytest.raises(InputError, match=says):
        take(file, tmp_path)
    assert not (tmp_path / "made").exists()
    given = tuple(f"{x},{y},.05,{'ccw' if i % 2 else 'cw'}" for i, (x, y) in enumerate(PLACES))
    assert take(file, tmp_path, rotors=given)[0].rotors == 4


def test_the_net_force_of_a_refsite_on_the_same_body_is_zero(tmp_path: Path) -> None:
    """The reason for refusing it."""
    file = write_quad(tmp_path, 'refsite="fix" gear="{gear}" ctrlrange="0 12"')
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    data.ctrl[:] = 3.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[:3], 0.0, atol=1e-12)


def test_an_actuator_of_several_controls_does_not_shift_those_of_others(tmp_path: Path) -> None:
    """MuJoCo lists the limits of controls by control, and other limits by actuator."""
    file = write_quad(tmp_path, 'gear="{gear}" ctrlrange="0.5 12"')
    wrist = """<body><joint name="j"/><geom size=".1" mass=".1" pos=".1 0 0"/></body></body>"""
    text = file.read_text().replace("</body></worldbody>", f"{wrist}</worldbody>")
    file.write_text(text.replace("<actuator>", '<actuator><pid joint="j" forcerange="-2 2"/>'))
    model = mujoco.MjModel.from_xml_path(str(file))
    assert model.nu > model.nactuator
    _, robot = take(file, tmp_path)
    assert (robot.rotors.thrust_min_n, robot.rotors.thrust_max_n) == (0.5, 12.0)
    assert [servo.stall_torque_nm for _, servo in list_servos(robot)] == [2.0]


def test_a_negative_moment_constant_turns_the_yaw_torque(tmp_path: Path) -> None:
    """Gazebo's drag torque on the body is -direction * thrust * momentConstant."""
    file = models.write_hexa(tmp_path)
    _, plain = take(file, tmp_path / "plain")
    file.write_text(file.read_text().replace("<momentConstant>", "<momentConstant>-"))
    made, robot = take(file, tmp_path)
    directions = np.array([1.0 if i % 2 else -1.0 for i in range(6)])  # write_hexa: cw, ccw, ...
    for told, constant in ((plain, models.KM), (robot, -models.KM)):
        rotors = build_rotors(told.rotors)
        torque = -rotors.spin * rotors.torque_per_thrust
        np.testing.assert_allclose(torque, -directions * constant)
    assert any(
        note.startswith("momentConstant is negative: rotor_0, rotor_1") for note in made.notes
    )
