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
"""Number of packets of which the median delay is used."""
SIGMAS = 3.0
"""Standard deviations of the jitter in `[world.link]` by which an expected packet may be late.
Packets keep their order and queue, so the median of a link as specified reaches two."""


class LinkLate(Rule):
    """Delay of the packets that arrive over the link, divided by the tolerated delay."""

    watches = (
        "delay of the packets that arrive over the control link, by their time stamps, divided by "
        "the tolerated delay. This is the one-way delay at which the law is still stable (both "
        "ways are assumed equal), or the delay of `[world.link]` plus three standard deviations "
        "of its jitter, whichever is larger. Lost packets do not count"
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
        self._sent: Any = None
        self._delay: Any = None
        self._delays: list[float] = []  # s
        self._last = self.delay = 0.0  # s
        self._most = math.nan  # s

    def begin(self, v: Senses) -> None:
        from skywright.models.link_age import compute_age_by_loss
        from skywright.run.link_limit import compute_most_delay
        from skywright.vehicle.link import Reception
        from skywright.vehicle.simulated import SimulatedVehicle

        vehicle = v.vehicle
        if isinstance(vehicle, SimulatedVehicle) and vehicle.has_link:
            self._sent, self._delay = v.place(Reception, "sent"), v.place(Reception, "delay")
            link = vehicle.nominal.world.link
            # of the tolerated age, lost packets take their share
            self._most = compute_most_delay(vehicle.nominal, vehicle.law)
            self._most -= compute_age_by_loss(link, vehicle.dt)
            if link.jitter_s > 0.0:  # the mission was accepted with this jitter
                expected = link.delay_s + SIGMAS * link.jitter_s + vehicle.dt
                self._most = max(self._most, expected)

    def look(self, v: Senses) -> float:
        if self._sent is None or math.isnan(self._most):
            return math.nan
        sent = self._sent.tolist()
        if sent > self._last:
            self._last = sent
            self._delays = [*self._delays[1 - ARRIVALS :], self._delay.tolist()]
        if len(self._delays) < ARRIVALS:
            return 0.0
        self.delay = sorted(self._delays)[ARRIVALS // 2]
        return self.delay / max(self._most, 1e-9)

    def repair(self, s: Supervisor) -> Response:
        """Slow down the law until it tolerates that delay."""
        from skywright.run.link_limit import slow_down

        slow_down(s.vehicle, self.delay)
        return super().repair(s)

    def explain(self, value: float) -> str:
        """State both delays."""
        return (
            f"the control link has a delay of {1000.0 * self.delay:.1f} ms each way; tolerated: "
            f"{1000.0 * self._most:.1f} ms"
        )
