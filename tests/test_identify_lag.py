"""Lags of rotors and servos after the commands that they received: made logs, a flight."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from identify_log import fit
from identify_log import make_log as make_exact_log
from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.identify import Identification, identify
from skywright.analysis.identify.lag import Lag, fit_lag, fit_rotor_lag, fit_servos
from skywright.analysis.identify.load import build_log, filter_yaw
from skywright.analysis.identify.overrides import build_overrides
from skywright.description.loader import load_description
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import Link, World
from skywright.models.compliant_arms import count_command_ticks
from skywright.models.link_age import compute_mean_age
from skywright.planning.excitation import build_sines

ROBOT = load_robot("hexarotor")[0]
WORLD = load_description("waypoints").world
MASS, GRAVITY = 5.85, 9.81
TICK, SAMPLE = 0.002, 0.01  # s


def change(**rotors: Any) -> Robot:
    return ROBOT.model_copy(update={"rotors": ROBOT.rotors.model_copy(update=rotors)})


def at_rate(robot: Robot, rate: float) -> Robot:
    control = robot.control.model_copy(update={"rate_hz": rate})
    return robot.model_copy(update={"control": control})


def make_log(
    lag: float, seed: int, flown: Robot = ROBOT, robot: Robot = ROBOT, *,
    late: int = 0, autopilot: bool = False,
) -> FlightLog:  # fmt: skip
    """Return the log of a hover that heaves, rolls, pitches and yaws, with a noisy yaw torque.

    Rotors with drag torque kappa T and inertia J produce (1 + T_z s) times a yaw torque, with
    T_z = J / (2 kappa k_f Omega) at their speed Omega. The allocation sends 1 / (1 + T_z s) of it.
    A link delivers the commands `late` ticks after they were sent. An `autopilot` commands the
    rotors without a wrench.
    """
    r, rng = robot.rotors, np.random.default_rng(seed)
    n, tick = len(r.azimuth_deg), 1.0 / robot.control.rate_hz
    k_f, kappa = r.thrust_coefficient_n_per_rad2s2, r.torque_per_thrust_m
    hover = math.sqrt(MASS * GRAVITY / n / k_f)
    T_z = r.rotor_inertia_kgm2 / (2.0 * kappa * k_f * hover)
    assert T_z == pytest.approx(0.38 * math.sqrt(n / 6.0), abs=0.01)
    t = tick * np.arange(round(40.0 / tick))
    sizes = (2.0, 0.2, 0.2, 0.2)  # N, N m
    f_z, t_x, t_y, t_z = (
        a * build_sines(t, np.arange(0.15 + 0.04 * i, 1.2, 0.16), seed + i)
        for i, a in enumerate(sizes)
    )
    f_z = f_z + MASS * GRAVITY
    noise = lfilter([0.1], [1.0, -0.9], rng.standard_normal(len(t)))  # 10 ticks, 0.23 rms
    t_z = t_z + 0.3 * noise
    sent, share = np.zeros(len(t)), 1.0 - math.exp(-tick / T_z)
    for i in range(1, len(t)):
        sent[i] = sent[i - 1] + share * (t_z[i] - sent[i - 1])
    psi, R = np.radians(r.azimuth_deg), np.array(r.radii)
    spin = np.where(np.array(r.spin) == "ccw", 1.0, -1.0)
    B = np.vstack([np.ones(n), R * np.sin(psi), -R * np.cos(psi), -kappa * spin])
    thrust = np.column_stack([f_z, t_x, t_y, sent]) @ np.linalg.pinv(B).T
    assert thrust.min() > r.thrust_min_n and thrust.max() < r.thrust_max_n
    command = np.sqrt(thrust / k_f)
    got = np.vstack([np.repeat(command[:1], late, 0), command])[: len(t)]
    speed, decay = command.copy(), math.exp(-tick / lag)
    for i in range(1, len(t)):  # the speed at a tick follows from the command of the one before
        speed[i] = got[i - 1] + (speed[i - 1] - got[i - 1]) * decay
    zero = np.zeros(len(t))
    force, torque = np.column_stack([zero, zero, f_z]), np.column_stack([t_x, t_y, t_z])
    columns = {
        "t": t, "est_q_WB": np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)),
        "est_v_WB": np.zeros((len(t), 3)), "est_w_WB_B": np.zeros((len(t), 3)),
        "rotor_speed": speed, "q": zero[:, None], "qd": zero[:, None], "cmd_qd": zero[:, None],
        "cmd_f_B": force, "cmd_t_B": torque, "f_collision": zero,
        "f_contact": zero[:, None], "spring": zero,
    }  # fmt: skip
    if autopilot:
        full = math.sqrt(r.thrust_max_n / k_f)
        columns |= {"cmd_f_B": 0.0 * force, "cmd_t_B": 0.0 * torque}
        columns["autopilot_command"] = command / full
    world = with_link(delay_s=late * tick)
    return record(columns, robot, world, (), flown)


def with_link(**link: float) -> World:
    return WORLD.model_copy(update={"link": Link(**link)})


def record(
    columns: dict[str, np.ndarray], robot: Robot, world: World, joints: tuple[str, ...],
    flown: Robot | None = None,
) -> FlightLog:  # fmt: skip
    """Return the log of a recording with a sample each SAMPLE s of columns with a row each tick."""
    s = np.zeros(len(columns["t"]), [(n, "f8", x.shape[1:]) for n, x in columns.items()])
    for name, x in columns.items():
        s[name] = x
    s = s[:: round(SAMPLE * robot.control.rate_hz)]
    phases = np.where(s["t"] < 3.0, "take_off", "hover")  # the filter starts from 0
    return build_log("made", robot, world, s, phases, joints, flown)


@pytest.mark.parametrize("lag", [0.03, 0.05, 0.1])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_lag_of_rotors_that_turn_the_platform_by_their_spin_up(lag: float, seed: int) -> None:
    """The interval holds the rotors' lag, which is a tenth of that of the commanded yaw torque."""
    check_lag(make_log(lag, seed), lag)


