"""Which message one peer receives when: the default rates, and those that it requested.

A rate that a ground station requests (MAV_CMD_SET_MESSAGE_INTERVAL) applies to its own connection
only, as MAVLink specifies: two stations at one robot do not change each other's data.
"""

from __future__ import annotations

from collections.abc import Iterator

from skywright.links.mavlink.reports import RATES_HZ

RATE_MIN, RATE_MAX = 1.0 / 60.0, 50.0  # Hz: once a minute, and every tick
HEARTBEAT = 0


class Schedule:
    """Rates of the messages to one peer."""

    def __init__(self) -> None:
        self._rates = dict(RATES_HZ)
        self._due: dict[int, float] = {}

    def list_due(self, t: float) -> Iterator[int]:
        """Yield the messages that are due at time t (s); each is due again after its period."""
        for number, rate in self._rates.items():
            if rate > 0.0 and t >= self._due.get(number, 0.0) - 1e-9:
                period = 1.0 / rate
                self._due[number] = max(self._due.get(number, t) + period, t + 0.5 * period)
                yield number

    def hurry(self, number: int, t: float) -> None:
        """Make a message due at time t (s)."""
        self._due[number] = t

    def get_interval_us(self, number: int) -> int:
        """Return the interval of a message; -1: it is not sent."""
        rate = self._rates.get(number, 0.0)
        return round(1e6 / rate) if rate > 0.0 else -1

    def set_interval_us(self, number: int, interval: float) -> bool:
        """Change an interval: 0 is the default, below 0 never; return False for NaN."""
        if interval == 0.0:
            self._rates[number] = RATES_HZ.get(number, 0.0)
        elif interval < 0.0:
            self._rates[number] = 0.0 if number != HEARTBEAT else 1.0  # it cannot be disabled
        elif interval > 0.0:
            self._rates[number] = min(max(1e6 / interval, RATE_MIN), RATE_MAX)
        else:
            return False
        self._due.pop(number, None)
        return True
