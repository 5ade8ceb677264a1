"""Rotors that are saturated for a long time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Follow, Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses

LAG_S = 1.0


class Saturation(Rule):
    """Share of the time in which the allocation limited the command."""

    watches = "share of the last second in which the allocation limited the command"
    unit = ""
    shows_control = True
    every = 10
    source = "gusts and touch-downs of the built-in missions reach 0.5; 0.8 corresponds to 1.6 s"

    class Table(Rule.Table):
        """Limit as a share."""

        limit: NonNegative = 0.8
        hold_s: NonNegative = 1.0
        response: Response = "come_home"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._share = Follow(LAG_S)

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.bus import Allocated

        self._cut = v.place(Allocated, "saturated")

    def look(self, v: Senses) -> float:
        if self._cut is None:
            return math.nan
        return self._share.step(v.t, [1.0 if self._cut.tolist() > 0.0 else 0.0])[0]