def test_commands_that_the_rotors_did_not_receive_identify_no_lag() -> None:
    """As without the filter of the yaw torque: each axis then has a lag of its own."""
    found = fit_rotor_lag(make_log(0.05, 1, change(rotor_inertia_kgm2=1e-9)))
    assert found is not None and not found.identified and math.isnan(found.lag)
    assert re.match(r"at most \d+ ms in one combination of the drives and at least", found.reason)
    assert "not those that the drives received" in found.reason


def check_lag(log: FlightLog, lag: float = 0.05) -> None:
    found = fit_rotor_lag(log)
    assert found is not None and found.identified, found
    assert abs(found.lag - lag) <= found.half_lag < 0.004
    assert found.gain == pytest.approx(1.0, abs=0.01)


def test_a_command_is_held_for_a_control_tick() -> None:
    """At 100 Hz it acts 5 ms after its sample, more than the half width of the lag."""
    slow = at_rate(ROBOT, 100.0)
    check_lag(make_log(0.05, 1, slow, slow))


@pytest.mark.parametrize("late", [5, 10])
def test_the_delay_of_the_link_is_not_the_rotors_lag(late: int) -> None:
    check_lag(make_log(0.05, 1, late=late))


def test_rotors_receive_the_commands_of_an_autopilot() -> None:
    """The law's wrench is then zero, and no link is between the autopilot and the rotors."""
    log = make_log(0.05, 1, autopilot=True)
    check_lag(log)
    assert log.rotor_command is not None and log.rotor_speed is not None
    assert np.mean(log.rotor_command) == pytest.approx(np.mean(log.rotor_speed), rel=1e-3)


