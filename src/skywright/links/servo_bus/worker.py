"""The thread that owns a servo bus in a flight: start, goals at 50 Hz, readings in turn.

HerkuleX servos do not acknowledge broadcasts, and a servo that restarts answers with its torque off
and no error. Torque is therefore read back when it is switched on and with each later reading.

A status error of a servo is sticky. INVALID_PACKET, which one disturbed byte on the wire sets, is
counted and cleared: it concerns the wire, and the default torque policy of a servo (0x35: voltage,
heat, overload, driver) does not release the torque for it (HerkuleX manual 1.10, pp. 22, 33, 39).
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from skywright.errors import InputError
from skywright.links.servo_bus.bus import ServoBus, ServoSilent, ServoStatus
from skywright.links.servo_bus.protocol import (
    INVALID_PACKET,
    Jog,
    describe_error,
    to_angle,
    to_counts,
    to_ticks,
)
from skywright.vehicle.plant import MISSION_TICK

PERIOD_S = MISSION_TICK
"""s between goals."""
PLAY_S = 2.0 * PERIOD_S
START_S = 2.0
"""Play time (s) of the motion to the flight's first goals."""
FAR_RAD = math.radians(30.0)
"""Largest distance of a shaft from the flight's first goal before the motion to it."""
NEAR_RAD = math.radians(10.0)
"""Largest distance after this motion.

A HerkuleX holds by a proportional gain alone (Position Kp 440, Ki 0 by default; manual 1.10, p.
22), so that a load leaves an error. The unit of the gain is assumed as 1/64 of PWM per count: full
PWM (1023) at 149 counts, 48 deg. A joint loaded by a tenth of its stall torque (0.23 of 2.34 N m,
the most of dual arms of 0.5 m with the upper arms down) then stands 5 deg from its goal; backlash
(0.5 deg) and the lag of 0.05 s at 15 deg/s (0.8 deg) add to it.
"""
TORQUE_ATTEMPTS = 3
LIMP = "its torque is off: it has restarted, or its supply dipped"


class Shaft(NamedTuple):
    """A reading of a servo."""

    angle: float  # rad
    status: ServoStatus
    silent_s: float  # s from the answer to the last request: 0 if that was answered


