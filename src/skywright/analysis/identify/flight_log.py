"""A flight in the common form for identification: measured and commanded signals.

SI units, frames W (ENU) and B (FLU). All signals share one time axis.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.localisation.trajectory import find_covered, find_gap_limit
from skywright.models.rigid_body import build_body_model, compute_body, posture
from skywright.recordings.period import compute_period

MOST, SPARSE = 800_000, 20
"""Largest number of samples of the common time axis: absolute, and relative to the log's.

A recording takes up to 1.2 kB per sample of the axis, which MOST limits to about 1 GB.
"""
FASTEST = 250.0  # Hz, maximum rate of the common time axis
LONGEST = 0.02  # s, maximum interval that a long log gets: a tenth of a cycle of the cut-off
GRAVITY = 9.80665
AIRBORNE = 0.35  # of the maximum sum of rotor speeds: idling is at 0.2 or less; a robot that
# lifts itself hovers at this if its maximum thrust is 8 times its weight
SHORTEST_GROUND = 0.5  # s: no robot lands and takes off again within less; its rotors were cut
LEAST_GAP = 0.1
"""s: a shorter pause of a signal is interpolated. It is half a cycle of the filter's cut-off."""
HIT = 1.5  # of the specific force of all rotors at full thrust: more is a collision


class FlightLog(NamedTuple):
    """n samples of a flight; free of NaN where `free` holds."""

    name: str
    robot: Robot
    t: Array  # (n,) s, evenly spaced
    free: Mask  # (n,) in the air, without contact
    v_WB: Array | None  # (n, 3) m/s; None: not logged
    R_WB: Array  # (n, 3, 3)
    w_WB_B: Array  # (n, 3) rad/s
    specific_force_B: Array | None  # (n, 3) m/s^2 at B's origin; None: from v_WB
    rotor_speed: Array | None  # (n, rotors) rad/s, measured; None: only commanded
    rotor_command: Array | None  # (n, rotors) rad/s, or N where `command_is_thrust`
    command_is_thrust: bool
    joints: tuple[str, ...]
    q: Array  # (n, joints) rad, measured
    servo_unit: str  # "rad/s" for velocity servos, "rad" for position servos
    servo_command: Array  # (n, joints) in that unit
    servo_response: Array  # (n, joints)
    gravity: float
    air_density: float
    notes: tuple[str, ...] = ()

    @property
    def period(self) -> float:
        """Time (s) between two samples; 0 for one sample."""
        return compute_period(self.t)


def choose_period(stamps: Array) -> float:
    """Return the interval (s) of the common time axis of a log with the times `stamps` (k,) s.

    It is the usual interval of the log, at least 1 / FASTEST. A log that would have more than MOST
    samples has a longer one, up to LONGEST, unless its times are sparse.
    """
    period = max(float(np.median(np.diff(stamps))), 1.0 / FASTEST)
    span = float(stamps[-1] - stamps[0])
    if span > SPARSE * len(stamps) * period:
        return period
    return max(period, min(span / MOST, LONGEST))


def build_axis(name: str, stamps: Array, period: float | None = None) -> Array:
    """Return even times (n,) s from the first to the last of `stamps` (k,) s.

    `period` (s) is their interval, by default the mean interval of `stamps`. Raises InputError that
    begins with `name` if the times span too much, as one wrong time does.
    """
    period = compute_period(stamps) if period is None else period
    span, longest = stamps[-1] - stamps[0], period * min(MOST, SPARSE * len(stamps))
    if span > longest * (1.0 + 1e-9):
        steps = np.diff(stamps)
        i = int(np.argmax(steps))
        raise InputError(
            f"{name}: its {len(stamps)} samples span {span:.6g} s at {1.0 / period:.3g} Hz; valid: "
            f"up to {longest:.6g} s. The largest step is {steps[i]:.4g} s, "
            f"{stamps[i] - stamps[0]:.4g} s after the first sample: remove samples with wrong "
            "times, or split the log"
        )
    return np.arange(stamps[0], stamps[-1], period)


def find_airborne(speed: Array, t: Array, force: Array | None, robot: Robot) -> Mask:
    """Return the mask (n,) of flight, from the rotors' speeds (n, rotors) of any unit.

    The threshold is relative to the maximum speed, even of a short flight. A specific force (n, 3)
    m/s^2 that the rotors cannot produce ends the flight.
    """
    total = speed.sum(axis=1)
    turns = np.flatnonzero(total > AIRBORNE * np.max(total, initial=0.0))
    out = np.zeros(len(t), dtype=bool)
    out[turns] = True
    for a, b in pairwise(turns):
        out[a:b] |= t[b] - t[a] < SHORTEST_GROUND
    if force is not None:
        mass, _, _ = compute_body(build_body_model(robot), posture(robot, "folded"))
        most = HIT * speed.shape[1] * robot.rotors.thrust_max_n / mass
        out &= np.linalg.norm(force, axis=1) < most
    return out


def find_sampled(samples: Array, t: Array) -> Mask:
    """Return the mask (n,) of the times `t` s that are not in a gap of a signal.

    `samples` (k,) s are the times of the signal. A gap exceeds three usual intervals and LEAST_GAP.
    """
    return find_covered(samples, t, find_gap_limit(samples, LEAST_GAP))


def leave_out_gaps(free: Mask, sampled: Mask, t: Array, notes: list[str]) -> Mask:
    """Return the mask (n,) of flight without gaps of a signal; append a note on the lost time.

    `t` (n,) s is evenly spaced.
    """
    lost = free & ~sampled
    if lost.any():
        seconds = float(np.count_nonzero(lost)) * compute_period(t)
        notes.append(f"{seconds:.1f} s of flight lie in gaps of the log: not used")
    return free & sampled


def align_signs(q: Array) -> Array:
    """Return quaternions (n, 4) with consistent signs, for interpolation."""
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
    return np.asarray(q * np.append(1.0, flips)[:, None])


def move_to_origin(force: Array, w: Array, t: Array, robot: Robot) -> Array:
    """Return the specific force at B's origin from that at the inertial unit."""
    s = robot.sensors
    p = np.array([s.imu_x_m, s.imu_y_m, s.imu_z_m])
    if not np.any(p):
        return force
    wd = np.gradient(w, t, axis=0)
    return force - np.cross(wd, p) - np.cross(w, np.cross(w, p))


def find_rotations(q: Array) -> Array:
    """Return the matrices (n, 3, 3) of wxyz quaternions (n, 4), which need not be normalized."""
    a, b, c, d = (q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-9)).T
    R = np.empty((len(q), 3, 3))
    R[:, 0] = np.column_stack([1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)])
    R[:, 1] = np.column_stack([2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)])
    R[:, 2] = np.column_stack([2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)])
    return R