def test_a_robot_with_eight_rotors() -> None:
    eight = change(
        azimuth_deg=[22.5 + 45.0 * i for i in range(8)], spin=["ccw", "cw"] * 4,
        alpha_deg=[0.0] * 8, beta_deg=[0.0] * 8,
    )  # fmt: skip
    check_lag(make_log(0.05, 1, eight, eight))


def test_mean_delay_of_a_link() -> None:
    """Rounded up to ticks; lost packets add p / (1 - p) ticks; late ones hold up those behind.

    With normal delays x, the newest packet is older than n ticks h if one that was sent j >= n
    ticks ago is still in transit: 1 - prod P(x <= j h).
    """
    for delay, found in ((0.0, 0.0), (0.003, 0.004), (0.02, 0.02)):
        assert compute_mean_age(Link(delay_s=delay), TICK) == pytest.approx(found, abs=1e-9)
    lossy = compute_mean_age(Link(loss_fraction=0.5), TICK)
    assert lossy == pytest.approx(TICK, abs=1e-9)
    ticks = np.arange(60)
    arrived = stats.norm.cdf(TICK * ticks, 0.05, 0.008)
    older = [1.0 - np.prod(arrived[n:]) for n in ticks]
    jitter = compute_mean_age(Link(delay_s=0.05, jitter_s=0.008), TICK)
    assert jitter == pytest.approx(TICK * np.sum(older), abs=1e-6) and jitter > 0.055


def test_mean_delay_with_lost_and_late_packets_is_that_of_simulated_ones() -> None:
    link, n = Link(delay_s=0.004, jitter_s=0.003, loss_fraction=0.3), 200_000
    rng = np.random.default_rng(4)
    sent, kept = TICK * np.arange(n), rng.random(n) >= link.loss_fraction
    delay = np.maximum(link.delay_s + link.jitter_s * rng.standard_normal(n), 0.0)
    arrival = np.maximum.accumulate((sent + delay)[kept])
    newest = np.searchsorted(arrival, sent[100:] + 1e-9, side="right") - 1
    age = float(np.mean(sent[100:] - sent[kept][newest]))
    assert compute_mean_age(link, TICK) == pytest.approx(age, abs=1e-4)


def make_servo_log(command: str, every: int, tau: float, late: int) -> FlightLog:
    """Return a log of a drive that holds commands for `every` ticks, `late` ticks after they were
    sent, and follows with the lag `tau` s. Shaft angles are recorded before the servo's update."""
    robot = load_robot("ars-lrm" if command == "cmd_theta" else "f550-bridge")[0]
    positioned, tick = command == "cmd_theta", 1.0 / robot.control.rate_hz
    assert count_command_ticks(robot) == every if positioned else every == 1
    joints = tuple(limb.name for limb in list_joints(robot))
    t = tick * np.arange(round(40.0 / tick))
    sent = 0.3 * build_sines(t, np.arange(0.1, 1.2, 0.1), 1)
    held, y = np.zeros(len(t)), np.zeros(len(t))
    seen, decay = sent.copy(), math.exp(-tick / tau)
    for i in range(len(t) - 1):
        if positioned:
            seen[i] = held[i - 1] if i else 0.0
        held[i] = sent[max(i - late, 0)] if i % every == 0 else held[i - 1]
        y[i + 1] = held[i] + (y[i] - held[i]) * decay
    all_joints, zero, k = np.ones((1, len(joints))), np.zeros(len(t)), (len(t), 3)
    columns = {
        "t": t, "est_q_WB": np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), "est_v_WB": np.zeros(k),
        "est_w_WB_B": np.zeros(k), "rotor_speed": np.ones((len(t), 8)) * 400.0,
        "q": 0.0 * all_joints * zero[:, None], "cmd_qd": seen[:, None] * all_joints,
        "qd": y[:, None] * all_joints, "cmd_theta": seen[:, None] * all_joints,
        "theta": y[:, None] * all_joints, "cmd_f_B": np.zeros(k), "cmd_t_B": np.zeros(k),
        "f_collision": zero, "f_contact": zero[:, None], "spring": zero,
    }  # fmt: skip
    world = with_link(delay_s=0.0 if positioned else late * tick)
    return record(columns, robot, world, joints)


