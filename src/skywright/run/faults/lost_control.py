"""The robot no longer follows its reference."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.core.types import MODE_STANDARD
from skywright.run.faults._rule import Response, Rule
from skywright.vehicle.bus import Estimate
from skywright.vehicle.guard import ERROR_MAX

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


PATIENCE = 0.25
"""Factor of the distance while another rule's response is flown, which may recover the robot."""


class LostControl(Rule):
    """Distance from the reference, as estimated."""

    watches = (
        "distance between estimated and commanded position; a quarter of it while the response of "
        "another rule is flown"
    )
    unit = "m"
    source = "as the guard of the tick (vehicle/guard.py): no built-in flight deviates this far"
    from_take_off = True
    shows_control = True

    class Table(Rule.Table):
        """Limit (m). A robot that drifts off in the wind still lands upright."""

        limit: NonNegative = ERROR_MAX
        hold_s: NonNegative = 0.0
        response: Response = "land_here"

    def begin(self, v: Senses) -> None:
        self._R_WB, self._p_WB = v.place(Estimate, "R_WB"), v.place(Estimate, "p_WB")

    def look(self, v: Senses) -> float:
        held = 2 if v.told("mode") == MODE_STANDARD else 0  # height only
        self._error = math.dist(self._p_WB.tolist()[held:], v.told("p_WB")[held:])
        return PATIENCE * self._error if v.responding else self._error

    def explain(self, value: float) -> str:
        """State the distance and the tilt."""
        up = min(max(self._R_WB[2, 2], -1.0), 1.0)
        tilt = math.degrees(math.acos(up))
        return f"control was lost: {self._error:.2f} m from the reference, tilted {tilt:.0f} deg"
