"""A platform that is displaced while its hands approach something."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule
from skywright.vehicle.bus import Estimate

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class Strayed(Rule):
    """Distance from the reference, as estimated, beside a structure."""

    watches = (
        "distance between estimated and commanded position while empty hands approach an object"
    )
    unit = "m"
    source = "clearance of planned paths; three times the motion in the strongest accepted gusts"
    every = 2

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = 0.1
        hold_s: NonNegative = 0.04
        response: Response = "come_home"

    def begin(self, v: Senses) -> None:
        self._p_WB = v.place(Estimate, "p_WB")

    def look(self, v: Senses) -> float:
        if v.responding or not v.leads_hands or max(v.told("load")) > 0.0:
            return math.nan
        return math.dist(self._p_WB.tolist(), v.told("p_WB"))
