"""A PX4 ULog as a flight for identification.

PX4 logs in NED and FRD; the signals are converted to ENU and FLU. Required: body rates
(`vehicle_angular_velocity`, before PX4 1.11 `sensor_combined`), attitude, velocity or acceleration,
and the rotors (`rotor_signals.py`).
"""

import math
from pathlib import Path
from typing import Any

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
from skywright.analysis.identify.rotor_signals import read_rotors
from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.rigid_body import joint_names, posture

MATCH = math.radians(25.0)  # maximum difference of azimuth between log and robot file
FLU = np.array([1.0, -1.0, -1.0])  # FRD to FLU
ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # from NED

RATES = (("vehicle_angular_velocity", "xyz"), ("sensor_combined", "gyro_rad"))
ACCELERATION = (("vehicle_acceleration", "xyz"), ("sensor_combined", "accelerometer_m_s2"))
"""Topics and their fields, current ones first; `sensor_combined` holds raw readings."""


def load_ulog(path: Path, robot: Robot | None) -> FlightLog:
    """Load a ULog flown by `robot`.

    Raises InputError if the file is not a ULog, lacks a topic, has wrong times, or does not match
    the robot.
    """
    if robot is None:
        raise InputError(f"{path}: a ULog contains no robot description; give --robot NAME or FILE")
    log = _open(path)
    topics = {d.name: d.data for d in reversed(log.data_list) if len(d.data["timestamp"]) > 1}
    notes: list[str] = []
    name, field = next((r for r in RATES if r[0] in topics), RATES[0])
    rates = _need(path, topics, name, "the body rates")
    attitude = _need(path, topics, "vehicle_attitude", "the attitude")
    at = _Axis(path, name, rates)
    t = at.t
    w = _vector(rates, field, at) * FLU
    if name != RATES[0][0]:
        notes.append(f"no {RATES[0][0]} in the log: body rates from {name}")
    R = _rotations(attitude, at)
    v = None
    position = topics.get("vehicle_local_position")
    found = next((a for a in ACCELERATION if a[0] in topics), None)
    if position is not None:
        v = np.column_stack([at.take(position, k) for k in ("vx", "vy", "vz")]) @ ENU.T
    else:
        notes.append("no vehicle_local_position in the log: drag is not identified")
    if position is None and found is None:
        raise InputError(
            f"{path}: contains neither vehicle_acceleration nor sensor_combined nor "
            "vehicle_local_position; one is required"
        )
    force = None
    if found is not None:
        force = _vector(topics[found[0]], found[1], at) * FLU
        force = move_to_origin(force, w, t, robot)
    order = _match_rotors(path, log.initial_parameters, robot, notes)
    speed, command = read_rotors(
        path, log.data_list, log.initial_parameters, robot, order, at, notes
    )
    turning = np.sqrt(np.maximum(command, 0.0)) if command is not None else speed
    assert turning is not None
    free = _find_free(topics, turning, force, t, at, robot)
    free = leave_out_gaps(free, at.sampled, t, notes)
    names = tuple(joint_names(robot))
    q = posture(robot, "folded")
    if names:
        notes.append("the arm is not in the log: taken as folded")
    return FlightLog(
        name=path.name,
        robot=robot,
        t=t,
        free=free,
        v_WB=v,
        R_WB=R,
        w_WB_B=w,
        specific_force_B=force,
        rotor_speed=speed,
        rotor_command=command,
        command_is_thrust=speed is None,
        joints=names,
        q=np.tile(q, (len(t), 1)),
        servo_unit="rad",
        servo_command=np.zeros((len(t), len(names))),
        servo_response=np.zeros((len(t), len(names))),
        gravity=GRAVITY,
        air_density=1.2,
        notes=tuple(notes),
    )


def _open(path: Path) -> Any:
    try:
        from pyulog import ULog
    except ImportError:  # pragma: no cover - it is a dependency
        raise InputError(f"{path}: reading a ULog needs the package pyulog") from None
    try:
        return ULog(str(path))
    except PermissionError:
        raise InputError(f"{path}: cannot be read (permission denied)") from None
    except Exception as error:  # the parser raises arbitrary exceptions on damaged files
        raise InputError(
            f"{path}: is not a readable ULog ({type(error).__name__}: {error})"
        ) from None


def _need(path: Path, topics: dict[str, Any], name: str, what: str) -> Any:
    if name not in topics:
        there = ", ".join(sorted(topics)) or "nothing"
        raise InputError(f"{path}: lacks {name} ({what}); it holds {there}")
    return topics[name]


