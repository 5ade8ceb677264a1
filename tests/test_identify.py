"""Identification against known truth: signals that obey the model exactly, ULog files, a flight."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import butter, sosfiltfilt

from exact_map import KNOWN
from skywright.analysis.identify.fit import INERTIA_AXES, Fit, fit_parameters
from skywright.analysis.identify.flight_log import FlightLog
from skywright.analysis.identify.identify import identify
from skywright.analysis.identify.lag import fit_lag
from skywright.analysis.identify.load import load_log
from skywright.analysis.identify.overrides import build_overrides
from skywright.analysis.identify.rotor_signals import build_mixer
from skywright.analysis.identify.signals import build_columns
from skywright.cli import main
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.models.rotors import build_rotors
from skywright.planning.excitation import Excitation, build_sines, plan_excitation, share_lines
from skywright.run.run import run_mission
from skywright.run.setup import Setup
from ulog_file import write_ulog

ROBOT = load_robot("f550-bridge")[0]
GRAVITY = 9.81
MASS = 2.6
GAIN = np.array([0.93, 0.98, 1.02, 0.95, 1.05, 0.99])
COM = np.array([0.006, -0.004, 0.010])
KAPPA, DRAG, SPIN_INERTIA = 0.0145, 1.6e-4, 2e-5
INERTIA = np.array([0.0560, 0.0620, 0.0740, 0.0006, -0.0035, -0.0004])


def _matrix(y: np.ndarray) -> np.ndarray:
    out = np.empty((3, 3))
    for value, (i, j) in zip(y, INERTIA_AXES, strict=True):
        out[i, j] = out[j, i] = value
    return out


def make_log(
    duration: float = 60.0, rate: float = 200.0, noise: float = 0.0, tilt: float = 0.06,
    push: float = 0.3, seed: int = 0,
) -> FlightLog:  # fmt: skip
    """Signals of a motion and the rotor speeds that the true robot needs for it, exactly.

    Attitude and velocity are sums of sines with derivatives in closed form, so that nothing of
    the code under test goes into the truth. `tilt` (rad) and `push` (m/s) are amplitudes.
    """
    t = np.arange(0.0, duration, 1.0 / rate)
    rng = np.random.default_rng(seed)

    def sines(size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        out = np.zeros((3, len(t), 3))
        for axis in range(3):
            for _ in range(5):
                w, phase = 2 * math.pi * rng.uniform(0.15, 1.2), rng.uniform(0, 2 * math.pi)
                a = size / 5
                out[0, :, axis] += a * np.sin(w * t + phase)
                out[1, :, axis] += a * w * np.cos(w * t + phase)
                out[2, :, axis] -= a * w * w * np.sin(w * t + phase)
        return out[0], out[1], out[2]

    angles, rates, seconds = sines(tilt)
    v, a, _ = sines(push)
    (r, p, y), (rd, pd, yd), (rdd, pdd, ydd) = angles.T, rates.T, seconds.T
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    R = np.empty((len(t), 3, 3))
    R[:, 0] = np.column_stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr])
    R[:, 1] = np.column_stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr])
    R[:, 2] = np.column_stack([-sp, cp * sr, cp * cr])
    # Euler rates to body rates, and their derivative
    w = np.column_stack([rd - sp * yd, cr * pd + sr * cp * yd, -sr * pd + cr * cp * yd])
    wd = np.column_stack(
        [
            rdd - sp * ydd - cp * pd * yd,
            cr * pdd + sr * cp * ydd - sr * rd * pd + (cr * cp * rd - sr * sp * pd) * yd,
            -sr * pdd + cr * cp * ydd - cr * rd * pd + (-sr * cp * rd - cr * sp * pd) * yd,
        ]
    )
    s = np.einsum("kji,kj->ki", R, a + [0.0, 0.0, GRAVITY])
    v_B = np.einsum("kji,kj->ki", R, v)
    h, I_B = MASS * COM, _matrix(INERTIA)
    force = MASS * s + np.cross(wd, h) + np.cross(w, np.cross(w, h))
    torque = wd @ I_B.T + np.cross(w, w @ I_B.T) + np.cross(h, s)
    rotors = build_rotors(ROBOT.rotors)
    lever = np.cross(rotors.position, rotors.axis) - KAPPA * rotors.spin[:, None] * rotors.axis
    B = np.vstack([rotors.axis.T, lever.T]) * GAIN
    area = np.array(
        [
            ROBOT.platform.drag_area_x_m2,
            ROBOT.platform.drag_area_y_m2,
            ROBOT.platform.drag_area_z_m2,
        ]
    )
    body = -0.5 * 1.2 * area * np.linalg.norm(v_B, axis=1, keepdims=True) * v_B
    T = np.full((len(t), 6), MASS * GRAVITY / 6)
    slow = butter(4, 6.0, fs=rate, output="sos")
    for _ in range(30):  # drag depends on the speeds that it asks for
        omega = np.sqrt(np.maximum(T, 0.01) / rotors.k_f)
        f, m = force - body, torque.copy()
        # momentum of the rotors in B; without the filter the sum would not converge
        spin = sosfiltfilt(slow, SPIN_INERTIA * (omega * rotors.spin) @ rotors.axis, axis=0)
        m += np.gradient(spin, t, axis=0, edge_order=2) + np.cross(w, spin)
        for i in range(6):
            air = v_B + np.cross(w, rotors.position[i])
            hub = (
                -DRAG
                * omega[:, i : i + 1]
                * (air - (air @ rotors.axis[i])[:, None] * rotors.axis[i])
            )
            f, m = f - hub, m - np.cross(rotors.position[i], hub)
        T = np.linalg.solve(B, np.hstack([f, m]).T).T
    assert T.min() > 0.2
    q = posture(ROBOT, "folded")
    n = (len(t), 3)
    return FlightLog(
        name="made", robot=ROBOT, t=t, free=np.ones(len(t), dtype=bool),
        v_WB=v + 0.2 * noise * rng.standard_normal(n), R_WB=R,
        w_WB_B=w + noise * rng.standard_normal(n), specific_force_B=None,
        rotor_speed=np.sqrt(T / rotors.k_f), rotor_command=None, command_is_thrust=False,
        joints=("shoulder", "elbow"), q=np.tile(q, (len(t), 1)), servo_unit="rad/s",
        servo_command=np.zeros((len(t), 2)), servo_response=np.zeros((len(t), 2)),
        gravity=GRAVITY, air_density=1.2,
    )  # fmt: skip


def truth() -> dict[str, float]:
    out = {f"rotor_gain_{i + 1}": g for i, g in enumerate(GAIN)}
    out |= {
        "torque_per_thrust_m": KAPPA,
        "drag_coefficient_n_per_rads_mps": DRAG,
        "rotor_delay_s": 0.0,
        "rotor_inertia_kgm2": SPIN_INERTIA,
        "drag_height_m": 0.0,
    }
    out |= {f"pose_1.com_{a}_m": c for a, c in zip("xyz", COM, strict=True)}
    for value, (i, j) in zip(INERTIA, INERTIA_AXES, strict=True):
        out[f"pose_1.inertia_{'xyz'[i]}{'xyz'[j]}_kgm2"] = value
    return out


def fit(log: FlightLog, mass: float = MASS) -> Fit:
    return fit_parameters(build_columns(log), log.robot, mass, log.gravity)


@pytest.fixture(scope="module")
def exact() -> Fit:
    return fit(make_log())


def test_exact_signals_give_exact_parameters(exact: Fit) -> None:
    found = {e.parameter.name: e for e in exact.estimates}
    for name, value in truth().items():
        e = found[name]
        assert e.identified, name
        assert abs(e.value - value) < 0.004 * e.parameter.scale, name
    assert np.all(exact.prediction.r_squared(exact.prediction.predicted) > 0.9999)
    # the robot file, which is wrong here, predicts worse
    assert np.all(exact.prediction.r_squared(exact.prediction.nominal)[3:] < 0.97)


def test_intervals_cover_the_truth() -> None:
    """Gyroscope noise of 0.02 rad/s: 95 % intervals hold the truth about as often as they say."""
    inside, count, errors = 0, 0, []
    for seed in range(4):
        found = {
            e.parameter.name: e
            for e in fit(make_log(40.0, rate=100.0, noise=0.02, seed=seed)).estimates
        }
        for name, value in truth().items():
            e = found[name]
            if e.identified and name != "rotor_delay_s":
                inside += abs(e.value - value) <= e.half_width
                count += 1
        errors += [
            found[f"pose_1.inertia_{a}_kgm2"].value / value - 1
            for a, value in zip(("xx", "yy", "zz"), INERTIA[:3], strict=True)
        ]
    assert count > 60 and inside / count > 0.88
    assert np.max(np.abs(errors)) < 0.05 and abs(np.mean(errors)) < 0.01  # noise does not bias it


def test_only_ratios_to_the_mass(exact: Fit) -> None:
    """With a wrong mass everything else is off by the same factor, and nothing else changes."""
    half = {e.parameter.name: e.value for e in fit(make_log(), mass=MASS / 1.3).estimates}
    for e in exact.estimates:
        name = e.parameter.name
        if name.startswith("rotor_gain") or "inertia" in name:
            assert half[name] * 1.3 == pytest.approx(e.value, rel=1e-3, abs=1e-5)
        if "com_" in name:
            assert half[name] == pytest.approx(e.value, abs=1e-5)


def test_what_was_not_excited_is_said() -> None:
    """A flight that never rolls nor pitches says nothing of those inertias, and does not invent."""
    log = make_log(40.0, noise=0.01, tilt=1e-4, push=0.2)
    found = {e.parameter.name: e for e in fit(log).estimates}
    model = build_body_model(ROBOT)
    _, _, I_B = compute_body(model, posture(ROBOT, "folded"))
    for axis, k in (("xx", 0), ("yy", 1), ("zz", 2)):
        e = found[f"pose_1.inertia_{axis}_kgm2"]
        assert not e.identified and math.isnan(e.half_width)
        assert e.value == pytest.approx(I_B[k, k])  # kept at the robot file's
        assert e.would_be > e.parameter.widest


def test_a_flight_that_tells_nothing_identifies_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """As damaged files do: every interval is too wide, and no parameter is left to fit."""
    from skywright.analysis.identify import fit as module

    known = module.list_parameters

    def narrow(*args: Any) -> Any:
        return [p._replace(widest=1e-15) for p in known(*args)]

    monkeypatch.setattr(module, "list_parameters", narrow)
    found = fit(make_log(12.0, noise=0.01)).estimates
    assert not any(e.identified for e in found)
    assert [e.value for e in found] == [e.parameter.nominal for e in found]


def test_delay_of_the_rotor_signals() -> None:
    """Speeds that are logged 4 ms too early come out as a delay, and spoil nothing else."""
    log = make_log(rate=250.0)
    early = np.roll(log.rotor_speed, -1, axis=0)  # type: ignore[arg-type]
    early[-1] = early[-2]
    found = {e.parameter.name: e for e in fit(log._replace(rotor_speed=early)).estimates}
    assert found["rotor_delay_s"].value == pytest.approx(0.004, abs=2e-4)
    assert found["pose_1.inertia_xx_kgm2"].value == pytest.approx(INERTIA[0], rel=0.01)


def test_lag_of_a_first_order_response() -> None:
    t = np.arange(0.0, 40.0, 0.01)
    u = build_sines(t, np.arange(0.1, 1.5, 0.1), 0)
    y = np.zeros_like(u)
    tau, gain = 0.07, 0.9
    for i in range(1, len(t)):
        y[i] = gain * u[i - 1] + (y[i - 1] - gain * u[i - 1]) * math.exp(-0.01 / tau)
    lag = fit_lag("servo", "rad/s", t, u, y + 0.02, np.ones(len(t), dtype=bool))
    assert lag.identified and lag.gain == pytest.approx(gain, abs=0.01)
    assert lag.lag == pytest.approx(tau + 0.005, abs=0.003)  # the hold of a step adds half of it
    assert lag.offset == pytest.approx(0.02, abs=0.002) and lag.r_squared > 0.999
    still = fit_lag("servo", "rad/s", t, 0 * u, 0 * y, np.ones(len(t), dtype=bool))
    assert not still.identified and "never commanded" in still.reason


# --- PX4 ---


def ulog_topics(log: FlightLog) -> dict[str, dict[str, np.ndarray]]:
    """The log as PX4 writes it: NED, FRD, rpm, microseconds from some start."""
    t = log.t + 12.5
    to_ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    flip = np.array([1.0, -1.0, -1.0])
    R = to_ned @ log.R_WB * flip
    w = np.sqrt(np.maximum(1 + R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2], 1e-12)) / 2
    q = np.column_stack(
        [w, (R[:, 2, 1] - R[:, 1, 2]) / (4 * w), (R[:, 0, 2] - R[:, 2, 0]) / (4 * w),
         (R[:, 1, 0] - R[:, 0, 1]) / (4 * w)]
    )  # fmt: skip
    v = log.v_WB @ to_ned.T
    assert log.rotor_speed is not None
    rpm = log.rotor_speed * 60 / (2 * math.pi)
    return {
        "vehicle_angular_velocity": {
            "timestamp": t, **{f"xyz[{i}]": log.w_WB_B[:, i] * flip[i] for i in range(3)}
        },
        "vehicle_attitude": {"timestamp": t, **{f"q[{i}]": q[:, i] for i in range(4)}},
        "vehicle_local_position": {
            "timestamp": t, **{n: v[:, i] for i, n in enumerate(("vx", "vy", "vz"))}
        },
        "esc_status": {
            "timestamp": t, **{f"esc[{i}].esc_rpm": rpm[:, i] for i in range(6)}
        },
    }  # fmt: skip


def rotor_parameters(order: list[int]) -> dict[str, float]:
    """CA_ROTOR parameters of the robot with its rotors logged in another order."""
    hubs = build_rotors(ROBOT.rotors).position
    out: dict[str, float] = {"CA_ROTOR_COUNT": 6}
    for i, k in enumerate(order):
        out |= {f"CA_ROTOR{i}_PX": float(hubs[k, 0]), f"CA_ROTOR{i}_PY": float(-hubs[k, 1])}
    return out


@pytest.fixture(scope="module")
def made() -> FlightLog:
    return make_log(50.0, rate=100.0)


def test_ulog_gives_what_its_signals_hold(made: FlightLog, tmp_path: Path) -> None:
    """The same truth through a ULog in NED and FRD, with the rotors in PX4's own order."""
    order = [4, 1, 0, 3, 5, 2]
    topics = ulog_topics(made)
    speeds = {n: topics["esc_status"][n] for n in topics["esc_status"]}
    for i, k in enumerate(order):
        topics["esc_status"][f"esc[{i}].esc_rpm"] = speeds[f"esc[{k}].esc_rpm"].copy()
    topics["esc_status"] = {
        "timestamp": speeds["timestamp"],
        **{f"esc[{i}].esc_rpm": make_rpm(made, k) for i, k in enumerate(order)},
    }
    path = write_ulog(tmp_path / "flight.ulg", topics, rotor_parameters(order))
    log = load_log(path, ROBOT)
    inside = (log.t > 1) & (log.t < 48)
    at = np.searchsorted(made.t, log.t[inside] - 1e-6)
    np.testing.assert_allclose(log.R_WB[inside], made.R_WB[at], atol=3e-3)
    np.testing.assert_allclose(log.v_WB[inside], made.v_WB[at], atol=1e-2)
    found = {e.parameter.name: e for e in identify([path], ROBOT, MASS).fit.estimates}
    for name, value in truth().items():
        e = found[name]
        assert e.identified, name
        assert abs(e.value - value) < 0.02 * e.parameter.scale, name


