"""The flown path, on which the robot returns after a rule acted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.types import TASK_JOINTS
from skywright.run.faults._room import hold_stuck
from skywright.run.faults._senses import Senses
from skywright.vehicle.arms.ports import ArmModel, HandState

Array = NDArray[np.float64]


class Crumb(NamedTuple):
    """The commanded pose and joints at one time."""

    p_WB: Array
    R_WB: Array
    q: Array
    away: Array  # unit vector away from the touched object, zero in free flight


class Trail:
    """The flown path, for the return."""

    PERIOD = 0.2  # s

    def __init__(self) -> None:
        self.crumbs: list[Crumb] = []
        self._next = 0.0

    def drop(self, v: Senses) -> None:
        """Store the commanded pose every PERIOD."""
        if v.t < self._next or v.reference["active"] < 0.5:
            return
        self._next = v.t + self.PERIOD
        self.crumbs.append(build_crumb(v))


def build_crumb(v: Senses) -> Crumb:
    """Return the present commanded pose and joints."""
    ref, away = v.reference, v.away if v.touching else np.zeros(3)
    return Crumb(np.array(ref["p_WB"]), np.array(ref["R_WB"]), goal_joints(v), away)


def goal_joints(v: Senses) -> Array:
    """Return the commanded angles of the servos, in the layout of a row's `q`.

    Joints that do not follow are set to their estimated angles: a law that controls a tip would
    compensate for them.
    """
    q, arm = np.array(v.reference["q"]), v.get(ArmModel)
    if arm is not None:
        goal = v.get(HandState).q_goal if v.posture is None else v.posture
        for h in range(arm.n_hands):
            if v.reference["task"][h] != TASK_JOINTS:
                mine = slice(arm.first[h], arm.first[h] + arm.n)
                q[mine] = goal[mine]
    return hold_stuck(v, q)
