"""Durations of handling a tool with two hooks, before a flight."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.missions.skills.moves import compute_move_s
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


class Moves:
    """Sum of straight moves of the platform, each from the end of the one before."""

    def __init__(self, home: Array) -> None:
        """`home` is the start (4,): m, rad."""
        self.p, self.yaw, self.seconds = home[:3], float(home[3]), 0.0

    def go(
        self, p: Array, yaw: float, speed: float = NEAR_SPEED, acceleration: float = ACCELERATION
    ) -> None:
        """Add a move to p (3,) m and `yaw` (rad)."""
        distance, turn = float(np.linalg.norm(p - self.p)), math.remainder(yaw - self.yaw, math.tau)
        if max(distance, abs(turn)) > 1e-3:
            self.seconds += compute_move_s(
                distance, abs(turn), speed=speed, acceleration=acceleration
            )
        self.p, self.yaw = p, yaw
