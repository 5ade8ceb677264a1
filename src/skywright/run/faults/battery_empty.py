"""Battery nearly empty."""

from __future__ import annotations

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule
from skywright.run.faults.battery_low import BatteryLow


class BatteryEmpty(BatteryLow):
    """As battery_low, but the remaining energy is not enough for the return flight."""

    source = "5 % of 50 Wh supply a robot of 300 W for 30 s, enough for a landing"

    class Table(Rule.Table):
        """Limit as a share."""

        limit: NonNegative = 0.95
        hold_s: NonNegative = 0.5
        response: Response = "land_here"
