"""The robot no longer follows its reference, or has tipped over."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule
from skywright.vehicle.guard import ERROR_MAX, UP_MIN

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses

PATIENCE = 0.25
"""Of the distance that counts while the response of another rule is flown."""
TILT_MAX = math.acos(UP_MIN)
"""rad, beyond which it has tipped over."""


class LostControl(Rule):
    """Distance from the reference, as estimated; tipping over counts as 10 m."""

    watches = (
        "distance of the estimated from the commanded place; a tilt beyond 73 deg counts as 10 m"
    )
    unit = "m"
    source = "as the guard of the tick (vehicle/guard.py): no built-in flight strays so far"
    from_take_off = True

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = ERROR_MAX
        hold_s: NonNegative = 0.0
        response: Response = "let_go"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._tilt = 0.0

    def look(self, v: Senses) -> float:
        ref, est = v.reference, v.estimate
        self._tilt = math.acos(min(max(float(est["R_WB"][2, 2]), -1.0), 1.0))
        error = math.dist(est["p_WB"].tolist(), ref["p_WB"].tolist())
        if v.responding:  # what was pushed may come back: only a robot that tips over falls
            error *= PATIENCE
        return 10.0 + error if self._tilt > TILT_MAX else error

    def explain(self, value: float) -> str:
        """Say how far off it is."""
        error = value - 10.0 if self._tilt > TILT_MAX else value
        return (
            f"control was lost: {error:.2f} m from the reference, tilted "
            f"{math.degrees(self._tilt):.0f} deg"
        )
