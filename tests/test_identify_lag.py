"""The rotors' lag where the allocation filters the commanded yaw torque: made logs, a flight."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.identify import identify
from skywright.analysis.identify.lag import fit_lag, fit_rotor_lag
from skywright.analysis.identify.load import build_log, filter_yaw
from skywright.analysis.identify.overrides import build_overrides
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.planning.excitation import build_sines

ROBOT = load_robot("hexarotor")[0]
MASS, GRAVITY = 5.85, 9.81
TICK, EVERY = 0.002, 5  # s; ticks a sample


def change(**rotors: float) -> Robot:
    return ROBOT.model_copy(update={"rotors": ROBOT.rotors.model_copy(update=rotors)})


def make_log(lag: float, seed: int, flown: Robot = ROBOT, duration: float = 40.0) -> FlightLog:
    """Return the log of a hover that heaves, rolls, pitches and yaws, with a noisy yaw torque.

    Rotors with drag torque kappa T and inertia J produce (1 + T_z s) times a yaw torque, with
    T_z = J / (2 kappa k_f Omega) at their speed Omega. The allocation sends 1 / (1 + T_z s) of it.
    """
    r, rng = ROBOT.rotors, np.random.default_rng(seed)
    k_f, kappa = r.thrust_coefficient_n_per_rad2s2, r.torque_per_thrust_m
    hover = math.sqrt(MASS * GRAVITY / 6.0 / k_f)
    T_z = r.rotor_inertia_kgm2 / (2.0 * kappa * k_f * hover)
    assert T_z == pytest.approx(0.38, abs=0.01)
    t = np.arange(0.0, duration, TICK)
    sizes = (2.0, 0.2, 0.2, 0.2)  # N, N m
    f_z, t_x, t_y, t_z = (
        a * build_sines(t, np.arange(0.15 + 0.04 * i, 1.2, 0.16), seed + i)
        for i, a in enumerate(sizes)
    )
    f_z = f_z + MASS * GRAVITY
    noise = lfilter([0.1], [1.0, -0.9], rng.standard_normal(len(t)))  # 20 ms, 0.23 rms
    t_z = t_z + 0.3 * noise
    sent, share = np.zeros(len(t)), 1.0 - math.exp(-TICK / T_z)
    for i in range(1, len(t)):
        sent[i] = sent[i - 1] + share * (t_z[i] - sent[i - 1])
    psi, R = np.radians(r.azimuth_deg), np.array(r.radii)
    spin = np.where(np.array(r.spin) == "ccw", 1.0, -1.0)
    B = np.vstack([np.ones(6), R * np.sin(psi), -R * np.cos(psi), -kappa * spin])
    thrust = np.column_stack([f_z, t_x, t_y, sent]) @ np.linalg.pinv(B).T
    assert thrust.min() > r.thrust_min_n and thrust.max() < r.thrust_max_n
    command = np.sqrt(thrust / k_f)
    speed, decay = command.copy(), math.exp(-TICK / lag)
    for i in range(1, len(t)):  # the speed at a tick follows from the command of the one before
        speed[i] = command[i - 1] + (speed[i - 1] - command[i - 1]) * decay
    zero = np.zeros(len(t))
    columns = {
        "t": t, "est_q_WB": np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)),
        "est_v_WB": np.zeros((len(t), 3)), "est_w_WB_B": np.zeros((len(t), 3)),
        "rotor_speed": speed, "q": zero[:, None], "qd": zero[:, None], "cmd_qd": zero[:, None],
        "cmd_f_B": np.column_stack([zero, zero, f_z]),
        "cmd_t_B": np.column_stack([t_x, t_y, t_z]), "f_collision": zero,
        "f_contact": zero[:, None], "spring": zero,
    }  # fmt: skip
    s = np.zeros(len(t), [(n, "f8", x.shape[1:]) for n, x in columns.items()])
    for name, x in columns.items():
        s[name] = x
    s = s[::EVERY]
    phases = np.where(s["t"] < 3.0, "take_off", "hover")  # the filter starts from 0
    return build_log("made", ROBOT, load_description("waypoints").world, s, phases, (), flown)


@pytest.mark.parametrize("lag", [0.03, 0.05, 0.1])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_lag_of_rotors_that_turn_the_platform_by_their_spin_up(lag: float, seed: int) -> None:
    """The interval holds the rotors' lag, which is a tenth of that of the commanded yaw torque."""
    found = fit_rotor_lag(make_log(lag, seed))
    assert found is not None and found.identified, found
    assert abs(found.lag - lag) <= found.half_lag < 0.004
    assert found.gain == pytest.approx(1.0, abs=0.01)