class _Axis:
    """The common time axis `t` (n,) s from 0; a call resamples a field of a topic to it.

    `sampled` (n,) is the mask of the times that lie in no gap of the fields that the fit uses.
    """

    def __init__(self, path: Path, name: str, rates: Any) -> None:
        self.path = path
        stamps = rates["timestamp"].astype(np.float64) * 1e-6
        self.start = stamps[0]
        steps = np.diff(stamps)
        if np.any(steps < 0):
            raise InputError(f"{path}: time runs backwards in {name}")
        period = choose_period(stamps)
        if not 0.0 < period < 0.1:
            raise InputError(
                f"{path}: {name} comes at {1.0 / max(period, 1e-9):.0f} Hz; at least 10 Hz are "
                "needed"
            )
        self.t = build_axis(f"{path}: {name}", stamps - self.start, period)
        self.sampled = np.ones(len(self.t), dtype=bool)

    def __call__(self, topic: Any, name: str) -> Array:
        times, x = self._list_samples(topic, name)
        if len(x) < 2:
            return np.full(len(self.t), np.nan)
        return np.asarray(np.interp(self.t, times, x))

    def take(self, topic: Any, name: str) -> Array:
        """Resample a field that the fit uses, and take its gaps out of `sampled`."""
        self.leave_out(topic, name)
        return self(topic, name)

    def leave_out(self, topic: Any, name: str) -> None:
        """Take the gaps of a field, which samples with NaN do not fill, out of `sampled`."""
        self.sampled &= find_sampled(self._list_samples(topic, name)[0], self.t)

    def _list_samples(self, topic: Any, name: str) -> tuple[Array, Array]:
        """Return the times (k,) s and the values (k,) of a field, without those of NaN."""
        if name not in topic:
            raise InputError(f"{self.path}: lacks the field {name!r} in a topic; log it in full")
        x = np.asarray(topic[name], dtype=np.float64)
        good = np.isfinite(x)
        return np.asarray(topic["timestamp"].astype(np.float64) * 1e-6 - self.start)[good], x[good]


def _vector(topic: Any, name: str, at: Any) -> Array:
    return np.column_stack([at.take(topic, f"{name}[{i}]") for i in range(3)])


def _rotations(topic: Any, at: Any) -> Array:
    """Return R_WB (n, 3, 3), ENU from FLU, from PX4's quaternion (NED from FRD)."""
    raw = np.column_stack([topic[f"q[{i}]"] for i in range(4)]).astype(np.float64)
    good = np.all(np.isfinite(raw), axis=1)
    raw = align_signs(raw[good])
    smooth = {"timestamp": topic["timestamp"][good], **{f"q[{i}]": raw[:, i] for i in range(4)}}
    q = np.column_stack([at.take(smooth, f"q[{i}]") for i in range(4)])
    return np.asarray(ENU @ find_rotations(q) * FLU)


def _match_rotors(
    path: Path, parameters: dict[str, float], robot: Robot, notes: list[str]
) -> list[int]:
    """Return each rotor's index in the log, matched by azimuth."""
    n = len(robot.rotors.azimuth_deg)
    count = int(parameters.get("CA_ROTOR_COUNT", 0))
    if count == 0:
        notes.append("no CA_ROTOR parameters in the log: rotors taken in the robot file's order")
        return list(range(n))
    if count != n:
        raise InputError(f"{path}: was flown with {count} rotors; robot {robot.name!r} has {n}")
    azimuth = [
        math.atan2(-parameters[f"CA_ROTOR{i}_PY"], parameters[f"CA_ROTOR{i}_PX"])
        for i in range(count)
    ]
    order = []
    for degrees in robot.rotors.azimuth_deg:
        off = [abs(math.remainder(a - math.radians(degrees), 2 * math.pi)) for a in azimuth]
        best = int(np.argmin(off))
        if off[best] > MATCH or best in order:
            where = ", ".join(f"{math.degrees(a):.0f}" for a in azimuth)
            raise InputError(
                f"{path}: its rotors are at {where} deg, those of robot {robot.name!r} at "
                f"{', '.join(f'{a:g}' for a in robot.rotors.azimuth_deg)} deg; give the "
                "correct robot"
            )
        order.append(best)
    return order


def _find_free(
    topics: dict[str, Any], signal: Array, force: Array | None, t: Array, at: Any, robot: Robot
) -> Mask:
    """Return the mask of flight, from the rotors and PX4's land detector."""
    free = find_airborne(signal, t, force, robot)
    landed = topics.get("vehicle_land_detected")
    if landed is not None:
        for name in ("landed", "ground_contact"):
            if name in landed:
                free &= at(landed, name) < 0.5
    return free