def make_rpm(log: FlightLog, rotor: int) -> np.ndarray:
    assert log.rotor_speed is not None
    return log.rotor_speed[:, rotor] * 60 / (2 * math.pi)


def test_ulog_with_commands_only(made: FlightLog, tmp_path: Path) -> None:
    """Without rotor speeds the commands and the lag that fits them best take their place."""
    topics = ulog_topics(made)
    del topics["esc_status"]
    topics["actuator_motors"] = {
        "timestamp": made.t + 12.5,
        **{f"control[{i}]": u for i, u in enumerate(make_commands(made).T)},
    }
    path = write_ulog(tmp_path / "flight.ulg", topics, {"THR_MDL_FAC": 0.0})
    result = identify([path], ROBOT, MASS)
    assert any("30 ms" in note for note in result.notes)
    found = {e.parameter.name: e for e in result.fit.estimates}
    for axis, value in zip(("xx", "yy", "zz"), INERTIA[:3], strict=True):
        assert found[f"pose_1.inertia_{axis}_kgm2"].value == pytest.approx(value, rel=0.05)


def age(topics: dict[str, dict[str, np.ndarray]], made: FlightLog) -> None:
    """Turn today's topics into those of PX4 1.6: raw sensors and pulse widths."""
    rates = topics.pop("vehicle_angular_velocity")
    s_B = np.einsum("kji,kj->ki", made.R_WB, np.gradient(made.v_WB, made.t, axis=0) + G_W)
    topics["sensor_combined"] = {
        "timestamp": rates["timestamp"],
        **{f"gyro_rad[{i}]": rates[f"xyz[{i}]"] for i in range(3)},
        **{f"accelerometer_m_s2[{i}]": s_B[:, i] * (1.0, -1.0, -1.0)[i] for i in range(3)},
    }
    topics["actuator_outputs"] = {
        "timestamp": made.t + 12.5,
        **{f"output[{i}]": 1075 + 875 * u for i, u in enumerate(make_commands(made).T)},
    }
    del topics["esc_status"]


