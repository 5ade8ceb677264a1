"""A robot as PX4's parameters: the geometry that PX4 rebuilds is that of the robot."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

from skywright.cli import main
from skywright.description.robot.loader import list_robots, load_robot
from skywright.description.world.loader import load_world
from skywright.errors import InputError
from skywright.links.px4.gains import compute_gains, compute_torque_units
from skywright.links.px4.parameters import (
    build_airframe,
    format_environment,
    format_file,
    format_script,
    list_parameters,
)
from skywright.models.nominal import Nominal

WORLD = load_world("open")[0]
ROBOTS = [entry.name for entry in list_robots()]
FLIP = np.array([1.0, -1.0, -1.0])


def rebuild(values: dict[str, float]) -> np.ndarray:
    """Return (6, n) torque and thrust in FRD per newton as ActuatorEffectivenessRotors does."""
    columns = []
    for i in range(int(values["CA_ROTOR_COUNT"])):
        p = np.array([values[f"CA_ROTOR{i}_P{c}"] for c in "XYZ"])
        a = np.array([values[f"CA_ROTOR{i}_A{c}"] for c in "XYZ"])
        a /= np.linalg.norm(a)
        torque = np.cross(p, a) - values[f"CA_ROTOR{i}_KM"] * a
        columns.append(np.concatenate([torque, a]))
    return np.array(columns).T


def test_rotors_that_lift_only_together_with_others_that_push_down_are_refused() -> None:
    with pytest.raises(InputError, match="at equal thrust do not lift it"):
        build_airframe(load_robot("omnicopter", [])[0], WORLD)


@pytest.mark.parametrize("name", [name for name in ROBOTS if name != "omnicopter"])
def test_px4_rebuilds_the_wrench_map_of_every_robot(name: str) -> None:
    robot = load_robot(name, [])[0]
    values = {p.name: float(p.value) for p in list_parameters(robot, WORLD)}
    rotors, airframe = Nominal(robot, WORLD).rotors, build_airframe(robot, WORLD)
    rebuilt = rebuild(values)
    force, torque = rotors.B[:3], rotors.B[3:] - np.cross(airframe.p_BC, rotors.axis).T
    np.testing.assert_allclose(rebuilt[3:], force * FLIP[:, None], atol=1e-12)
    np.testing.assert_allclose(rebuilt[:3], torque * FLIP[:, None], atol=1e-12)
    # hover: these commands carry the weight and turn nothing
    thrust = np.linalg.pinv(rebuilt) @ np.array([0, 0, 0, 0, 0, -airframe.mass * 9.81])
    share = thrust / rotors.thrust_max
    assert np.mean(share) == pytest.approx(values["MPC_THR_HOVER"], rel=0.02)


def test_a_torque_unit_is_what_px4s_normalised_mixer_makes() -> None:
    robot = load_robot("hexarotor", [])[0]
    rotors = Nominal(robot, WORLD).rotors
    B, most = rotors.B, rotors.thrust_max
    units = compute_torque_units(B, most)
    mix = np.linalg.pinv(np.vstack([B[3:], B[:3]]) * 6.5)
    for axis in range(3):
        # the norm over half of the rotors that have a lever (six about roll, four about pitch),
        # the larger of both for both; about yaw the largest entry
        sizes = np.sqrt([np.sum(mix[:, 0] ** 2) / 3.0, np.sum(mix[:, 1] ** 2) / 2.0])
        scale = sizes.max() if axis < 2 else mix[:, 2].max()
        share = mix[:, axis] / scale  # of the thrust, for one unit
        made = B[3:] @ (share * most)
        assert made[axis] == pytest.approx(units[axis], rel=1e-9)
        assert np.abs(np.delete(made, axis)).max() < 1e-9


def test_rate_gains_damp_the_loop_with_its_lag() -> None:
    inertia, units, lag = np.array([0.3, 0.2, 0.4]), np.array([20.0, 20.0, 3.0]), 0.05
    gains = compute_gains(inertia, units, lag)
    gain = gains.rate_p * units / inertia  # rad/s: the crossover
    damping = 0.5 / np.sqrt(gain * (lag + 0.012))
    np.testing.assert_allclose(damping, [0.7071, 0.7071, 1.0], rtol=1e-3)
    assert np.all(gains.attitude_p < 0.5 * gain)


def test_formats_hold_every_parameter_and_their_types() -> None:
    listed = list_parameters(load_robot("othex", [])[0], WORLD)
    assert len({p.name for p in listed}) == len(listed)
    assert all(len(p.name) <= 16 for p in listed)  # MAVLink's parameter names
    rows = [r.split("\t") for r in format_file(listed, "x").splitlines() if r[0] != "#"]
    assert [r[2] for r in rows] == [p.name for p in listed]
    for row, p in zip(rows, listed, strict=True):
        assert row[4] == ("6" if isinstance(p.value, int) else "9")
        assert float(row[3]) == pytest.approx(p.value, rel=1e-6, abs=1e-9)
    assert format_environment(listed, "x").count("export PX4_PARAM_") == len(listed)
    assert format_script(listed, "x").count("param set ") == len(listed)


def test_a_world_with_satellites_gives_px4_satellites() -> None:
    world = WORLD.model_copy(update={"localisation": "gnss"})
    robot = load_robot("hexarotor", [])[0]
    capture = {p.name: p.value for p in list_parameters(robot, WORLD)}
    satellites = {p.name: p.value for p in list_parameters(robot, world)}
    assert (capture["EKF2_GPS_CTRL"], capture["EKF2_HGT_REF"]) == (0, 3)
    assert (satellites["EKF2_EV_CTRL"], satellites["EKF2_HGT_REF"]) == (0, 1)
    assert satellites["EKF2_GPS_DELAY"] == pytest.approx(110.0)


def test_a_robot_too_heavy_for_px4_is_refused_with_the_number() -> None:
    robot = load_robot("hexarotor", [("robot.platform.mass_kg", 11.5)])[0]
    with pytest.raises(InputError, match=r"hovers at 0\.8\d of its thrust"):
        list_parameters(robot, WORLD)


def test_the_command_prints_parameters_and_starts_nothing() -> None:
    out = CliRunner().invoke(main, ["sitl", "hexarotor", "--params", "script"])
    assert out.exit_code == 0, out.output
    assert "param set CA_ROTOR_COUNT 6" in out.output
    out = CliRunner().invoke(main, ["sitl", "hexarotr", "--params", "script"])
    assert out.exit_code == 2 and "hexarotor" in out.output
