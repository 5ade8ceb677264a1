"""Fault rule: the force at probe or hand exceeds the limit of the mission."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule
from skywright.vehicle.bus import Estimate

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class ExcessForce(Rule):
    """Force of the probe's sensor, or the estimated force at a hand, whichever is largest."""

    watches = "force of the probe's sensor, or the estimated force at a hand"
    unit = "N"
    source = (
        "twice the largest force that the built-in missions reach; those that press set their own"
    )

    class Table(Rule.Table):
        """Limit (N)."""

        limit: NonNegative = 20.0
        hold_s: NonNegative = 0.1
        response: Response = "come_home"

    def begin(self, v: Senses) -> None:
        self._force = v.place(Estimate, "f_tip")

    def look(self, v: Senses) -> float:
        return max(abs(self._force.tolist()), *v.list_forces(), 0.0)