def make_commands(made: FlightLog) -> np.ndarray:
    """Return what a first-order lag of 30 ms turns into the rotors' speeds, as 0 to 1 of thrust."""
    assert made.rotor_speed is not None
    command = made.rotor_speed + 0.03 * np.gradient(made.rotor_speed, made.t, axis=0)
    k_f = build_rotors(ROBOT.rotors).k_f
    return np.asarray(np.clip(k_f * command**2 / ROBOT.rotors.thrust_max_n, 0, 1))


def test_topics_of_older_px4(made: FlightLog, tmp_path: Path) -> None:
    """A log of PX4 1.6 that mostly stands on the ground: idling rotors are neither flight nor a
    reason to call them unlogged, and the page says which part was used."""
    topics = ulog_topics(made)
    age(topics, made)
    idle = np.arange(0.0, 120.0, 0.01)
    for fields in topics.values():
        for name, x in fields.items():
            still = 1120.0 if name.startswith("output") else x[0] if "q[" in name else 0.0
            still = -GRAVITY if name == "accelerometer_m_s2[2]" else still
            ground = idle + 12.5 if name == "timestamp" else np.full(len(idle), still)
            fields[name] = np.concatenate([ground, x + (120.0 if name == "timestamp" else 0.0)])
    path = write_ulog(tmp_path / "flight.ulg", topics, {"PWM_MIN": 1075, "PWM_MAX": 1950})
    log = load_log(path, ROBOT)
    assert 0.95 * 50 < 0.01 * log.free.sum() < 1.02 * 50
    result = identify([path], ROBOT, MASS)
    assert result.parts[0].start_s == pytest.approx(120, abs=0.5)
    assert any("used: " in note and "120" in note for note in result.notes)
    assert any("actuator_outputs" in note for note in result.notes)
    found = {e.parameter.name: e for e in result.fit.estimates}
    for axis, value in zip(("xx", "yy", "zz"), INERTIA[:3], strict=True):
        assert found[f"pose_1.inertia_{axis}_kgm2"].value == pytest.approx(value, rel=0.05)


