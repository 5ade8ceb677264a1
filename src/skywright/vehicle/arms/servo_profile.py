"""The servos' play-time profiles, updated at their middle (Suarez 2020, section V-C).

A servo takes a goal g and a play time, here two command periods 2 T, and moves there on a
trapezoid; the next goal is sent at the middle and the velocity stays continuous. With the ramps at
half of the time each (a triangle) the profile from x at speed v accelerates by
a = (g - x - 3/2 v T) / T^2 and is, at the middle,

    x' = x + v T + a T^2 / 2 = x/2 + v T/4 + g/2,      v' T = v T + a T^2 = g - x - v T/2.

Its matrix [[1/2, 1/4], [-1, -1/2]] is nilpotent: the profile reaches the goal exactly after two
updates, without overshoot. It follows a goal of constant speed with a lag of 3/2 T.
"""

from __future__ import annotations

from skywright.vehicle.arms.view import ArmsView
from skywright.vehicle.component import helper

PROFILE_LAG = 1.5
"""Lag behind a moving goal, in command periods."""


@helper
def update_at_middle(x: float, w: float, goal: float) -> tuple[float, float]:
    """Return (x, w) at the middle of a profile from x, at w = v T (speed x period), to `goal`."""
    return 0.5 * x + 0.25 * w + 0.5 * goal, goal - x - 0.5 * w


@helper
def follow_profile(v: ArmsView, j: int, goal: float) -> None:
    """Advance joint j's profile (q_goal, w_goal) towards `goal` (rad), speed-limited."""
    x = v.state.q_goal[j]
    reach = v.arm.speed_max * v.arm.dt
    new, w = update_at_middle(x, v.me.w_goal[j], goal)
    v.state.q_goal[j] = x + min(max(new - x, -reach), reach)
    v.me.w_goal[j] = min(max(w, -reach), reach)
