"""A robot that leaves the permitted volume."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class Geofence(Rule):
    """Distance by which the robot is outside `[mission.fence]`."""

    watches = "distance of the estimate outside the limits of `[mission.fence]`"
    unit = "m"
    source = "arrival counts within 0.05 m, gusts of the built-in missions move less than 0.2 m"

    class Table(Rule.Table):
        """Limit (m)."""

        limit: NonNegative = 0.2
        hold_s: NonNegative = 0.0
        response: Response = "come_home"

    def look(self, v: Senses) -> float:
        outside = v.fence.compute_excess(v.estimate["p_WB"].tolist())
        return outside if math.isfinite(outside) else math.nan
