"""Contact in a phase without intended contact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Follow, Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses

USUAL_S = 2.0
"""s, lag of the baseline: wind and model errors."""
FREE_S = 2.0
"""s without contact before a force counts as unintended."""
FOLLOWS = 5
"""Evaluations (0.2 s, a tenth of the lag) between updates of the baseline."""


class UnintendedContact(Rule):
    """Estimated external force less its recent mean, divided by the weight of the robot."""

    watches = (
        "estimated external force less its mean of 2 s, divided by the weight, in phases without "
        "intended contact"
    )
    unit = ""
    source = "above the largest value in gusts of 3 m/s and in the hardest built-in manoeuvre"
    every = 2

    class Table(Rule.Table):
        """Limit as a share of the weight."""

        limit: NonNegative = 0.25
        hold_s: NonNegative = 0.04
        response: Response = "come_home"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._usual = Follow(USUAL_S)  # N
        self._looks, self._free = 0, 0.0

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.arms.ports import Wrench
        from skywright.vehicle.bus import Body, Estimate

        self._body, self._free = v.get(Body), v.t
        self._weigh()
        self._force = v.place(Wrench, "f_rest_W") or v.place(Estimate, "f_ext_W")

    def look(self, v: Senses) -> float:
        x, y, z = self._force.tolist()
        self._looks += 1
        if self._looks % FOLLOWS == 0:
            self._follow(v, [x, y, z])
        if self._usual.value is None:
            return math.nan
        a, b, c = self._usual.value
        off = math.hypot(x - a, y - b, z - c) / self._weight
        if off > self.table.limit and (v.engaged or v.t - self._free <= FREE_S):
            return math.nan
        return off

    def _weigh(self) -> None:
        self._weight = float(self._body.mass * self._body.gravity)  # including a load

    def _follow(self, v: Senses, f_W: list[float]) -> None:
        """Update the baseline, except near a structure: contact forces must not enter it."""
        self._weigh()
        if v.engaged:
            self._free, self._usual = v.t, Follow(USUAL_S)
        else:
            self._usual.step(v.t, f_W)
