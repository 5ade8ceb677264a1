"""The servos' play-time profiles, updated at their middle (Suarez 2020, section V-C).

A servo takes a goal g and a play time, here two command periods 2 T, and moves there on a
trapezoid; the next goal is sent at the middle and the velocity stays continuous. With the ramps at
half of the time each (a triangle) the profile from x at speed v accelerates by
a = (g - x - 3/2 v T) / T^2 and is, at the middle,

    x' = x + v T + a T^2 / 2 = x/2 + v T/4 + g/2,      v' T = v T + a T^2 = g - x - v T/2.

Its matrix [[1/2, 1/4], [-1, -1/2]] is nilpotent: the goal is reached after two updates, exactly,
without overshoot. A goal that moves at a constant speed is followed 3/2 T late.
"""

from __future__ import annotations

from typing import Any

from numba import njit

Record = Any

PROFILE_LAG = 1.5
"""Command periods by which a moving goal is followed late."""


@njit(cache=True, error_model="numpy")
def update_at_middle(x: float, w: float, goal: float) -> tuple[float, float]:
    """Return (x, w) at the middle of a profile from x, at w = v T (speed x period), to `goal`."""
    return 0.5 * x + 0.25 * w + 0.5 * goal, goal - x - 0.5 * w


@njit(cache=True, error_model="numpy")
def follow_profile(arms: Record, j: int, goal: float) -> None:
    """Advance joint j's profile (arms.q_goal, arms.w_goal) towards `goal` (rad), speed-limited."""
    x = arms.q_goal[j]
    reach = arms.speed_max * arms.dt
    new, w = update_at_middle(x, arms.w_goal[j], goal)
    arms.q_goal[j] = x + min(max(new - x, -reach), reach)
    arms.w_goal[j] = min(max(w, -reach), reach)
