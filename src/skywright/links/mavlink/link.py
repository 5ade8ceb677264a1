"""A companion computer's link to a MAVLink vehicle: received state, and a steady stream of
set-points.

A separate thread receives and sends every 20 ms by the monotonic clock, independent of the mission.
If a set-point is not renewed for 0.1 s, its velocity becomes zero and the vehicle holds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from skywright.links.mavlink.attitude_target import AttitudeTarget
from skywright.links.mavlink.endpoint import Endpoint
from skywright.links.mavlink.frames import find_heading, swap_heading, swap_world, to_ned_quaternion
from skywright.links.mavlink.heard import Heard

Array = NDArray[np.float64]

PERIOD = 0.02  # s between set-points
SYNC_S = 0.1  # s between requests whose answers show that both directions work
RENEWED_S = 0.1  # s for which a set-point is sent unchanged
ONBOARD, GENERIC_AUTOPILOT_NONE, ACTIVE = 18, 8, 4
SET_INTERVAL, REQUEST_MESSAGE = 511, 512
WANTED = {32: 50.0, 31: 50.0, 245: 5.0, 230: 2.0, 1: 2.0, 49: 0.2, 242: 0.5}
"""Message -> requested rate (Hz)."""
ACK_S, TRIES = 0.7, 3  # s of waiting for an answer, and number of attempts
COMMAND_S = 10.0  # s of waiting in all, also for a command that is reported as in progress
RESULTS = {
    0: "accepted", 1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed",
    5: "in progress", 6: "cancelled",
}  # fmt: skip
IN_PROGRESS = 5
LARGEST = 1e9
"""Largest magnitude of a number in a set-point; NaN fails the comparison."""


class Clock(Protocol):
    """The monotonic clock, or one that a test controls."""

    threaded: bool

    def now(self) -> float:
        """Return s."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class WallClock:
    """The monotonic clock."""

    threaded = True

    def now(self) -> float:
        """Return s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(max(seconds, 0.0))


class Target(NamedTuple):
    """A set-point of the vehicle, in its local frame (ENU)."""

    p: Array  # (3,) m
    v: Array  # (3,) m/s
    a: Array  # (3,) m/s^2
    R_WB: Array
    rate: float  # rad/s, of the heading
    f_B: Array | None = None  # (3,) shares of all rotors' thrust along B: attitude and force

    @property
    def is_sound(self) -> bool:
        """Whether all its numbers are finite and fit into a message."""
        f_B = np.zeros(3) if self.f_B is None else self.f_B
        row = [*self.p, *self.v, *self.a, *self.R_WB.flat, self.rate, *f_B]
        return bool(np.abs(row).max() < LARGEST)


class VehicleLink:
    """One vehicle at the other end of an endpoint."""

    def __init__(
        self, endpoint: Endpoint, clock: Clock | None = None,
        wanted: Mapping[int, float] = MappingProxyType(WANTED),
    ) -> None:  # fmt: skip
        """`wanted` are the requested messages and their rates (Hz)."""
        self._wanted = wanted
        self.endpoint, self.clock = endpoint, clock or WallClock()
        self.heard = Heard(endpoint.ids)
        self.lock = threading.RLock()
        self.sent = 0  # number of set-points
        self.failure = ""
        """Last error of the thread, or ""; reported with the silence that it causes."""
        self._target: tuple[float, Target] | None = None
        self._next_beat = self._next_sync = self._next_ask = 0.0
        self._ending = threading.Event()
        self._dialect = (
            next(iter(endpoint.peers.values())).stream.dialect if endpoint.peers else None
        )
        self._thread: threading.Thread | None = None
        if self.clock.threaded:
            self._thread = threading.Thread(target=self._run, daemon=True, name="mavlink")
            self._thread.start()

    @property
    def dialect(self) -> Any:
        """pymavlink's dialect."""
        if self._dialect is None:
            from skywright.links.mavlink.stream import load_dialect

            self._dialect = load_dialect()
        return self._dialect

    def close(self) -> None:
        """End the thread and close the endpoint."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(1.0)
        self.endpoint.close()

    def _run(self) -> None:
        due = self.clock.now()
        while not self._ending.is_set():
            try:
                self.step()
            except Exception as error:  # the stream goes on
                self.failure = f"{type(error).__name__}: {error}"
            due = max(due + PERIOD, self.clock.now() - PERIOD)
            self._ending.wait(max(due - self.clock.now(), 0.0))

    # --- the stream --------------------------------------------------------------------------

    def lead(self, target: Target | None) -> None:
        """Renew the set-point; None ends the stream.

        A set-point with an invalid number does not renew it: the vehicle holds after RENEWED_S.
        """
        if target is not None and not target.is_sound:
            return
        with self.lock:
            self._target = None if target is None else (self.clock.now(), target)

    def step(self) -> None:
        """Process received messages and send those that are due."""
        self.hear()
        now = self.clock.now()
        with self.lock:
            if now >= self._next_beat:
                self._next_beat = now + 1.0
                self._send(
                    self.dialect.MAVLink_heartbeat_message(
                        ONBOARD, GENERIC_AUTOPILOT_NONE, 0, 0, ACTIVE, 3
                    )
                )
            if self.heard.system and now >= self._next_sync:
                self._next_sync = now + SYNC_S
                self._send(self.dialect.MAVLink_timesync_message(0, round(1e9 * now)))
            self._ask(now)
            if self._target is not None and self.heard.system:
                self._send(self._build(now, *self._target))
                self.sent += 1

    def hear(self) -> None:
        """Process received messages."""
        now = self.clock.now()
        with self.lock:
            for message, _ in self.endpoint.poll():
                self.heard.take(message, now)

    def _ask(self, now: float) -> None:
        """Request the messages until they arrive."""
        h = self.heard
        missing = now - h.place > 0.5 or now - h.turn > 0.5 or h.flags is None or not h.has_version
        if not h.system or not missing or now < self._next_ask:
            return
        self._next_ask = now + 2.0
        for number, rate in self._wanted.items():
            self._send_command(SET_INTERVAL, number, 1e6 / rate)
        self._send_command(REQUEST_MESSAGE, 148)
        self._send_command(REQUEST_MESSAGE, 49)

    def _build(self, at: float, renewed: float, t: Target) -> Any:
        stale = at - renewed > RENEWED_S
        ms = round(1e3 * at) % 2**32
        if t.f_B is not None and not stale:
            w, x, y, z = to_ned_quaternion(t.R_WB).tolist()
            f = (float(t.f_B[0]), -float(t.f_B[1]), -float(t.f_B[2]))
            thrust = min(max(float(t.f_B[2]), 0.0), 1.0)
            return AttitudeTarget(
                ms, 0x07 | 0x20, (w, x, y, z), (0.0, 0.0, 0.0), thrust, f, self.heard.system,
                self.heard.component,
            )  # fmt: skip
        still = np.zeros(3)
        v, a = (still, still) if stale else (t.v, t.a)
        yaw = swap_heading(find_heading(t.R_WB))
        return self.dialect.MAVLink_set_position_target_local_ned_message(
            ms, self.heard.system, self.heard.component, 1, 0,
            *swap_world(t.p), *swap_world(v), *swap_world(a), yaw, 0.0 if stale else -t.rate,
        )  # fmt: skip

    def _send(self, message: Any) -> None:
        self.endpoint.send(message)

    def _send_command(self, number: int, *p: float, confirmation: int = 0) -> None:
        h, seven = self.heard, [*p, *[0.0] * (7 - len(p))]
        self._send(
            self.dialect.MAVLink_command_long_message(
                h.system, h.component, number, confirmation, *seven
            )
        )

    # --- commands ------------------------------------------------------------------------------

    def command(self, number: int, *p: float) -> str:
        """Send a command and wait for the answer; return the reason of a refusal, or "".

        The command is sent up to three times; no answer counts as a refusal. Each new report that
        it is in progress prolongs the wait, up to COMMAND_S in all.
        """
        last = self.clock.now() + COMMAND_S
        progress = None
        for confirmation in range(TRIES):
            asked = self.clock.now()
            if asked >= last:
                break
            with self.lock:
                self._send_command(number, *p, confirmation=confirmation)
            end = asked + ACK_S
            while self.clock.now() < min(end, last):
                self.clock.sleep(PERIOD)
                with self.lock:
                    found = [a for a in self.heard.acks if a.command == number and a.at > asked]
                if found and found[-1].result != IN_PROGRESS:
                    return self._explain(found[-1].result, asked)
                if found and found[-1] is not progress:
                    progress, end = found[-1], self.clock.now() + ACK_S
        if progress is not None:
            return "in progress, but no result arrived"
        return f"no answer to {TRIES} requests"

    def _explain(self, result: int, asked: float) -> str:
        if result == 0:
            return ""
        self.clock.sleep(0.1)  # the text with the reason follows the answer
        with self.lock:
            texts = [text for at, text in self.heard.texts if at >= asked]
        return ": ".join([RESULTS.get(result, f"result {result}"), *texts[-2:]])

    def wait(self, until: Any, seconds: float) -> bool:
        """Wait until `until(heard)` is true; return False after `seconds` (s)."""
        end = self.clock.now() + seconds
        while self.clock.now() < end:
            with self.lock:
                if until(self.heard):
                    return True
            self.clock.sleep(PERIOD)
        return False

    def age(self, of: float) -> float:
        """Return the time (s) since `of`."""
        return self.clock.now() - of

    @property
    def delay(self) -> float:
        """Return the median time (s) from recent messages to their answers; NaN if unknown."""
        with self.lock:
            trips = list(self.heard.round_trips)
        return float(np.median(trips)) if trips else float("nan")
