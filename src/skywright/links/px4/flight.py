"""A flight under PX4: `skywright sitl ROBOT --autopilot px4`.

The plant runs for a period, its sensors are sent to PX4, and PX4's answer commands the rotors in
the next period.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from skywright.core.threads import on_one_thread
from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.links.px4.parameters import build_airframe
from skywright.links.px4.sensors import Px4Sensors
from skywright.links.px4.server import Px4Server
from skywright.links.px4.telemetry import Telemetry
from skywright.links.sitl.directory import SitlDirectory
from skywright.links.sitl.fly import fly_to_end
from skywright.links.sitl.pace import Pace
from skywright.links.sitl.plant import SitlPlant
from skywright.links.sitl.result import SitlResult

SLOW_START_S = 20.0
"""s of a connection without actuators after which this is reported."""


class Options(NamedTuple):
    """Options of a flight."""

    host: str = "127.0.0.1"
    port: int = 4560
    telemetry: int = 13280  # port; 0: none
    speed: float = 1.0  # factor of real time; infinite: as fast as possible
    wait_s: float = 120.0  # for a connection of PX4, at the start and after its end
    patience_s: float = 30.0  # for an answer
    duration_s: float = math.inf  # of the plant's time
    out: Path | None = None
    command: str = ""


@on_one_thread
def fly_px4(
    description: Description[Any], options: Options, say: Callable[[str], None] = lambda _: None
) -> SitlResult:
    """Fly until the duration is over, PX4 stays away, or an interrupt; write the run directory.

    `say` receives one line per event. Raises InputError if nothing was started: a busy port, a
    robot that PX4 cannot fly, no PX4 in time.
    """
    plant = SitlPlant(description)
    server = Px4Server(
        plant.n_rotors, options.host, options.port, patience_s=options.patience_s, say=say
    )
    telemetry = None
    try:
        if options.telemetry:
            p_BC = build_airframe(description.robot, description.world).p_BC
            telemetry = Telemetry(options.host, options.telemetry, plant.notes, p_BC)
        say(f"waiting for PX4 on {options.host}:{server.port}")
        if not server.wait_for_connection(options.wait_s):
            raise InputError(
                f"no PX4 connected to {options.host}:{server.port} within {options.wait_s:g} s; "
                "start it with PX4_SIM_MODEL set (docs: PX4 SITL), or give --wait S"
            )
        return _Flight(plant, server, telemetry, options, say).fly()
    finally:
        server.close()
        if telemetry is not None:
            telemetry.close()


class _Flight:
    """The loop and its rules."""

    def __init__(
        self, plant: SitlPlant, server: Px4Server, telemetry: Telemetry | None, options: Options,
        say: Callable[[str], None],
    ) -> None:  # fmt: skip
        d = plant.description
        self.plant, self.server, self.telemetry, self.options = plant, server, telemetry, options
        self.sensors = Px4Sensors(
            server.stream.dialect, d.robot, d.world, d.mission.seed, plant.period
        )
        self.directory = SitlDirectory(options.out, plant, "px4", options.command)
        self._tell = say
        server.say = self.say
        self._pace = Pace()
        self._since = 0.0  # s, start or end of the connection
        self._state = ""
        self._warned = False

    def say(self, text: str) -> None:
        """Print and record an event."""
        self._tell(text)
        self.directory.note(text)

    def fly(self) -> SitlResult:
        """Fly to the end."""
        outcome, reason = fly_to_end(self.plant, self.options.duration_s, self._fly_a_step)
        directory = self.directory.finish(outcome, reason)
        return SitlResult(
            outcome, reason, directory, self.directory.metrics, self.directory.factor,
            self.server.describe_refused(),
        )  # fmt: skip

    def _fly_a_step(self) -> str | None:
        self._step()
        return f"no PX4 for {self.options.wait_s:g} s" if self._has_been_left() else None

    def _step(self) -> None:
        lockstep, plant = self.server.lockstep, self.plant
        reading = plant.step(lockstep.command)
        self.server.exchange(reading.t, self.sensors.build(reading))
        if lockstep.truth_interval is not None:
            self.sensors.set_truth_interval(lockstep.truth_interval)
            lockstep.truth_interval = None
        if self.telemetry is not None:
            local = plant.description.world.localisation == "gnss"
            self.telemetry.poll(reading.t, reading.p_WB, local)
        armed = float(lockstep.armed)
        if armed != plant.notes.armed:
            plant.notes.armed = armed
            self.say(f"t = {reading.t:.3f} s: PX4 {'is armed' if armed else 'is disarmed'}")
        self._watch(reading.t)
        self.directory.tick()
        locked = lockstep.state == "locked"  # else PX4 boots, by the wall clock
        self._pace.wait(reading.t, self.options.speed if locked else min(self.options.speed, 1.0))

    def _watch(self, t: float) -> None:
        """Report changes; a PX4 that sends no actuators has a wrong configuration."""
        state = self.server.lockstep.state
        if state != self._state:
            if state == "locked":
                self.say(f"t = {t:.3f} s: in lockstep")
            elif state == "starting" and self.telemetry is not None:
                self.telemetry.restart()
            self._state, self._since, self._warned = state, t, False
        if state == "starting" and t - self._since > SLOW_START_S and not self._warned:
            self._warned = True
            self.say(
                f"t = {t:.3f} s: PX4 is connected and sends no actuators; are its parameters those "
                "of `skywright sitl ROBOT --params`?"
            )

    def _has_been_left(self) -> bool:
        return self._state == "absent" and self.plant.t - self._since > self.options.wait_s
