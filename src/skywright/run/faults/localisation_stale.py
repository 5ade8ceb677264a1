"""No sample of the localisation for a fraction of a second, during contact."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class LocalisationStale(Rule):
    """Age of the localisation during contact, where millimetres matter."""

    watches = "age of the newest sample of the localisation, while something is touched"
    unit = "s"
    source = "inertial navigation alone stays within a millimetre for 0.2 s"

    class Table(Rule.Table):
        """Limit (s)."""

        limit: NonNegative = 0.2
        hold_s: NonNegative = 0.0
        response: Response = "hold"

    def bear_period(self, touches: bool) -> float:
        """Return the limit if the mission touches something: fixes must then be more frequent."""
        return float(self.table.limit) if touches else math.inf

    def look(self, v: Senses) -> float:
        age = v.fix_age
        if age > self.table.limit and not (v.touching or v.responding):
            return math.nan
        return age
