"""An operator on the ground orders an immediate landing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class OperatorLand(Rule):
    """The ground station's button "land now"."""

    watches = "1 once the operator has ordered a landing at the ground station"
    unit = ""
    source = "the operator's order"
    from_take_off = True

    class Table(Rule.Table):
        """Any order exceeds the limit."""

        limit: NonNegative = 0.5
        response: Response = "land_here"

    def look(self, v: Senses) -> float:
        return float(v.order == "land")

    def explain(self, value: float) -> str:
        """State who ended the mission."""
        return "the operator ordered a landing"
