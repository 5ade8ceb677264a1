"""A force at probe or hand beyond what the mission may exert."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class ExcessForce(Rule):
    """Force sensor of the probe, or estimated force at each hand."""

    watches = "force of the probe's sensor, or the estimated force at a hand"
    unit = "N"
    source = "twice the largest force that the built-in missions ask for and reach"

    class Table(Rule.Table):
        """Limit (N)."""

        limit: NonNegative = 20.0
        hold_s: NonNegative = 0.1
        response: Response = "come_home"

    def look(self, v: Senses) -> float:
        from skywright.vehicle.arms.ports import HandForce

        force, n = abs(v.vehicle.force), v.hands
        if n:
            force = max(force, *(math.hypot(*f_W) for f_W in v.get(HandForce).f_WH[:n].tolist()))
        return force
