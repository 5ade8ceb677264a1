"""A flight from a table: columns, attitude that is not logged, refusals."""

from __future__ import annotations

import importlib.util
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from identify_log import make_log, ulog_topics
from skywright.analysis.identify import flight_log
from skywright.analysis.identify.flight_log import MOST, SPARSE, build_axis, choose_period
from skywright.analysis.identify.table import estimate_attitude, load_table
from skywright.analysis.identify.ulog import load_ulog
from skywright.core.rotations import exp_so3
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from ulog_file import write_ulog

ROBOT = load_robot("hexarotor")[0]
DT = 0.004


def turn(rates: np.ndarray) -> np.ndarray:
    """Integrate body rates (n, 3) rad/s from level; returns R_WB (n, 3, 3)."""
    R, step, out = np.eye(3), np.empty((3, 3)), []
    for w in rates:
        exp_so3(w * DT, step)
        R = R @ step
        out.append(R)
    return np.array(out)


def build(n: int = 2000) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return a table of a hover that rocks, and its attitude (n, 3, 3)."""
    t = DT * np.arange(n)
    w = np.column_stack([0.4 * np.cos(3 * t), 0.3 * np.cos(2 * t + 1), 0.2 * np.sin(t)])
    R = turn(w)
    force = 9.80665 * R[:, 2]  # at rest: the reaction to weight, in B
    table = {"t_s": t + 100.0}
    table |= {f"w{a}_rad_s": w[:, i] for i, a in enumerate("xyz")}
    table |= {f"a{a}_m_s2": force[:, i] for i, a in enumerate("xyz")}
    table |= {f"command_{i}": np.full(n, 0.1 * i) for i in range(1, 7)}
    return table, R


def write(path: Path, table: dict[str, Any]) -> Path:
    rows = zip(*table.values(), strict=True)
    lines = [",".join(table), *(",".join(str(x) for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_attitude_follows_from_rates_and_force_where_the_table_has_none(tmp_path: Path) -> None:
    table, R = build()
    log = load_table(write(tmp_path / "a.csv", table), ROBOT)
    up = np.arccos(np.clip(np.einsum("kj,kj->k", log.R_WB[:-1, 2], R[: len(log.t) - 1, 2]), -1, 1))
    assert math.degrees(up.max()) < 0.5 and "no attitude" in log.notes[0]
    assert "drag is not identified" in log.notes[1] and log.v_WB is None
    assert log.rotor_command is not None and log.rotor_speed is None and log.free.all()
    full = math.sqrt(ROBOT.rotors.thrust_max_n / ROBOT.rotors.thrust_coefficient_n_per_rad2s2)
    assert log.rotor_command[5] == pytest.approx(full * np.arange(0.1, 0.65, 0.1))
    assert log.t[0] == 0.0 and log.t[1] == pytest.approx(DT)


def test_other_columns_may_be_empty_and_time_may_count_from_1970(tmp_path: Path) -> None:
    table, _ = build()
    plain = load_table(write(tmp_path / "a.csv", table), ROBOT)
    table["t_s"] = table["t_s"] + 1.76e9
    table["battery_v"] = np.where(np.arange(len(table["t_s"])) % 40, np.nan, 12.0)
    log = load_table(write(tmp_path / "b.csv", table), ROBOT)
    assert abs(len(log.t) - len(plain.t)) <= 1
    n = len(plain.t) - 1
    np.testing.assert_allclose(log.w_WB_B[:n], plain.w_WB_B[:n], atol=1e-4)


def test_gaps_in_columns_that_are_no_rotors_drop_no_row(tmp_path: Path) -> None:
    table, _ = build(400)
    plain = load_table(write(tmp_path / "a.csv", table), ROBOT)
    sporadic = np.where(np.arange(400) % 40, np.nan, 0.5)
    names = ("speed_gps", "speed_7_rad_s", "command_7", "command_mode")  # the robot has six rotors
    log = load_table(write(tmp_path / "b.csv", table | dict.fromkeys(names, sporadic)), ROBOT)
    assert np.array_equal(log.t, plain.t) and np.array_equal(log.w_WB_B, plain.w_WB_B)
    # with measured speeds, commands are not used
    table |= {f"speed_{i}_rad_s": np.full(400, 100.0 * i) for i in range(1, 7)}
    table["command_3"] = sporadic
    log = load_table(write(tmp_path / "c.csv", table), ROBOT)
    assert np.array_equal(log.t, plain.t) and log.rotor_speed is not None


def test_a_tilt_at_the_start_is_found_from_the_force() -> None:
    """At once from the first sample; then the filter removes an error with its time constant."""
    tilted = turn(np.array([[50.0, 0.0, 0.0]]))[0]
    force = np.tile(9.81 * tilted[2], (500, 1))
    R = estimate_attitude(np.zeros((500, 3)), force, DT)
    assert R[-1, 2] == pytest.approx(tilted[2], abs=2e-3)


def test_logged_attitude_velocity_and_speeds_are_taken_as_they_are(tmp_path: Path) -> None:
    table, R = build(400)
    half = 0.5 * np.arccos(np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1))
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]])
    axis = axis / np.maximum(np.linalg.norm(axis, axis=0), 1e-12) * np.sin(half)
    sign = np.where(np.arange(400) < 200, 1.0, -1.0)  # q and -q are one attitude
    table |= dict(
        zip(("qw", "qx", "qy", "qz"), sign * np.vstack([np.cos(half), axis]), strict=True)
    )
    table |= {f"v{a}_m_s": np.full(400, i + 1.0) for i, a in enumerate("xyz")}
    table |= {f"speed_{i}_rad_s": np.full(400, 100.0 * i) for i in range(1, 7)}
    log = load_table(write(tmp_path / "a.csv", table), ROBOT)
    off = np.abs(log.R_WB - R[: len(log.t)]).max(axis=(1, 2))
    assert np.delete(off, 199).max() < 1e-4  # between 199 and 200 the sign changes
    assert log.v_WB[7] == pytest.approx([1, 2, 3]) and log.rotor_command is None
    assert log.rotor_speed is not None and log.rotor_speed[9] == pytest.approx(
        100.0 * np.arange(1, 7)
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"command_6": None}, r"lacks the columns command_6; valid: t_s, wx_rad_s"),
        ({"az_m_s2": None}, r"lacks the columns az_m_s2"),
        ({"command_2": 1500.0}, r"commands from 0\.1 to 1500; valid: 0 to 1"),
        ({"t_s": 1.0}, r"t_s must increase"),
        ({"wx_rad_s": float("nan")}, r"lacks the columns wx_rad_s"),
        ({"WX_rad_s": 0.0}, r"has two columns 'wx_rad_s'"),
    ],
)
def test_tables_that_cannot_be_used(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    table: dict[str, Any] = build(50)[0]
    for name, value in change.items():
        table[name] = np.full(50, value) if value is not None else None
    table = {k: v for k, v in table.items() if v is not None}
    path = write(tmp_path / "a.csv", table)
    with pytest.raises(InputError, match=said):
        load_table(path, ROBOT)
    with pytest.raises(InputError, match="give --robot"):
        load_table(path, None)


def test_one_wrong_time_is_refused_with_the_span_that_it_makes(tmp_path: Path) -> None:
    table, _ = build(50)  # 0.196 s at 250 Hz: 20 times 50 samples are 4 s
    table["t_s"][-1] += 500.0
    said = (
        r"a\.csv: its 50 samples span 500\.196 s at 250 Hz; valid: up to 4 s\. The largest step is "
        r"500 s, 0\.192 s after the first sample: remove samples with wrong times, or split the log"
    )
    with pytest.raises(InputError, match=said):
        load_table(write(tmp_path / "a.csv", table), ROBOT)


def test_slow_rows_are_told_by_their_rate(tmp_path: Path) -> None:
    table, _ = build(50)
    table["t_s"] = 0.5 * np.arange(50)
    with pytest.raises(InputError, match=r"2 rows a second; at least 10 are needed"):
        load_table(write(tmp_path / "a.csv", table), ROBOT)


def test_the_time_axis_has_a_largest_number_of_samples() -> None:
    """Relative to the log's samples, and absolute, even for a log without a gap."""
    stamps = 0.01 * np.arange(100)
    assert len(build_axis("log", stamps)) == 99
    stamps[-1] = 0.99 * SPARSE
    assert len(build_axis("log", stamps)) == 99 * SPARSE
    stamps[-1] = 1.02 * SPARSE
    with pytest.raises(InputError, match=r"log: its 100 samples span 20\.4 s at 100 Hz; valid"):
        build_axis("log", stamps)
    with pytest.raises(InputError, match=f"valid: up to {MOST} s"):
        build_axis("log", np.arange(MOST + 2.0))


