"""A carried object that is no longer at the hands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class ToolDropped(Rule):
    """Displacement of the carried object relative to the hands."""

    watches = (
        "displacement of the carried object relative to the hands since it was lifted, measured "
        "by its marker"
    )
    unit = "m"
    source = "a tool that swings on its hooks moves by less than 0.1 m"

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = 0.15
        hold_s: NonNegative = 0.1
        response: Response = "come_home"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._hung: list[float] | None = None  # where it hung when it was lifted, in B

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.arms.ports import Hands, Marker
        from skywright.vehicle.bus import Estimate

        fields = (Marker, "p_WO"), (Hands, "p_WH"), (Estimate, "R_WB")
        self._places = [v.place(*field) for field in fields]

    def look(self, v: Senses) -> float:
        n = v.hands
        if None in self._places or n == 0:
            return math.nan
        if max(v.told("load")) <= 0.0:
            self._hung = None
            return math.nan
        p_WO, p_WH, R_WB = (place.tolist() for place in self._places)
        away = [p_WO[i] - sum(p[i] for p in p_WH[:n]) / n for i in range(3)]
        place = [sum(R_WB[i][j] * away[i] for i in range(3)) for j in range(3)]
        if self._hung is None:
            self._hung = place
        return math.dist(place, self._hung)
