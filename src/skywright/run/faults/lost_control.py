"""The robot no longer follows its reference, or has tipped over."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.core.types import MODE_STANDARD
from skywright.run.faults._rule import Response, Rule
from skywright.vehicle.bus import Estimate
from skywright.vehicle.guard import ERROR_MAX, UP_MIN

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses

PATIENCE = 0.25
"""Of the distance that counts while the response of another rule is flown."""


class LostControl(Rule):
    """Distance from the reference, as estimated; tipping over counts as 10 m."""

    watches = (
        "distance of the estimated from the commanded position; a tilt beyond 73 deg counts as 10 m"
    )
    unit = "m"
    source = "as the guard of the tick (vehicle/guard.py): no built-in flight strays so far"
    from_take_off = True

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = ERROR_MAX
        hold_s: NonNegative = 0.0
        response: Response = "let_go"

    def begin(self, v: Senses) -> None:
        self._R_WB, self._p_WB = v.place(Estimate, "R_WB"), v.place(Estimate, "p_WB")
        self._error = 0.0

    def look(self, v: Senses) -> float:
        held = 2 if v.told("mode") == MODE_STANDARD else 0  # the height alone
        error = self._error = math.dist(self._p_WB.tolist()[held:], v.told("p_WB")[held:])
        if v.responding:  # what was pushed may come back: only a robot that tips over falls
            error *= PATIENCE
        return 10.0 + error if self._R_WB[2, 2] < UP_MIN else error

    def explain(self, value: float) -> str:
        """Say how far off it is."""
        up = min(max(self._R_WB[2, 2], -1.0), 1.0)
        tilt = f"tilted {math.degrees(math.acos(up)):.0f} deg"
        if up < UP_MIN:
            most = math.degrees(math.acos(UP_MIN))
            return f"control was lost: the robot tipped over, {tilt} (limit {most:.0f} deg)"
        return f"control was lost: {self._error:.2f} m from the reference, {tilt}"