def test_mixer_is_px4_s() -> None:
    """Tables that PX4 1.12 prints for its geometry files quad_x and hex_x (roll, pitch, yaw)."""
    s, c = 0.5, 0.866025
    quad = [[-0.707107, 0.707107, 1], [0.707107, -0.707107, 1], [0.707107, 0.707107, -1],
            [-0.707107, -0.707107, -1]]  # fmt: skip
    hexa = [[-1, 0, -1], [1, 0, 1], [s, c, -1], [-s, -c, 1], [-s, c, 1], [s, -c, -1]]
    for table, azimuth in ((quad, (-45, 135, 45, -135)), (hexa, (-90, 90, 30, -150, -30, 150))):
        angle = np.radians(azimuth)
        place = 0.3 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        rotors = build_rotors(ROBOT.rotors)._replace(
            position=place, spin=np.array([row[2] for row in table], dtype=float)
        )
        np.testing.assert_allclose(build_mixer(rotors)[:, :3], table, atol=1e-5)
        np.testing.assert_allclose(build_mixer(rotors)[:, 3], 1.0)


def test_mixer_inputs_become_thrusts(made: FlightLog, tmp_path: Path) -> None:
    topics = ulog_topics(made)
    del topics["esc_status"]
    t = made.t + 12.5
    controls = [0.1 * np.sin(t), 0.05 * np.cos(t), 0 * t, 0.5 + 0.1 * np.sin(2 * t)]
    topics["actuator_controls_0"] = {
        "timestamp": t, **{f"control[{i}]": x for i, x in enumerate(controls)},
    }  # fmt: skip
    log = load_log(write_ulog(tmp_path / "flight.ulg", topics), ROBOT)
    assert log.rotor_command is not None
    # rotor 2 of the file sits on the left (hex_x motor 2): all of the roll, no pitch
    expected = np.interp(log.t, made.t, controls[0] + controls[3]) * ROBOT.rotors.thrust_max_n
    np.testing.assert_allclose(log.rotor_command[:, 1], expected, atol=1e-3)


