"""Shortfall of the clearance that a mission keeps before it touches."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class TooClose(Rule):
    """Shortfall of the clearance that a mission keeps before it touches."""

    watches = (
        "shortfall of the clearance to the nominal scene that a mission keeps while it waits "
        "beside an object that it will touch"
    )
    unit = "m"
    source = "the mission sets the clearance from tilt, position error and gusts of its plan"
    every = 2

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = 0.0
        hold_s: NonNegative = 0.04
        response: Response = "come_home"

    def look(self, v: Senses) -> float:
        return math.nan if v.room is None or v.responding else -v.room()

    def explain(self, value: float) -> str:
        """State the shortfall."""
        return f"{1000.0 * value:.0f} mm too close to the object it works at"