def test_a_long_log_has_a_longer_interval_up_to_20_ms() -> None:
    """At 250 Hz, MOST samples span 3200 s."""
    for rows, period in ((MOST // 4, DT), (MOST + 1, DT), (2 * MOST + 1, 2 * DT)):
        stamps = DT * np.arange(rows)
        assert choose_period(stamps) == pytest.approx(period, rel=1e-5)
        assert len(build_axis("log", stamps, choose_period(stamps))) <= MOST + 1
    days = 0.02 * np.arange(MOST + 1001)
    with pytest.raises(InputError, match=r"at 50 Hz; valid: up to 16000 s"):
        build_axis("log", days, choose_period(days))
    sparse = DT * np.append(np.arange(999.0), 86400.0 / DT)  # one wrong time
    assert choose_period(sparse) == pytest.approx(DT)


def test_a_long_table_is_read_at_a_longer_interval(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(flight_log, "MOST", 1000)
    table, _ = build()
    log = load_table(write(tmp_path / "a.csv", table), ROBOT)  # 2000 rows
    assert log.period == pytest.approx(1999 * DT / 1000) and len(log.t) in (1000, 1001)
    assert log.free.all()


def test_a_long_ulog_is_read_at_a_longer_interval(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(flight_log, "MOST", 1000)
    made = make_log(15.0, rate=100.0)
    log = load_ulog(write_ulog(tmp_path / "flight.ulg", ulog_topics(made)), made.robot)
    assert log.period == pytest.approx(0.015, rel=1e-3) and log.free.any()


def load_example(name: str) -> Any:
    file = Path(__file__).parents[1] / "examples" / "identify" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    return example


def test_the_example_turns_a_flight_of_px4_into_the_frames_of_a_table(tmp_path: Path) -> None:
    """Heading north, the nose 10 deg up: x of the body points to north and up, y to west."""
    row = {
        "timestamp": 2e6, "u0": 1100, "u1": 1200, "u2": 1300, "u3": 1400, "vx": 1, "vy": 2,
        "vz": -3, "q0": math.cos(math.radians(5)), "q1": 0, "q2": math.sin(math.radians(5)),
        "q3": 0, "ang_vel_x": 0.1, "ang_vel_y": 0.2, "ang_vel_z": 0.3,
        "acc_b_x": 1, "acc_b_y": 2, "acc_b_z": -9,
    }  # fmt: skip
    file = tmp_path / "flight.csv"
    file.write_text(",".join(row) + "\n" + ",".join(map(str, row.values())) + "\n")
    table, pulses = load_example("iris_table").build_table(file)
    told = {name: float(x[0]) for name, x in table.items()}
    assert [told[f"v{a}_m_s"] for a in "xyz"] == [2, 1, 3]
    assert [told[f"w{a}_rad_s"] for a in "xyz"] == [0.1, -0.2, -0.3]
    assert [told[f"a{a}_m_s2"] for a in "xyz"] == [1, -2, 9]
    attitude = Rotation.from_quat([told[k] for k in ("qx", "qy", "qz", "qw")])
    ten = math.radians(10.0)
    expected = [[0, math.cos(ten), math.sin(ten)], [-1, 0, 0]]
    assert np.allclose(attitude.apply(np.eye(3)[:2]), expected)
    assert np.allclose(pulses, [[0.3, 0.2, 0.4, 0.1]])  # front left, back left, back right
    file.write_text("t,x\n1,2\n")
    with pytest.raises(SystemExit, match="lacks the columns q1, q2, q3, q0"):
        load_example("iris_table").build_table(file)


def test_the_example_reads_a_log_and_finds_the_model_that_made_it(tmp_path: Path) -> None:
    """Thrust by the square of a lagging command: lag, thrust and inertia come back."""
    example = load_example("crazyflie_log")
    rng, n, full, inertia, lag = np.random.default_rng(1), 40_000, 0.15, 1.5e-5, 0.08
    slow = np.repeat(rng.uniform(-1, 1, (n // 250, 4)), 250, axis=0)
    command = 0.66 + 0.1 * slow  # counter-clockwise from front left
    signal = (65535 + example.IDLE) * command - example.IDLE
    u, now = np.empty_like(command), command[0].copy()
    for i in range(n):
        now += (command[i] - now) * (1.0 - math.exp(-0.001 / lag))
        u[i] = now
    thrust = full * u**2
    turned = example.LEVER / inertia * np.column_stack([thrust @ example.Y, -thrust @ example.X])
    yawed = 30.0 * (u**2 @ example.SPIN)
    rates = np.cumsum(0.001 * np.column_stack([turned, yawed]), axis=0)
    names = ["acc.z(f)", "acc.x(f)", "acc.y(f)", *(f"gyro.{a}(f)" for a in "xyz")]
    names += [f"motor.m{i}(I)" for i in range(1, 5)]
    head = b"\xbc\x02\x00\x01\x00\xff\xfffixedFrequency\x00" + struct.pack("<H", len(names))
    head += b"".join(x.encode() + b"\0" for x in names)
    up = thrust.sum(axis=1) / example.MASS / 9.80665
    body = b"".join(
        struct.pack(
            "<HQ6f4I", 0xFFFF, 1000 * i, up[i], 0.0, 0.0,
            *np.degrees(rates[i]), *(round(signal[i, 4 - k]) for k in range(1, 5)),
        )
        for i in range(n)
    )  # fmt: skip
    (tmp_path / "log").write_bytes(head + body)
    table = example.build_table(example.decode(tmp_path / "log"))
    said = example.compare(table)
    assert "R² 1.00, lag 80 ms, delay 0 ms, 0.150 N a rotor" in said[0]
    assert "R² 1.00, lag 80 ms" in said[1] and "inertia 1.5e-05" in said[1]
    assert "R² 1.00, lag 80 ms" in said[2] and "inertia 1.5e-05" in said[2]
    assert "alone: R² 1.00, lag 80 ms" in said[3]


def test_gaps_of_a_table_are_not_flown(tmp_path: Path) -> None:
    table, _ = build()
    t = table["t_s"] - 100.0
    keep = ~((t > 3.0) & (t < 4.5)) & ~((t > 6.0) & (t < 6.05))
    cut = {name: x[keep] for name, x in table.items()}
    log = load_table(write(tmp_path / "gap.csv", cut), ROBOT)
    assert any("1.5 s of flight lie in gaps" in note for note in log.notes)
    assert not log.free[(log.t > 3.01) & (log.t < 4.49)].any()
    assert log.free[(log.t < 2.99) | (log.t > 4.51)].all()  # 50 ms are interpolated