def test_slow_speeds_give_way_to_commands(made: FlightLog, tmp_path: Path) -> None:
    topics = ulog_topics(made)
    topics["esc_status"] = {n: x[::25] for n, x in topics["esc_status"].items()}  # 4 Hz
    topics["actuator_motors"] = {
        "timestamp": made.t + 12.5,
        **{f"control[{i}]": u for i, u in enumerate(make_commands(made).T)},
    }
    log = load_log(write_ulog(tmp_path / "flight.ulg", topics), ROBOT)
    assert log.rotor_speed is None and log.command_is_thrust
    assert any("4 Hz only: actuator_motors is taken" in note for note in log.notes)


def test_what_does_not_predict_is_refused(made: FlightLog, tmp_path: Path) -> None:
    """Rotors that do not belong to the flight, and a flight that another robot made."""
    topics = ulog_topics(made)
    rng = np.random.default_rng(0)
    names = [n for n in topics["esc_status"] if n != "timestamp"]
    for name in names:
        topics["esc_status"][name] = 5000 + 300 * rng.standard_normal(len(made.t))
    path = write_ulog(tmp_path / "noise.ulg", topics)
    with pytest.raises(InputError, match=r"R² .* on held-out parts .* at least 0.5 is needed"):
        identify([path], ROBOT, MASS)
    page = tmp_path / "page.html"
    done = call(str(path), "--robot", "f550-bridge", "--out", str(page))
    assert done.exit_code == 2 and not page.exists() and not page.with_suffix(".toml").exists()
    topics = ulog_topics(made)
    for name in names:  # thrust is 0.4 of the file's at these speeds
        topics["esc_status"][name] = topics["esc_status"][name] * math.sqrt(2.5)
    with pytest.raises(InputError, match=r"rotor_gain_1 .* valid: 0.5 to 2"):
        identify([write_ulog(tmp_path / "weak.ulg", topics)], ROBOT, MASS)


