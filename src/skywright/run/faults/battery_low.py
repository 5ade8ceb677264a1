"""Fault rule: the usable energy of the battery is spent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class BatteryLow(Rule):
    """Used share of the battery's energy."""

    watches = "share of the battery's energy that was used, by its gauge"
    unit = ""
    source = "robot.battery.usable_fraction of the built-in robots"
    from_take_off = True
    every = 25

    class Table(Rule.Table):
        """Limit (share of the energy)."""

        limit: NonNegative = 0.8
        hold_s: NonNegative = 0.5
        response: Response = "come_home"

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.readings import Telemetry

        self._charge = v.place(Telemetry, "charge")

    def look(self, v: Senses) -> float:
        return math.nan if self._charge is None else 1.0 - self._charge.tolist()
