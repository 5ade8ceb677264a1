"""Control of both hands by the stick, law (24), while the platform follows them.

The hands' goals are fixed in W, so that the arms compensate the platform's drift. The arms alone
reach down by 7 cm until their elbows are straight. The platform therefore follows the hands' goal
slowly, and the hands work in the posture in which the handle lies well in the hooks.
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

FOLLOW_RATE = 1.0  # 1/s, of the platform: it lags 3 cm behind hands that move at 3 cm/s
SEATED_M = 0.015  # m, in height, within which a tool counts as standing on the pipe
MOST = 1.5  # largest weight that is fed forward, relative to the tool's
NEAR_M = 1e-4  # m, remaining distance when the goal returns
UP = np.array([0.0, 0.0, 1.0])
FREE = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])  # m, fence of a goal without an operator


class LedHands:
    """Goal of both hands, moved by the stick; each step is one tick."""

    def __init__(
        self, s: Supervisor, weight: Weight, weight_n: float, yaw: float, goal: Array,
        platform: Array,
    ) -> None:  # fmt: skip
        """`weight_n` (N) is the tool's, `goal` (3,) m the initial goal, in a frame turned by `yaw`.

        `platform` (3,) m is the platform's position for hands at that goal.
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
        """Move the hands back to the initial goal: first up, then across."""
        for part in (UP, np.ones(3)):
            while float(np.linalg.norm(way := part * (self.start - self.goal))) > NEAR_M:
                self.step(way / max(float(np.linalg.norm(way)), MISSION_TICK * v_max), v_max, FREE)
        for _ in range(round(STEADY_S / MISSION_TICK)):
            self.step(np.zeros(3), v_max, FREE)
        hold_joints(self.s)


def explain_loss(R_WO: Array) -> str:
    """Return why the control of a tool at R_WO (3, 3) ends: tilted, or away from the hands."""
    if R_WO[2, 2] > math.cos(TILT_MAX):
        return "the tool fell off the hooks"
    tilt = math.degrees(math.acos(max(R_WO[2, 2], -1.0)))
    return f"the tool was tilted by {tilt:.0f} deg: operator control was stopped"


def describe_way(off: Array) -> str:
    """Return an offset (3,) m from a place as text, in mm."""
    return ", ".join(f"{1e3 * x:.0f}" for x in off) + " mm (ahead, left, up)"