G_W = np.array([0.0, 0.0, GRAVITY])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda topics: topics.pop("vehicle_angular_velocity"), "lacks vehicle_angular_velocity"),
        (
            lambda topics: topics["esc_status"].update(
                {n: 0 * x for n, x in topics["esc_status"].items() if n != "timestamp"}
            ),
            "in esc_status no rotor turns",
        ),
        (lambda topics: topics.pop("vehicle_attitude"), "lacks vehicle_attitude"),
        (lambda topics: topics.pop("vehicle_local_position"), "neither vehicle_acceleration nor"),
        (lambda topics: topics.pop("esc_status"), "one of esc_status, actuator_motors"),
    ],
)
def test_ulog_that_lacks_something(change: Any, said: str, made: FlightLog, tmp_path: Path) -> None:
    topics = ulog_topics(made)
    change(topics)
    path = write_ulog(tmp_path / "flight.ulg", topics)
    with pytest.raises(InputError, match=said):
        load_log(path, ROBOT)


def test_ulog_of_another_robot(made: FlightLog, tmp_path: Path) -> None:
    path = write_ulog(
        tmp_path / "flight.ulg", ulog_topics(made), rotor_parameters([0, 1, 2, 3, 4, 4])
    )
    with pytest.raises(InputError, match="give the correct robot"):
        load_log(path, ROBOT)
    with pytest.raises(InputError, match="give --robot"):
        load_log(path)


# --- the command line ---


def call(*args: str) -> Any:
    return CliRunner().invoke(main, ["identify", *args])


def test_bad_input(tmp_path: Path, made: FlightLog) -> None:
    (tmp_path / "empty.ulg").write_bytes(b"")
    (tmp_path / "noise.ulg").write_bytes(bytes(range(256)) * 10)
    (tmp_path / "header.ulg").write_bytes(
        b"ULog\x01\x12\x35\x01" + bytes(8) + bytes(range(256)) * 9
    )
    (tmp_path / "noise.mcap").write_bytes(bytes(range(256)) * 10)
    (tmp_path / "text.txt").write_text("t")
    good = write_ulog(tmp_path / "good.ulg", ulog_topics(made))
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(good.read_bytes()[:4000])
    f550 = ("--robot", "f550-bridge")
    cases = [
        ((str(tmp_path / "none.ulg"), *f550), "no such file"),
        ((str(tmp_path), *f550), "contains no recording.mcap"),
        ((str(tmp_path / "empty.ulg"), *f550), "not a readable ULog"),
        ((str(tmp_path / "noise.ulg"), *f550), "not a readable ULog"),
        ((str(tmp_path / "header.ulg"), *f550), "header.ulg"),
        ((str(tmp_path / "noise.mcap"), *f550), "noise.mcap"),
        ((str(tmp_path / "text.txt"), *f550), "unknown kind of log"),
        ((str(cut), *f550), "cut.ulg"),
        ((str(good),), "give --robot"),
        ((str(good), "--robot", "none"), "unknown robot"),
        ((str(good), *f550, "--mass", "-1"), "--mass"),
        ((str(good), *f550, "--mass", "nan"), "--mass"),
        ((str(good), *f550, "--mass", "2500"), "has 2.5 kg in its file"),
        ((str(good), *f550, "--out", str(tmp_path / "x.pdf")), "unknown format"),
        ((), "LOG"),
    ]
    for args, said in cases:
        result = call(*args)
        assert result.exit_code == 2, (args, result.output)
        assert said in result.output + result.stderr, (args, result.output, result.stderr)
        assert "Traceback" not in result.output + result.stderr
    assert not (tmp_path / "x.pdf").exists()


def test_a_recording_of_another_robot_is_told(tmp_path: Path) -> None:
    """Other joints are refused; another name, as of an identified robot, is said."""
    sets = KNOWN | {"mission.task.forces_n": [2.0], "mission.task.slide_m": 0.0}
    run_mission(load_description("wall-contact", sets=sets), out=tmp_path / "run")
    result = call(str(tmp_path / "run"), "--robot", "hexarotor", "--out", str(tmp_path / "x.html"))
    assert result.exit_code == 2 and not (tmp_path / "x.html").exists()
    assert "was flown by 'f550-bridge' with joints shoulder, elbow" in result.stderr
    assert not load_log(tmp_path / "run", ROBOT).notes
    other = ROBOT.model_copy(update={"name": "f550-two"})
    assert "was flown by 'f550-bridge'" in load_log(tmp_path / "run", other).notes[0]