class ServoWorker(threading.Thread):
    """Owns the bus: sends the newest goals at 50 Hz and reads the positions in turn."""

    def __init__(self, bus: ServoBus, servos: Sequence[int]) -> None:
        super().__init__(daemon=True, name="servo bus")
        self._bus, self._servos = bus, list(servos)
        self._lock, self._ending = threading.Lock(), threading.Event()
        self._goals: dict[int, int] = {}
        self._shafts: dict[int, Shaft] = {}
        self.cycle_s = 0.0
        """Duration (s) of the last round of readings."""
        self.failure = ""

    def check(self, goals: dict[int, float], names: dict[int, str]) -> None:
        """Read all servos without motion.

        Raises InputError if one is absent, reports an error, or is far from its goal (rad).
        """
        self._bus.acknowledge_reads_only()
        self._bus.clear_errors()
        self._read_all(names)
        self._check_distances(
            goals, names, FAR_RAD, "where the flight begins", "move it there by hand"
        )

    def start_up(self, goals: dict[int, float], names: dict[int, str]) -> None:
        """Read all servos, switch torque on, move to `goals` (rad) slowly, then start the thread.

        Raises InputError if one is absent, reports an error, has no torque, or is far from its
        goal. A refused or interrupted start switches torque off again where it was off.
        """
        self.check(goals, names)
        held = {servo for servo, shaft in self._shafts.items() if shaft.status.torque}
        try:
            self._switch_on(names)
            self.lead(goals)
            self._bus.jog_together(to_ticks(START_S), self._build_jogs())
            time.sleep(START_S)
            self._read_all(names)
            for servo, shaft in self._shafts.items():
                if not shaft.status.torque:
                    raise InputError(f"servo {servo} ({names[servo]}): {LIMP}")
            self._check_distances(
                goals, names, NEAR_RAD, "its goal after the motion to the start",
                "check that the arm moves freely, the wires of the bus, and the supply",
            )  # fmt: skip
        except BaseException:
            with suppress(OSError):
                for servo in self._servos:
                    if servo not in held:
                        self._bus.set_torque(False, servo)
            raise
        self.start()

    def _switch_on(self, names: dict[int, str]) -> None:
        """Switch torque on, and read it back from each servo; raises InputError."""
        self._bus.set_torque(True)
        for servo in self._servos:
            for attempt in range(TORQUE_ATTEMPTS):
                if attempt:
                    self._bus.set_torque(True, servo)
                if self._read_at_start(servo, names).status.torque:
                    break
            else:
                raise InputError(
                    f"servo {servo} ({names[servo]}): its torque is off after {TORQUE_ATTEMPTS} "
                    "requests to switch it on; check its supply and the wires of the bus"
                )

    def _read_all(self, names: dict[int, str]) -> None:
        """Read all servos; raises InputError if one is silent or reports an error."""
        self._shafts = {servo: self._read_at_start(servo, names) for servo in self._servos}

    def _read_at_start(self, servo: int, names: dict[int, str]) -> Shaft:
        try:
            shaft = self._read(servo)
        except ServoSilent:
            present = self._bus.find_servos(range(1, 33))
            raise InputError(
                f"servo {servo} ({names[servo]}) does not answer; those that do: "
                f"{', '.join(map(str, present)) or 'none'}"
            ) from None
        if shaft.status.faults:
            raise InputError(
                f"servo {servo} ({names[servo]}): {describe_error(shaft.status.faults)}"
            )
        return shaft

    def _read(self, servo: int) -> Shaft:
        """Return a reading; raises ServoSilent."""
        counts, status = self._bus.read_position(servo)
        if status.error == INVALID_PACKET:  # alone: clearing must not erase another error
            self._bus.counts["disturbed"] += 1
            self._bus.clear_errors(servo)
        return Shaft(to_angle(counts), status, 0.0)

    def _check_distances(
        self, goals: dict[int, float], names: dict[int, str], most: float, place: str, advice: str
    ) -> None:
        """Raise InputError if a shaft is further than `most` (rad) from its goal."""
        for servo, shaft in self._shafts.items():
            off = shaft.angle - goals[servo]
            if abs(off) > most:
                raise InputError(
                    f"servo {servo} ({names[servo]}) stands {math.degrees(off):+.0f} deg from "
                    f"{place}; valid: within {math.degrees(most):.0f} deg; {advice}"
                )

    def lead(self, goals: dict[int, float]) -> None:
        """Set the newest goals (rad) by id."""
        with self._lock:
            self._goals = {servo: to_counts(angle) for servo, angle in goals.items()}

    def read(self) -> dict[int, Shaft]:
        """Return the newest readings by id."""
        with self._lock:
            return dict(self._shafts)

    def run(self) -> None:
        """Send and read until `stop`."""
        try:
            self._run()
        except Exception as error:  # the port has failed: reported at the next tick
            self.failure = f"{type(error).__name__}: {error}"

    def stop(self) -> None:
        """Stop the thread; the servos hold their positions with torque on."""
        self._ending.set()
        if self.is_alive():
            self.join(2.0)
        self._bus.close()

    def _build_jogs(self) -> list[Jog]:
        with self._lock:
            return [Jog(servo, counts) for servo, counts in sorted(self._goals.items())]

    def _run(self) -> None:
        due, turn, begin = time.monotonic(), 0, time.monotonic()
        answered = dict.fromkeys(self._servos, begin)
        while not self._ending.is_set():
            now = time.monotonic()
            if now >= due:
                self._bus.jog_together(to_ticks(PLAY_S), self._build_jogs())
                due = max(due + PERIOD_S, now)
            servo = self._servos[turn]
            try:
                shaft = self._read(servo)
                answered[servo] = time.monotonic()
            except ServoSilent:
                silent = time.monotonic() - answered[servo]
                shaft = self._shafts[servo]._replace(silent_s=silent)
            with self._lock:
                self._shafts[servo] = shaft
            turn = (turn + 1) % len(self._servos)
            if turn == 0:
                self.cycle_s, begin = time.monotonic() - begin, time.monotonic()