def test_commands_that_the_rotors_did_not_receive_identify_no_lag() -> None:
    """As without the filter of the yaw torque: each axis then has a lag of its own."""
    found = fit_rotor_lag(make_log(0.05, 1, change(rotor_inertia_kgm2=1e-9)))
    assert found is not None and not found.identified and math.isnan(found.lag)


@pytest.mark.parametrize("second", [0.05, 0.4])
def test_drives_with_different_lags_have_no_common_lag(second: float) -> None:
    t = np.arange(0.0, 60.0, 0.01)
    u = np.column_stack([build_sines(t, np.arange(0.1, 1.0, 0.1), k) for k in range(2)])
    y = np.zeros_like(u)
    decay = np.exp(-0.01 / np.array([0.05, second]))
    for i in range(1, len(t)):
        y[i] = u[i - 1] + (y[i - 1] - u[i - 1]) * decay
    lag = fit_lag("rotors", "rad/s", t, u, y, np.ones(len(t), dtype=bool))
    assert lag.identified == (second == 0.05), lag
    if lag.identified:
        assert lag.lag == pytest.approx(0.055, abs=1e-3)
    else:
        assert "in one combination of the drives and at least" in lag.reason


def test_errors_that_drives_share_do_not_shrink_the_interval() -> None:
    """Six drives with the same command, response and noise contain as much as one."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 40.0, 0.01)
    u = build_sines(t, np.arange(0.1, 1.0, 0.1), 0)
    y = u - 0.06 * np.gradient(u, t) + np.repeat(0.1 * rng.standard_normal(400), 10)
    use = np.ones(len(t), dtype=bool)
    one = fit_lag("one", "", t, u, y, use)
    six = fit_lag("six", "", t, *(np.tile(x[:, None], 6) for x in (u, y)), use)
    assert one.identified and six.identified
    assert six.half_lag == pytest.approx(one.half_lag, rel=0.02)
    assert six.lag == pytest.approx(one.lag, abs=1e-4)


def test_the_yaw_torque_is_filtered_at_the_control_rate() -> None:
    """Of a ramp the filter lags by T, less half a tick, at any interval of the samples."""
    t = np.arange(0.0, 6.0, 0.01)
    out = filter_yaw(t, t, 0.4, 0.002)
    assert t[-1] - out[-1] == pytest.approx(0.4 - 0.001, abs=1e-5)
    np.testing.assert_array_equal(filter_yaw(t, t, -0.05, 0.002), t)


def test_a_flight_of_a_coplanar_robot_gives_back_its_lag(tmp_path: Path) -> None:
    """The file that is given has another lag and inertia of the rotors: the run has its own."""
    import skywright

    run = skywright.run(skywright.load("waypoints", seed=2), out=tmp_path / "flown")
    assert run.outcome == "succeeded"
    given = change(time_constant_s=0.2, rotor_inertia_kgm2=2e-4)
    for robot in (None, given):
        found = identify([tmp_path / "flown"], robot, 6.03)
        lag = found.rotor_lag
        assert lag is not None and lag.identified, lag
        assert abs(lag.lag - 0.05) <= lag.half_lag < 0.01
        assert f"time_constant_s = {{ value = {lag.lag:.6g}" in build_overrides(found, "hexarotor")
