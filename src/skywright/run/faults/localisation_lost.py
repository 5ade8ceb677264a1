"""No sample of the localisation for seconds: the position is no longer measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class LocalisationLost(Rule):
    """Age of the localisation in flight."""

    watches = "age of the newest sample of the localisation"
    unit = "s"
    source = "inertial navigation alone drifts by centimetres in 2 s and by decimetres in a landing"
    from_take_off = True
    every = 10

    class Table(Rule.Table):
        """Limit (s)."""

        limit: NonNegative = 2.0
        hold_s: NonNegative = 0.0
        response: Response = "land_here"

    def bear_period(self, touches: bool) -> float:
        """Return the limit: fixes must be more frequent."""
        return float(self.table.limit)

    def look(self, v: Senses) -> float:
        return v.fix_age

    def explain(self, value: float) -> str:
        """State the age."""
        return f"no localisation for {value:.1f} s"