@pytest.mark.parametrize(
    ("command", "every", "late"), [("cmd_qd", 1, 0), ("cmd_qd", 1, 10), ("cmd_theta", 10, 0)]
)
def test_lag_of_a_servo_that_holds_its_commands(command: str, every: int, late: int) -> None:
    """Speeds act half a tick after their sample. Angles that are held for 20 ms are 10 or 20 ms old
    in samples each 10 ms, which is 5 ms more than the mean delay of the hold."""
    for servo in fit_servos(make_servo_log(command, every, 0.06, late)):
        assert servo.identified, servo
        assert servo.lag == pytest.approx(0.06, abs=5e-4)


def test_samples_near_excluded_ones_do_not_count() -> None:
    """A short disturbance reaches through the filter to the samples around it."""
    t = np.arange(0.0, 40.0, 0.01)
    u = build_sines(t, np.arange(0.1, 1.5, 0.1), 0)
    y, decay = np.zeros_like(u), math.exp(-0.01 / 0.07)
    for i in range(1, len(t)):
        y[i] = u[i - 1] + (y[i - 1] - u[i - 1]) * decay
    use = np.ones(len(t), dtype=bool)
    whole = fit_lag("drive", "", t, u, y, use)
    for start in (10.0, 22.0):
        hit = (t >= start) & (t < start + 0.3)
        use[hit], y[hit] = False, 5.0
    part = fit_lag("drive", "", t, u, y, use)
    assert part.identified and part.lag == pytest.approx(whole.lag, abs=5e-4)


def test_a_wide_interval_is_told_with_the_lag() -> None:
    """A drive with slow noise follows its command, but the lag is not known well."""
    t, rng = np.arange(0.0, 40.0, 0.01), np.random.default_rng(0)
    u = build_sines(t, np.arange(0.1, 1.0, 0.1), 0)
    noise = 0.15 * np.interp(t, np.arange(0.0, 41.0, 0.3), rng.standard_normal(137))
    lag = fit_lag("drive", "", t, u, u - 0.005 * np.gradient(u, t) + noise, use=t >= 0.0)
    assert not lag.identified
    assert re.fullmatch(
        r"it moved too little: gain 1\.0\d \+- 0\.0\d, lag -?[\d.]+ \+- [\d.]+ ms", lag.reason
    )


def test_the_file_has_one_lag_of_the_rotors() -> None:
    """Of flights with speeds and flights with commands alone: that of the speeds."""
    made = make_exact_log(30.0)
    lag = Lag("rotors", "rad/s", True, "", 1.0, 0.01, 0.034, 0.001, 0.0, 0.99)
    found = Identification(
        made.robot, ["a", "b"], [], fit(made), made.q[:1], made.joints, lag, 0.06, [], True, []
    )
    for both, value in ((found, 0.034), (found._replace(rotor_lag=None), 0.06)):
        text = build_overrides(both, "f550-bridge")
        rotors = tomllib.loads(text)["robot"]["rotors"]
        assert rotors["time_constant_s"]["value"] == value


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

    run = skywright.run(skywright.load("waypoints", seed=2), out=tmp_path / "flown", report=False)
    assert run.outcome == "succeeded"
    given = change(time_constant_s=0.2, rotor_inertia_kgm2=2e-4)
    for robot in (None, given):
        found = identify([tmp_path / "flown"], robot, 6.03)
        lag = found.rotor_lag
        assert lag is not None and lag.identified, lag
        assert abs(lag.lag - 0.05) <= lag.half_lag < 0.01
        assert f"time_constant_s = {{ value = {lag.lag:.6g}" in build_overrides(found, "hexarotor")
