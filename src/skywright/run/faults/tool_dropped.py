"""A carried object that is no longer at the hands."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

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
        self._hung: Any = None

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.arms.ports import Hands, Marker

        self._marker, self._hands = v.get(Marker), v.get(Hands)

    def look(self, v: Senses) -> float:
        marker, hands = self._marker, self._hands
        if marker is None or hands is None:
            return math.nan
        if max(v.told("load")) <= 0.0:
            self._hung = None
            return math.nan
        R_WB = v.estimate["R_WB"]
        place = R_WB.T @ (marker.p_WO - np.mean(hands.p_WH[: v.hands], axis=0))
        if self._hung is None:
            self._hung = place
        return float(np.linalg.norm(place - self._hung))
