"""A flight as identification sees it, whatever recorded it: measured and commanded signals.

SI units, frames W (ENU) and B (FLU). All signals share one time axis.
"""

from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot

FASTEST = 250.0  # Hz, of the common time axis
GRAVITY = 9.80665
AIRBORNE = 0.35  # of the largest sum of rotor speeds: idling is at 0.2 or less, and a robot that
# lifts itself hovers at this where its largest thrust is 8 times its weight


class FlightLog(NamedTuple):
    """n samples of a flight; NaN-free where `free` holds."""

    name: str
    robot: Robot
    t: Array  # (n,) s, evenly spaced
    free: Mask  # (n,) in the air, touching nothing
    v_WB: Array  # (n, 3) m/s
    R_WB: Array  # (n, 3, 3)
    w_WB_B: Array  # (n, 3) rad/s
    specific_force_B: Array | None  # (n, 3) m/s^2 at B's origin; None: from v_WB
    rotor_speed: Array | None  # (n, rotors) rad/s, measured; None: only commanded
    rotor_command: Array | None  # (n, rotors) rad/s, or N where `command_is_thrust`
    command_is_thrust: bool
    joints: tuple[str, ...]
    q: Array  # (n, joints) rad, measured
    servo_unit: str  # "rad/s" where servos take a velocity, "rad" where they take an angle
    servo_command: Array  # (n, joints) in that unit
    servo_response: Array  # (n, joints)
    gravity: float
    air_density: float
    notes: tuple[str, ...] = ()


def align_signs(q: Array) -> Array:
    """Return quaternions (n, 4) with the same sign throughout, so that they may be interpolated."""
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
    return np.asarray(q * np.append(1.0, flips)[:, None])


def find_rotations(q: Array) -> Array:
    """Return the matrices (n, 3, 3) of wxyz quaternions (n, 4) of any length but 0."""
    a, b, c, d = (q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-9)).T
    R = np.empty((len(q), 3, 3))
    R[:, 0] = np.column_stack([1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)])
    R[:, 1] = np.column_stack([2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)])
    R[:, 2] = np.column_stack([2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)])
    return R
