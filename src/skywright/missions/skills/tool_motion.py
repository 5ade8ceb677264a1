"""Durations of handling a tool with two hooks, before a flight."""

from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.moves import MoveSum, compute_move_s
from skywright.missions.skills.tool_handling import (
    ACCELERATION,
    DROP,
    FEEL_S,
    LIFT,
    LOW,
    NEAR_SPEED,
    PRESS,
    STEADY_S,
)

BACK = 0.35  # m, behind a load, where the platform arrives and departs
WEIGH_S = 1.0  # s, over which the force without the load is averaged
ALIGN_S = 1.0  # s, typical time until a suspended tool is over its place
STAND_S = 6.0 * FEEL_S
"""s, in which a tool that has come down passes its weight."""


class Speeds(NamedTuple):
    """Speeds (m/s) while a load passes to or from the hands."""

    hand: float
    lift: float


def compute_take_up_s(speeds: Speeds) -> float:
    """Return the duration (s) of a grasp and a lift that succeed at once."""
    return WEIGH_S + (LOW + PRESS) / speeds.hand + LIFT / speeds.lift + STEADY_S


def compute_put_down_s(speeds: Speeds, above: float) -> float:
    """Return the duration (s) of setting a tool down from `above` (m), and of the release."""
    down = WEIGH_S + ALIGN_S + above / speeds.lift + STAND_S
    return down + compute_move_s(DROP, speed=speeds.hand, acceleration=ACCELERATION)


def start_moves(home: Array) -> MoveSum:
    """Return a sum of moves of the platform near tools; `home` is the start (4,): m, rad."""
    R = rot_z(float(home[3]))
    return MoveSum(home[:3], R, speed=NEAR_SPEED, acceleration=ACCELERATION, least=1e-3)


def behind(p: Array, yaw: float, back: float = BACK) -> Array:
    """Return the platform's position before the approach; at p (3,) m its hands hold the load."""
    return np.asarray(p - back * rot_z(yaw)[:, 0] - [0.0, 0.0, DROP])