def test_page_json_and_robot_file(made: FlightLog, tmp_path: Path) -> None:
    """The robot file that comes out flies the identified values, and the page is whole."""
    path = write_ulog(tmp_path / "flight.ulg", ulog_topics(made))
    page = tmp_path / "found.html"
    result = call(
        str(path), "--robot", "f550-bridge", "--mass", str(MASS), "--json", "--out", str(page)
    )
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["mass_source"] == "given" and found["r_squared"]["angular_acceleration_x"] > 0.999
    assert any("servo" in line or "rotors' lag" in line for line in found["not_identified"])
    text = page.read_text().replace("<wbr>", "")
    assert "rotor_gain_1" in text and "http://" not in text.replace("http://www.w3.org", "")
    robot, sources = load_robot(tmp_path / "found.toml")
    assert robot.name == "f550-bridge-identified"
    assert sources["robot.rotors.thrust_coefficient_n_per_rad2s2"].kind == "derived"
    model = build_body_model(robot)
    mass, com, I_B = compute_body(model, posture(robot, "folded"))
    assert mass == pytest.approx(MASS, abs=1e-6)
    np.testing.assert_allclose(com, COM, atol=3e-4)
    np.testing.assert_allclose(np.diag(I_B), INERTIA[:3], rtol=0.02)
    mean = (
        robot.rotors.thrust_coefficient_n_per_rad2s2 / ROBOT.rotors.thrust_coefficient_n_per_rad2s2
    )
    assert mean == pytest.approx(GAIN.mean(), rel=0.003)


def test_flights_add_up(made: FlightLog, tmp_path: Path) -> None:
    """Two halves of a flight tell what the whole does."""
    parts = []
    for name, use in (("a", made.t < 25), ("b", made.t >= 25)):
        topics = {
            topic: {k: v[use] for k, v in fields.items()}
            for topic, fields in ulog_topics(made).items()
        }
        parts.append(write_ulog(tmp_path / f"{name}.ulg", topics))
    found = {e.parameter.name: e for e in identify(parts, ROBOT, MASS).fit.estimates}
    assert len({n.split(".")[0] for n in found if n.startswith("pose_")}) == 1
    assert found["pose_1.inertia_zz_kgm2"].value == pytest.approx(INERTIA[2], rel=0.02)


# --- the excitation itself ---

EXCITATION = Excitation(40.0, math.radians(4), math.radians(12), 0.8, 0.15, 1.2)


def plan(robot: Robot) -> Any:
    setup = Setup(load_description("excitation")._replace(robot=robot))
    return plan_excitation(
        robot, setup.loads, EXCITATION, np.array([0, 0, 2.0, 0.3]), posture(robot, "folded"), 9.81
    )  # fmt: skip


@pytest.mark.parametrize("name", ["f550-bridge", "hexarotor", "othex"])
def test_excitation_is_one_motion(name: str) -> None:
    """Rest to rest, derivatives consistent, every rotor within its limits."""
    robot = load_robot(name)[0]
    motion = plan(robot)
    rows = motion.rows
    assert rows is not None and motion.rotor_margin >= 0.0
    for end in (0, -1):
        np.testing.assert_allclose(rows["p_WB"][end], [0, 0, 2.0], atol=1e-9)
        for field in ("v_WB", "a_WB", "w_WB_B"):
            np.testing.assert_allclose(rows[field][end], 0.0, atol=1e-6)
    np.testing.assert_allclose(
        np.gradient(rows["p_WB"], 0.02, axis=0)[2:-2], rows["v_WB"][2:-2], atol=4e-3
    )
    np.testing.assert_allclose(
        np.gradient(rows["v_WB"], 0.02, axis=0)[2:-2], rows["a_WB"][2:-2], atol=2e-2
    )
    step = np.einsum("kji,kjl->kil", rows["R_WB"][:-1], rows["R_WB"][1:])
    turn = np.stack([step[:, 2, 1], step[:, 0, 2], step[:, 1, 0]], axis=1) / 0.02
    middle = 0.5 * (rows["w_WB_B"][:-1] + rows["w_WB_B"][1:])
    np.testing.assert_allclose(turn, middle, atol=2e-2)
    tilt = np.degrees(np.arccos(rows["R_WB"][:, 2, 2]))
    if name == "hexarotor":
        assert tilt.max() < 1e-6  # its tilt follows from the acceleration
    else:
        assert 1.0 < tilt.max() < 7.0


