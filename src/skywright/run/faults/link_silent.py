"""A control link that delivers nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class LinkSilent(Rule):
    """Age of the newest inertial sample that came over the link."""

    watches = "age of the newest inertial sample that came over the control link"
    unit = "s"
    source = "the attitude loops cross over at 20 rad/s and more: their period is 0.3 s"
    from_take_off = True
    every = 2

    class Table(Rule.Table):
        """Limit (s)."""

        limit: NonNegative = 0.1
        hold_s: NonNegative = 0.0
        response: Response = "land_here"

    def look(self, v: Senses) -> float:
        from skywright.vehicle.readings import ImuBatch

        imu = v.get(ImuBatch)
        return float("nan") if imu is None else v.t - float(imu.t)
