"""Fault rule: the control link delivers no data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class LinkSilent(Rule):
    """Age of the newest inertial sample received over the link."""

    watches = "age of the newest inertial sample that came over the control link"
    unit = "s"
    source = "the attitude loops cross over at 20 rad/s and more: their period is 0.3 s"
    from_take_off = True
    every = 4

    class Table(Rule.Table):
        """Limit (s)."""

        limit: NonNegative = 0.1
        hold_s: NonNegative = 0.0
        response: Response = "land_here"

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.readings import ImuBatch

        self._heard = v.place(ImuBatch, "t")

    def look(self, v: Senses) -> float:
        return math.nan if self._heard is None else v.t - self._heard.tolist()
