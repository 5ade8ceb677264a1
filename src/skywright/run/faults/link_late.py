"""A control link whose delay grows in flight beyond what the control loops tolerate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor

ARRIVALS = 5
"""Number of packets of which the median age is used: a lost packet increases the newest age."""
SIGMAS = 3.0
"""Standard deviations of the jitter in `[world.link]` by which an expected packet may be late.
Packets keep their order and queue, so the median of a link as specified reaches two."""


class LinkLate(Rule):
    """Age of the inertial samples that arrive over the link, divided by the tolerated delay."""

    watches = (
        "age of the inertial samples that arrive over the control link, by their time stamps, "
        "divided by the tolerated delay. This is the one-way delay at which the law is still "
        "stable (both ways are assumed equal), or the delay of `[world.link]` plus three standard "
        "deviations of its jitter, whichever is larger"
    )
    unit = ""
    source = "beyond it the attitude loop is unstable: the check before take-off has the same limit"
    from_take_off = True
    every = 1

    class Table(Rule.Table):
        """Limit as a share."""

        limit: NonNegative = 1.0
        hold_s: NonNegative = 0.0
        response: Response = "land_here"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._stamp: Any = None
        self._ages: list[float] = []  # s
        self._last = self.age = 0.0  # s
        self._most = math.nan  # s
        self._period = 0.0  # s, between the tick that read a packet and the rule's evaluation

    def begin(self, v: Senses) -> None:
        from skywright.run.link_limit import compute_most_delay
        from skywright.vehicle.readings import ImuBatch
        from skywright.vehicle.simulated import SimulatedVehicle

        vehicle = v.vehicle
        if isinstance(vehicle, SimulatedVehicle) and vehicle.has_link:
            self._stamp = v.place(ImuBatch, "t")
            link, self._period = vehicle.nominal.world.link, vehicle.dt
            self._most = compute_most_delay(vehicle.nominal, vehicle.law)
            if link.jitter_s > 0.0:  # the mission was accepted with this jitter
                expected = link.delay_s + SIGMAS * link.jitter_s + self._period
                self._most = max(self._most, expected)

    def look(self, v: Senses) -> float:
        if self._stamp is None or math.isnan(self._most):
            return math.nan
        stamp = self._stamp.tolist()
        if stamp > self._last:
            self._last = stamp
            self._ages = [*self._ages[1 - ARRIVALS :], v.t - self._period - stamp]
        if len(self._ages) < ARRIVALS:
            return 0.0
        self.age = sorted(self._ages)[ARRIVALS // 2]
        return self.age / max(self._most, 1e-9)

    def repair(self, s: Supervisor) -> Response:
        """Slow down the law until it tolerates that delay."""
        from skywright.run.link_limit import slow_down

        slow_down(s.vehicle, self.age)
        return super().repair(s)

    def explain(self, value: float) -> str:
        """State both delays."""
        return (
            f"the control link has a delay of {1000.0 * self.age:.1f} ms each way; tolerated: "
            f"{1000.0 * self._most:.1f} ms"
        )
