"""A battery from which no more may be used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class BatteryLow(Rule):
    """Share of the battery's energy that was used."""

    watches = "share of the battery's energy that was used, by its gauge"
    unit = ""
    source = "robot.battery.usable_fraction of the built-in robots"
    from_take_off = True
    every = 25

    class Table(Rule.Table):
        """Limit as a share."""

        limit: NonNegative = 0.8
        hold_s: NonNegative = 0.5
        response: Response = "come_home"

    def look(self, v: Senses) -> float:
        from skywright.vehicle.sensors.fuel_gauge import Telemetry

        seen = v.get(Telemetry)
        return float("nan") if seen is None else 1.0 - float(seen.charge)
