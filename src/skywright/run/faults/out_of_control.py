"""The robot has tipped over, or does not follow the commanded descent."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule
from skywright.vehicle.bus import Estimate
from skywright.vehicle.guard import ERROR_MAX, UP_MIN

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses

TIPPED = 10.0
"""m, value reported for a robot that has tipped over."""


class OutOfControl(Rule):
    """Loss of control after which only stopping the motors ends the flight."""

    watches = (
        "difference between estimated and commanded height while the response of another rule is "
        "flown. At any time a tilt beyond 73 deg counts as 10 m"
    )
    unit = "m"
    source = "four times the distance at which control counts as lost"
    from_take_off = True
    shows_control = True

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = 4.0 * ERROR_MAX
        hold_s: NonNegative = 0.0
        response: Response = "let_go"

    def begin(self, v: Senses) -> None:
        self._R_WB, self._p_WB = v.place(Estimate, "R_WB"), v.place(Estimate, "p_WB")

    def look(self, v: Senses) -> float:
        if self._R_WB[2, 2] < UP_MIN:
            return TIPPED
        return abs(self._p_WB[2] - v.told("p_WB")[2]) if v.responding else 0.0

    def explain(self, value: float) -> str:
        """State the tilt, and the height error."""
        up = min(max(self._R_WB[2, 2], -1.0), 1.0)
        tilt = f"tilted {math.degrees(math.acos(up)):.0f} deg"
        if up < UP_MIN:
            most = math.degrees(math.acos(UP_MIN))
            return f"control was lost: the robot tipped over, {tilt} (limit {most:.0f} deg)"
        return f"control was lost: {value:.2f} m above or below the reference, {tilt}"