def test_channels_are_orthogonal() -> None:
    t = np.arange(0.0, 36.0, 0.01)
    base = EXCITATION._replace(duration=40.0)
    signals = np.array([build_sines(t, lines, 0) for lines in share_lines(base, 6)])
    assert np.all(np.abs(signals).max(axis=1) > 0.9) and np.all(np.abs(signals).max(axis=1) < 1.01)
    correlation = np.corrcoef(signals)
    assert np.max(np.abs(correlation - np.eye(6))) < 0.02


def test_excitation_that_does_not_fit() -> None:
    """Too heavy to lean at all: told with the rotor that cannot."""
    data = ROBOT.model_dump()
    data["platform"]["mass_kg"] = 3.6
    motion = plan(Robot(**data))
    assert motion.rows is None and "rotor" in motion.blocked_by and "valid" in motion.blocked_by


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (("mission.task.high_hz=0.2",), "too few frequencies"),
        (("mission.task.duration_s=8",), "too few frequencies"),
        (("mission.task.poses=[]",), "poses"),
        (('mission.task.poses=["up"]',), "folded"),
        (("mission.task.tilt_deg=-1",), "tilt_deg"),
        (("mission.task.tilts_deg=1",), "tilt_deg"),
    ],
)
def test_bad_task(sets: tuple[str, ...], said: str) -> None:
    args = [a for s in sets for a in ("--set", s)]
    result = CliRunner().invoke(main, ["plan", "excitation", *args])
    assert result.exit_code == 2 and said in result.stderr, result.stderr


def test_a_flight_gives_back_the_plant_s_deviations(tmp_path: Path) -> None:
    """run and identify: the perturbed plant's gains, mass distribution and lag."""
    import skywright
    from skywright.models.deviation import build_deviation

    sets = [
        'mission.task.poses=["folded"]',
        "mission.task.joint_deg=0",
        "mission.task.duration_s=24",
    ]
    d = skywright.load("excitation", sets=sets, seed=3)
    result = skywright.run(d, out=tmp_path / "shaken")
    assert result.outcome == "succeeded"
    mass = 2.5 * (1 + d.plant.mass_error)  # what a scale would say
    found = identify([tmp_path / "shaken"], None, mass)
    values = {e.parameter.name: e for e in found.fit.estimates}
    gain = build_deviation(d.plant, d.robot, 3).rotor_gain
    for i, g in enumerate(gain):
        assert values[f"rotor_gain_{i + 1}"].value == pytest.approx(g, abs=0.01)
    assert values["pose_1.com_x_m"].value == pytest.approx(0.0033, abs=1e-3)
    # inertia: the platform's is 5 % off, of which arm and gear dilute a part
    for axis, true in (("xx", 0.0528), ("yy", 0.0606), ("zz", 0.0702)):
        e = values[f"pose_1.inertia_{axis}_kgm2"]
        assert e.identified and abs(e.value - true) < max(1.5 * e.half_width, 0.03 * true)
    assert found.rotor_lag is not None and found.rotor_lag.lag == pytest.approx(0.031, abs=0.002)
    r2 = found.fit.prediction.r_squared(found.fit.prediction.predicted)
    assert np.all(r2[3:] > 0.87)  # the rates' noise is up to 1.6 times the file's
    assert "extends" in build_overrides(found, "f550-bridge")


def test_truth_is_the_plant_s() -> None:
    """What claims compare with equals MuJoCo's own mass matrix of the perturbed plant."""
    import mujoco

    from skywright.analysis.identify.truth import compute_truth
    from skywright.description.loader import load_description
    from skywright.models.deviation import build_deviation
    from skywright.models.scene import build_scene

    d = load_description("excitation", seed=4)
    pose = posture(d.robot, "working")
    truth_of, mass = compute_truth(d, pose[None])
    scene = build_scene(d.robot, d.world, build_deviation(d.plant, d.robot, 4))
    data = mujoco.MjData(scene.model)
    data.qpos[3], data.qpos[scene.places.joint_qpos] = 1.0, pose
    mujoco.mj_forward(scene.model, data)
    M = np.zeros((scene.model.nv, scene.model.nv))
    mujoco.mj_fullM(scene.model, data, M)
    body = scene.places.platform_body
    assert mass == pytest.approx(float(scene.model.body_subtreemass[body]), rel=1e-9)
    com = data.subtree_com[body] - data.qpos[:3]
    found = [truth_of[f"pose_1.com_{a}_m"] for a in "xyz"]
    np.testing.assert_allclose(found, com, atol=2e-4)  # a link is 4 mm longer in the plant
    for i, j in INERTIA_AXES:
        name = f"pose_1.inertia_{'xyz'[i]}{'xyz'[j]}_kgm2"
        assert truth_of[name] == pytest.approx(M[3 + i, 3 + j], abs=6e-4)
