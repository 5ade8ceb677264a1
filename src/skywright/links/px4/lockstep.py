"""Lockstep with PX4: one packet of actuators answers each inertial sample. Uses no socket.

PX4's clock is that of the samples, so an answer carries the time of a sample. States:

- `absent`: no autopilot is connected. The rotors stand still.
- `starting`: PX4 boots; until its first actuators samples are sent at the pace of the wall clock.
- `locked`: the plant waits for the answer to each sample. Without an answer, its time pauses.

Invalid packets are counted by cause and change no command. Too many in a row end the connection.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from skywright.links.mavlink.stream import is_finite
from skywright.links.px4.sensors import compute_time_us

Array = NDArray[np.float64]
State = Literal["absent", "starting", "locked"]

ARMED = 128
"""Bit of HIL_ACTUATOR_CONTROLS.mode."""
LOCKSTEP = 1
"""Bit of its flags."""
SET_MESSAGE_INTERVAL = 511
TRUTH_ID = 115  # HIL_STATE_QUATERNION
CLOCK_US = 500_000
"""us, largest difference of PX4's clock from the last sample's."""
SAME_US = 1_000
"""us by which an answer may be older than its sample."""
REFUSALS_MAX = 50
"""Refused packets in a row that end a connection: the other end is not a PX4 in lockstep."""
CAUSES = {
    "duplicate": "an answer that came before, or is older than the last one",
    "clock": "an answer whose time is not that of the samples",
    "numbers": "actuators that are not finite",
    "no lockstep": "actuators of a PX4 that was built without lockstep",
}
"""Cause of a refused answer -> description."""


class Lockstep:
    """The exchange with one autopilot."""

    def __init__(self, n_rotors: int) -> None:
        self.n = n_rotors
        self.state: State = "absent"
        self.counts: Counter[str] = Counter()
        self.command = np.zeros(n_rotors)
        """Shares (n,) of the rotors' full speeds, 0 while disarmed."""
        self.armed = False
        self.truth_interval: float | None = None
        """Last requested interval (us) of the truth; the reader resets it to None."""
        self._sent_us = 0
        self._answered_us = self._last_us = -1
        self._refused = 0

    def connect(self) -> None:
        """Start with a newly connected autopilot; a restarted one begins anew."""
        self._stop("starting")

    def disconnect(self) -> None:
        """Handle the end of a connection: as on a vehicle, rotors without commands stop."""
        self._stop("absent")

    def _stop(self, state: State) -> None:
        self.state, self.armed = state, False
        self.command[:] = 0.0
        self._answered_us = self._last_us = -1
        self._refused, self._cause = 0, ""

    def send(self, t: float) -> None:
        """Record that the sample of the plant's time `t` (s) has been sent."""
        self._sent_us = compute_time_us(t)

    @property
    def is_waiting(self) -> bool:
        """Whether the plant must wait for an answer."""
        return self.state == "locked" and self._answered_us < self._sent_us - SAME_US

    @property
    def trouble(self) -> str:
        """Return why the connection must end, or ""."""
        if self._refused < REFUSALS_MAX:
            return ""
        return f"{self._refused} packets in a row were refused: {CAUSES[self._cause]}"

    def take(self, message: Any) -> None:
        """Process a message of the autopilot."""
        kind = message.get_type()
        if kind == "HIL_ACTUATOR_CONTROLS":
            self._take_actuators(message)
        elif kind == "COMMAND_LONG" and _asks_for_truth(message):
            self.truth_interval = float(message.param2)
        # heartbeats and other messages need no answer

    def _take_actuators(self, message: Any) -> None:
        cause = self._find_cause(message)
        if cause is not None:
            self.counts[cause] += 1
            self._refused, self._cause = self._refused + 1, cause
            if cause == "numbers":  # it is an answer; the last command is held
                self._answered_us = self._sent_us
            return
        self._refused = 0
        self._answered_us = self._last_us = int(message.time_usec)
        self.state = "locked"
        self.counts["answers"] += 1
        self.armed = bool(message.mode & ARMED)
        wanted = np.array(message.controls[: self.n], np.float64)
        self.command[:] = np.clip(wanted, 0.0, 1.0) if self.armed else 0.0

    def _find_cause(self, message: Any) -> str | None:
        if not message.flags & LOCKSTEP:
            return "no lockstep"
        if abs(int(message.time_usec) - self._sent_us) > CLOCK_US:
            return "clock"
        if self._answered_us >= 0 and int(message.time_usec) <= self._last_us:
            return "duplicate"
        if not message.mode & ARMED:  # the motors stop, whatever the numbers
            return None
        return None if np.all(np.isfinite(message.controls[: self.n])) else "numbers"


def _asks_for_truth(message: Any) -> bool:
    asked = message.command == SET_MESSAGE_INTERVAL and message.param1 == TRUTH_ID
    return asked and is_finite(message, "param2")
