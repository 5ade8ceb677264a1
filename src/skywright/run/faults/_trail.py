"""The way that was flown, to come back on after a rule acted."""

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
    """Where the robot was commanded to be."""

    p_WB: Array
    R_WB: Array
    q: Array
    away: Array  # unit vector from what it touched, zero in free flight


class Trail:
    """The way that was flown, to come back on."""

    PERIOD = 0.2  # s

    def __init__(self) -> None:
        self.crumbs: list[Crumb] = []
        self._next = 0.0

    def drop(self, v: Senses) -> None:
        """Note where the robot is to be, now and then."""
        if v.t < self._next or v.reference["active"] < 0.5:
            return
        self._next = v.t + self.PERIOD
        self.crumbs.append(build_crumb(v))


def build_crumb(v: Senses) -> Crumb:
    """Return where the robot is commanded to be now."""
    ref, away = v.reference, v.away if v.touching else np.zeros(3)
    return Crumb(np.array(ref["p_WB"]), np.array(ref["R_WB"]), goal_joints(v), away)


def goal_joints(v: Senses) -> Array:
    """Return where the servos lead the joints, in the layout of a row's `q`.

    Joints that do not follow are where they are: a law that leads a tip would make up for them.
    """
    q, arm = np.array(v.reference["q"]), v.get(ArmModel)
    if arm is not None:
        goal = v.get(HandState).q_goal if v.posture is None else v.posture
        for h in range(arm.n_hands):
            if v.reference["task"][h] != TASK_JOINTS:
                mine = slice(arm.first[h], arm.first[h] + arm.n)
                q[mine] = goal[mine]
    return hold_stuck(v, q)
