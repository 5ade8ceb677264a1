"""Last state that a MAVLink vehicle reported, and times of the reports."""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.links.mavlink.frames import (
    from_ned_quaternion,
    swap_body,
    swap_world,
)
from skywright.links.mavlink.modes import ARMED, Mode
from skywright.links.mavlink.stream import is_finite

Array = NDArray[np.float64]

PX4, INVALID = 12, 8
"""MAV_AUTOPILOT: PX4, and a component that is no autopilot, such as a ground station."""
PLACED = 0x10 | 0x8
"""ESTIMATOR_STATUS: the horizontal position is valid, absolute or relative."""
BACK_MS = 1000  # least backward jump of the vehicle's clock that counts as a restart
TEXTS = 20
PACE_REPORTS = 25
"""Position reports (half a second) over which the rate of the vehicle's clock is averaged."""
PACES = (0.02, 50.0)


class Ack(NamedTuple):
    """An answer to a command."""

    command: int
    result: int
    at: float  # s


class Heard:
    """The newest state of one vehicle; times are those of the monotonic clock, in s.

    The vehicle is the component that sent the first heartbeat of PX4. Messages of other components,
    such as a gimbal with the same system id, are not processed.
    """

    def __init__(self, ids: tuple[int, int] = (1, 191)) -> None:
        """`ids` are system and component of this side: answers to others are ignored."""
        self._ids = ids
        self.system = self.component = 0  # of the vehicle, 0: none received
        self.others: dict[tuple[int, int], int] = {}
        """System and component -> MAV_AUTOPILOT of heartbeats that name another autopilot."""
        self.beat = self.message = self.place = self.turn = -math.inf  # s, times of arrival
        self.answer = math.inf  # s, time of the last answer to a TIMESYNC; infinite: none
        self.place_ms = self.turn_ms = 0  # times of measurement on the vehicle's clock
        self.armed, self.mode, self.landed = False, Mode(0), 0
        self.p, self.v = np.zeros(3), np.zeros(3)  # m, m/s: ENU, in the vehicle's local frame
        self.R_WB, self.w_B = np.eye(3), np.zeros(3)
        self.flags: int | None = None  # of ESTIMATOR_STATUS
        self.std = math.nan  # m
        self.charge = math.nan
        self.origin: tuple[float, float, float] | None = None  # deg, deg, m: of the local frame
        self.home: Array | None = None
        self.acks: deque[Ack] = deque(maxlen=TEXTS)
        self.texts: deque[tuple[float, str]] = deque(maxlen=TEXTS)
        self.simulated = False  # whether it is a vehicle of Skywright
        self.has_version = False
        self.restarts = 0
        self._boot_ms = 0
        self._reports: deque[tuple[float, int]] = deque(maxlen=PACE_REPORTS)  # s, ms
        self.round_trips: deque[float] = deque(maxlen=20)  # s

    @property
    def pace(self) -> float:
        """Rate of the vehicle's clock over the local clock; a simulation may differ from 1."""
        if len(self._reports) < PACE_REPORTS:
            return 1.0
        (t0, ms0), (t, ms) = self._reports[0], self._reports[-1]
        low, high = PACES
        return min(max(1e-3 * (ms - ms0) / max(t - t0, 1e-3), low), high)

    @property
    def has_place(self) -> bool:
        """Whether its estimator has a position, if it reports that."""
        return self.flags is None or bool(self.flags & PLACED)

    def take(self, m: Any, now: float) -> None:
        """Process a message; invalid values and other components are ignored."""
        kind = m.get_type()
        sender = (m.get_srcSystem(), m.get_srcComponent())
        if kind == "HEARTBEAT" and not self.system:
            self._meet(sender, m.autopilot)
        if not self.system or sender != (self.system, self.component):
            return
        self.message = now
        take = getattr(self, f"_take_{kind.lower()}", None)
        if take is not None:
            take(m, now)

    def _meet(self, sender: tuple[int, int], autopilot: int) -> None:
        if autopilot == PX4:
            self.system, self.component = sender
        elif autopilot != INVALID and len(self.others) < TEXTS:
            self.others[sender] = autopilot

    def _take_heartbeat(self, m: Any, now: float) -> None:
        self.beat = now
        self.armed, self.mode = bool(m.base_mode & ARMED), Mode.read(m.custom_mode)

    def _take_local_position_ned(self, m: Any, now: float) -> None:
        if not is_finite(m, "x", "y", "z", "vx", "vy", "vz"):
            return
        self._look_at_clock(m.time_boot_ms)
        self.p = swap_world(np.array([m.x, m.y, m.z]))
        self.v = swap_world(np.array([m.vx, m.vy, m.vz]))
        self.place, self.place_ms = now, m.time_boot_ms
        self._reports.append((now, m.time_boot_ms))

    def _take_attitude_quaternion(self, m: Any, now: float) -> None:
        if not is_finite(m, "q1", "q2", "q3", "q4", "rollspeed", "pitchspeed", "yawspeed"):
            return
        R = from_ned_quaternion(np.array([m.q1, m.q2, m.q3, m.q4]))
        if R is not None:
            self.R_WB, self.turn, self.turn_ms = R, now, m.time_boot_ms
            self.w_B = swap_body(np.array([m.rollspeed, m.pitchspeed, m.yawspeed]))

    def _take_extended_sys_state(self, m: Any, now: float) -> None:
        self.landed = m.landed_state

    def _take_estimator_status(self, m: Any, now: float) -> None:
        self.flags, std = m.flags, float(m.pos_horiz_accuracy)
        self.std = std if math.isfinite(std) else math.nan

    def _take_sys_status(self, m: Any, now: float) -> None:
        self.charge = m.battery_remaining / 100.0 if m.battery_remaining >= 0 else math.nan

    def _take_gps_global_origin(self, m: Any, now: float) -> None:
        self.origin = (1e-7 * m.latitude, 1e-7 * m.longitude, 1e-3 * m.altitude)

    def _take_home_position(self, m: Any, now: float) -> None:
        if is_finite(m, "x", "y", "z"):
            self.home = swap_world(np.array([m.x, m.y, m.z]))

    def _take_autopilot_version(self, m: Any, now: float) -> None:
        self.has_version = True
        self.simulated = bytes(m.flight_custom_version) == b"skywrigt"

    def _take_command_ack(self, m: Any, now: float) -> None:
        target = (m.target_system, m.target_component)
        if any(asked not in (0, mine) for asked, mine in zip(target, self._ids, strict=True)):
            return  # the answer to a ground station, for example
        self.acks.append(Ack(m.command, m.result, now))

    def _take_statustext(self, m: Any, now: float) -> None:
        raw = m.text
        text = raw if isinstance(raw, str) else bytes(raw).decode("ascii", "replace")
        if m.id and m.chunk_seq and self.texts:
            at, before = self.texts.pop()
            self.texts.append((at, (before + text)[:300]))
        else:
            self.texts.append((now, text))

    def _take_timesync(self, m: Any, now: float) -> None:
        if m.tc1 != 0:
            trip = now - 1e-9 * m.ts1
            if 0.0 <= trip < 10.0:
                self.round_trips.append(trip)
                self.answer = now

    def _look_at_clock(self, ms: int) -> None:
        if self._boot_ms - ms > BACK_MS:
            self.restarts += 1
            self.flags = None
            self._reports.clear()
        self._boot_ms = ms
