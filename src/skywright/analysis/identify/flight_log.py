"""A flight as identification sees it, whatever recorded it: measured and commanded signals.

SI units, frames W (ENU) and B (FLU). All signals share one time axis.
"""

from typing import NamedTuple

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot


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
