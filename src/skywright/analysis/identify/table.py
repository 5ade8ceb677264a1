"""A text table (.csv) as a flight for identification, for logs of any autopilot.

Frames W (ENU) and B (FLU). Attitude and velocity are optional: without attitude it is estimated
from body rates and specific force; without velocity drag is not identified.
"""

import math
from pathlib import Path

import numpy as np

from skywright.analysis.identify.flight_log import (
    GRAVITY,
    FlightLog,
    align_signs,
    build_axis,
    choose_period,
    find_airborne,
    find_rotations,
    find_sampled,
    leave_out_gaps,
    move_to_origin,
)
from skywright.core.arrays import Array
from skywright.core.bounded import LARGEST_TABLE, read_bytes
from skywright.core.rotations import exp_so3
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rigid_body import joint_names, posture
from skywright.recordings.text_table import decode, read_number, split_row

LEVELLING_S = 2.0
"""s, time constant of the complementary filter for the attitude, if the table has none."""
RATE = ("wx_rad_s", "wy_rad_s", "wz_rad_s")
FORCE = ("ax_m_s2", "ay_m_s2", "az_m_s2")
SPEED = ("vx_m_s", "vy_m_s", "vz_m_s")
QUATERNION = ("qw", "qx", "qy", "qz")
LARGEST = 1e9
"""Bound of every number except the time, which may count from 1970."""


def load_table(path: Path, robot: Robot | None) -> FlightLog:
    """Load a table flown by `robot`. Raises InputError for a missing column or a wrong time."""
    if robot is None:
        raise InputError(f"{path}: a table contains no robot; give --robot NAME or FILE")
    n = len(robot.rotors.azimuth_deg)
    measured = tuple(f"speed_{i + 1}_rad_s" for i in range(n))
    commanded = tuple(f"command_{i + 1}" for i in range(n))
    table = _read(path, measured, commanded)
    known = measured[0] in table
    needed = ("t_s", *RATE, *(measured if known else commanded))
    missing = [name for name in needed if name not in table]
    has_velocity, has_force = SPEED[0] in table, FORCE[0] in table
    missing += [c for c in SPEED if has_velocity and c not in table]
    missing += [c for c in FORCE if (has_force or not has_velocity) and c not in table]
    if missing:
        raise InputError(
            f"{path}: lacks the columns {', '.join(missing)}; valid: t_s, {', '.join(RATE)}, "
            f"{', '.join(FORCE)} (specific force) or {', '.join(SPEED)}, command_1 to command_{n} "
            f"(0 to 1 of the full speed) or speed_1_rad_s to speed_{n}_rad_s, and if known "
            f"{', '.join(QUATERNION)}"
        )
    stamps = table["t_s"]
    if len(stamps) < 10 or not np.all(np.diff(stamps) > 0.0):
        raise InputError(f"{path}: t_s must increase from row to row, over 10 rows at least")
    period = choose_period(stamps)
    if not period < 0.1:
        raise InputError(f"{path}: {1.0 / period:.3g} rows a second; at least 10 are needed")
    t = build_axis(str(path), stamps - stamps[0], period)

    def take(names: tuple[str, ...]) -> Array:
        return np.column_stack([np.interp(t, stamps - stamps[0], table[c]) for c in names])

    w = take(RATE)
    force = move_to_origin(take(FORCE), w, t, robot) if has_force else None
    notes = []
    if all(c in table for c in QUATERNION):
        q = align_signs(np.column_stack([table[c] for c in QUATERNION]))
        table |= dict(zip(QUATERNION, q.T, strict=True))
        R = find_rotations(take(QUATERNION))
    elif force is not None:
        R = estimate_attitude(w, force, period)
        notes.append("no attitude in the table: estimated from body rates and specific force")
    else:
        raise InputError(f"{path}: lacks the columns {', '.join(QUATERNION)}")
    if not has_velocity:
        notes.append("no velocity in the table: drag is not identified")
    signal = take(measured if known else commanded)
    if not known:
        r = robot.rotors
        if np.min(signal) < -0.01 or np.max(signal) > 1.01:
            raise InputError(
                f"{path}: commands from {np.min(signal):.4g} to {np.max(signal):.4g}; valid: 0 to "
                "1 of a rotor's full speed"
            )
        signal = signal * math.sqrt(r.thrust_max_n / r.thrust_coefficient_n_per_rad2s2)
    names, q = tuple(joint_names(robot)), posture(robot, "folded")
    if names:
        notes.append("the arm is not in the table: taken as folded")
    still = np.zeros((len(t), len(names)))
    free = find_airborne(signal, t, force, robot)
    free = leave_out_gaps(free, find_sampled(stamps - stamps[0], t), t, notes)
    return FlightLog(
        name=path.name, robot=robot, t=t, free=free,
        v_WB=take(SPEED) if has_velocity else None, R_WB=R, w_WB_B=w,
        specific_force_B=force, rotor_speed=signal if known else None,
        rotor_command=None if known else signal, command_is_thrust=False, joints=names,
        q=np.tile(q, (len(t), 1)), servo_unit="rad", servo_command=still, servo_response=still,
        gravity=GRAVITY, air_density=1.2, notes=tuple(notes),
    )  # fmt: skip


def _read(path: Path, measured: tuple[str, ...], commanded: tuple[str, ...]) -> dict[str, Array]:
    """Return the used columns by name, without rows in which one of them has no number.

    `measured` and `commanded` name the rotors' speeds and commands; with speeds, commands are not
    used. Other columns may have gaps.
    """
    lines = decode(read_bytes(path, LARGEST_TABLE)).splitlines()
    rows = [split_row(x, ",") for x in lines if x.strip() and not x.startswith("#")]
    if not rows:
        raise InputError(f"{path}: is empty")
    names = [name.lower() for name in rows[0]]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise InputError(f"{path}: has two columns {sorted(twice)[0][:60]!r}")
    whole = [row for row in rows[1:] if len(row) == len(names)]
    data = np.array([[read_number(cell) for cell in row] for row in whole]).reshape(-1, len(names))
    wanted = [i for i, name in enumerate(names) if np.any(np.isfinite(data[:, i])) and name]
    signals = measured if measured[0] in (names[i] for i in wanted) else commanded
    known = {"t_s", *RATE, *FORCE, *SPEED, *QUATERNION, *signals}
    used = [i for i in wanted if names[i] in known]
    most = np.array([math.inf if names[i] == "t_s" else LARGEST for i in used])
    good = data[np.all(np.abs(data[:, used]) < most, axis=1)]
    return {names[i]: np.ascontiguousarray(good[:, i]) for i in used}


def estimate_attitude(w: Array, force: Array, period: float) -> Array:
    """Return R_WB (n, 3, 3) from body rates (n, 3) rad/s and specific forces (n, 3) m/s^2.

    A complementary filter integrates the rates and takes the mean specific force as vertical. The
    heading starts at 0 and drifts.
    """
    out, R, turn = np.empty((len(w), 3, 3)), np.eye(3), np.empty((3, 3))
    for i in range(len(w)):
        up = force[i] / max(float(np.linalg.norm(force[i])), 1e-9)
        share = 1.0 if i == 0 else period / LEVELLING_S
        exp_so3(share * np.cross(up, R[2]) + w[i] * (period if i else 0.0), turn)
        R = R @ turn
        out[i] = R
    return out
