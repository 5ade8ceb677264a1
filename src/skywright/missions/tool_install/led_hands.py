"""Both hands led by the stick, law (24), with the platform behind them.

The hands are led in W, so that they make up for the platform's drift. The arms alone reach 7 cm
down before their elbows are straight; so the platform follows the hands' goal slowly, and they
work where the handle lies well in the hooks.
"""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.operated import compute_velocity
from skywright.missions.skills.tool_handling import (
    STEADY_S,
    TILT_MAX,
    Weight,
    hold_joints,
)
from skywright.run.supervisor import Supervisor
from skywright.vehicle.plant import MISSION_TICK

FOLLOW_RATE = 1.0  # 1/s, of the platform: it is 3 cm behind hands that move at 3 cm/s
SEATED_M = 0.015  # m, in height, within which a tool counts as standing on the pipe
MOST = 1.5  # of the tool's weight, that is fed forward
NEAR_M = 1e-4  # m, to which the goal is led back
UP = np.array([0.0, 0.0, 1.0])
FREE = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])  # m, of a goal that no stick leads


class LedHands:
    """The hands' goal, and what the stick makes of it; each step is one tick."""

    def __init__(
        self, s: Supervisor, weight: Weight, weight_n: float, yaw: float, goal: Array,
        platform: Array,
    ) -> None:  # fmt: skip
        """`weight_n` (N) is the tool's, `goal` (3,) m where the work begins, in a frame of `yaw`.

        `platform` (3,) m is where it shall be for the hands to be there.
        """
        self.s, self.weight, self.most = s, weight, MOST * weight_n
        self.R, self.start, self.goal = rot_z(yaw), np.array(goal), np.array(goal)
        self._led, self._platform = np.zeros(3), np.array(platform)

    def step(self, axes: Array, v_max: float, fence: Array) -> None:
        """Move the goal by (24), inside `fence` (2, 3) m, and fly a tick."""
        s = self.s
        v = compute_velocity(axes, v_max, self.goal, fence)
        self.goal, self._led = self.goal + MISSION_TICK * v, self._led + MISSION_TICK * (self.R @ v)
        s.arms.hands_velocity({"left": self.R @ v, "right": self.R @ v})
        behind = self._platform + self._led - s.vehicle.reference["p_WB"]
        self.weight.step(s, FOLLOW_RATE * behind, self.most)

    def go_back(self, v_max: float) -> None:
        """Lead the hands back to where the work began: first up, then across."""
        for part in (UP, np.ones(3)):
            while float(np.linalg.norm(way := part * (self.start - self.goal))) > NEAR_M:
                self.step(way / max(float(np.linalg.norm(way)), MISSION_TICK * v_max), v_max, FREE)
        for _ in range(round(STEADY_S / MISSION_TICK)):
            self.step(np.zeros(3), v_max, FREE)
        hold_joints(self.s)


def explain_loss(R_WO: Array) -> str:
    """Say why a tool at R_WO (3, 3) is not led any further: tilted, or away from the hands."""
    if R_WO[2, 2] > math.cos(TILT_MAX):
        return "the tool fell off the hooks"
    tilt = math.degrees(math.acos(max(R_WO[2, 2], -1.0)))
    return f"the tool was tilted by {tilt:.0f} deg: operator control was stopped"


def describe_way(off: Array) -> str:
    """Say in mm where something is from its place, off (3,) m."""
    return ", ".join(f"{1e3 * x:.0f}" for x in off) + " mm (ahead, left, up)"
