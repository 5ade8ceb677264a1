"""A robot that comes nearer to a thing than any wind that its plan admits brings it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class TooClose(Rule):
    """What is missing of the distance that a mission keeps until it touches."""

    watches = (
        "what is missing of the distance to the nominal scene that a mission keeps while it waits "
        "beside a thing that it comes up to, until it is to touch it"
    )
    unit = "m"
    source = "the mission keeps what the lean, place and gusts of its plan leave"
    every = 2

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = 0.0
        hold_s: NonNegative = 0.04
        response: Response = "come_home"

    def look(self, v: Senses) -> float:
        return math.nan if v.room is None or v.responding else -v.room()

    def explain(self, value: float) -> str:
        """Say it as a reason."""
        return f"{1000.0 * value:.0f} mm too close to what it works at"
