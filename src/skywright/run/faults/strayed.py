"""A platform that is driven from its place while its hands are led to something."""

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
        "distance of the estimated from the commanded position while hands are led that carry "
        "nothing"
    )
    unit = "m"
    source = "what ways keep from everything; three times the motion in gusts that plans admit"
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
