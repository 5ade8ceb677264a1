"""A joint that does not follow: stuck, or without torque."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class JointOff(Rule):
    """Commanded less measured angle of the worst servo."""

    watches = "commanded less measured angle of a servo's shaft, the worst joint"
    unit = "rad"
    source = (
        "1.5 times what servos lag behind in the built-in moves; without torque a joint falls "
        "through 0.5 rad in the next 0.15 s"
    )
    every = 2

    class Table(Rule.Table):
        """Limit (rad)."""

        limit: NonNegative = 0.25
        hold_s: NonNegative = 0.04
        response: Response = "come_home"

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.arms.ports import ArmModel
        from skywright.vehicle.bus import Estimate, Reference, ServoDrive
        from skywright.vehicle.readings import Shafts

        n, arm = v.vehicle.n_joints, v.get(ArmModel)
        self._loose = arm is None  # a press lets its joints do what the force loop asks for
        told = v.place(Reference, "q") if self._loose else v.place(ServoDrive, "motor")
        seen = v.place(Estimate, "q") if self._loose else v.place(Shafts, "q")
        if n == 0 or told is None or seen is None:
            self._told = None
            return
        self._told, self._seen = told[:n], seen[:n]
        self._swing = -1 if arm is None else int(arm.swing)

    def look(self, v: Senses) -> float:
        if self._told is None:
            return math.nan
        off = [abs(a - b) for a, b in zip(self._told.tolist(), self._seen.tolist(), strict=True)]
        if self._swing >= 0:
            off[self._swing] = 0.0  # it has no servo
        worst = max(off)
        if worst > self.table.limit and self._loose and v.told("press") > 0.0:
            return math.nan
        return worst
