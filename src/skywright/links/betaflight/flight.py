"""A flight under Betaflight: `skywright sitl ROBOT --autopilot betaflight`.

The plant runs in periods at the pace of the wall clock. Its state is sent to Betaflight, whose
newest outputs command the rotors. Betaflight has no position loop: Skywright is the pilot.
"""

from __future__ import annotations

import math
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.interrupt import check_interrupt
from skywright.core.rotations import rot_z
from skywright.core.threads import on_one_thread
from skywright.description.loader import Description
from skywright.links.betaflight.airframe import MIN_CHECK, build_airframe, list_commands
from skywright.links.betaflight.link import BetaflightLink, Ports
from skywright.links.betaflight.outer_loop import OuterLoop
from skywright.links.betaflight.packets import (
    COMMAND_PORT,
    IDLE,
    Sticks,
    pack_state,
    pack_sticks,
)
from skywright.links.betaflight.process import Firmware
from skywright.links.betaflight.route import Route, plan_route
from skywright.links.betaflight.set_up import SetUp
from skywright.links.sitl.directory import SitlDirectory
from skywright.links.sitl.earth import HOME, compute_pressure
from skywright.links.sitl.fly import AutopilotFailed, fly_to_end
from skywright.links.sitl.pace import Pace
from skywright.links.sitl.plant import Reading, SitlPlant
from skywright.links.sitl.result import SitlResult
from skywright.vehicle.geodesy import to_geodetic

Array = NDArray[np.float64]

STATE_S = 0.002
"""s between states, if the control period divides it."""
STATE_RATES = (200.0, 1000.0)
STICKS_S = 0.004
PLACE_S = 0.1  # s between positions for its virtual satellite receiver
LATE_S = 0.010
"""s without outputs after which the plant's time pauses until they arrive."""
AGAIN_S, SAY_S = 0.005, 0.5  # s between states during the pause, and time until it is reported
BEHIND_S = 0.005
"""s of real time that are caught up: Betaflight's clock is the wall clock."""
ARM_S = 3.0  # s, time limit for arming after the switch
UNTOLD_S = 4.0
"""s without an answer by MSP before the flight, after which it is restarted (or has failed)."""
READY_S, RESTARTS_MAX = 25.0, 3
"""s, time limit until it is ready, after which it is restarted, and number of restarts."""
SPIN_UP_S = 1.0  # s at idle before take-off
DOWN_M, DOWN_V, DOWN_S = 0.1, 0.1, 0.3
"""Criterion of landed: height above the reference (m), speed (m/s), duration (s)."""


class Options(NamedTuple):
    """Options of a flight."""

    binary: Path | None = None  # started by Skywright; None: by the user
    wait_s: float = 120.0  # for Betaflight to connect, and to be ready to arm
    patience_s: float = 2.0  # without outputs
    duration_s: float = math.inf  # of the plant's time
    out: Path | None = None
    command: str = ""
    host: str = "127.0.0.1"
    command_port: int = COMMAND_PORT
    ports: Ports | None = None


@on_one_thread
def fly_betaflight(
    description: Description[Any], options: Options,
    say: Callable[[str], None] = lambda _: None,
    route: Callable[[Array], Route] | None = None,
) -> SitlResult:  # fmt: skip
    """Set Betaflight up, fly the mission's waypoints and land; write a run directory.

    `route` computes another route from the start position (3,) m.

    `say` receives one line per event. Raises InputError if nothing was started: a robot that
    Betaflight cannot fly, busy ports, no Betaflight in time.
    """
    airframe = build_airframe(description.robot, description.world)
    plant = SitlPlant(description, STATE_S, STATE_RATES)
    start = plant.vehicle.sim.qpos[:3].copy()
    flown = plan_route(plant.setup, start) if route is None else route(start)
    link = BetaflightLink(plant.n_rotors, options.host, options.ports or Ports())
    folder = Path(tempfile.mkdtemp(prefix="skywright-betaflight-"))
    firmware = None
    try:
        firmware = Firmware(options.binary, folder) if options.binary is not None else None
        set_up = SetUp(options.host, options.command_port, options.wait_s, firmware, say)
        link.attach(set_up.run(list_commands(airframe)))
        loop = OuterLoop(airframe, description.world.gravity_mps2)
        return _Flight(plant, link, loop, flown, options, set_up, say).fly()
    finally:
        link.close()
        if firmware is not None:
            firmware.stop()
        shutil.rmtree(folder, ignore_errors=True)


class _Flight:
    """The loop and its rules. Stages: starting, arming, flying, landed."""

    def __init__(
        self, plant: SitlPlant, link: BetaflightLink, loop: OuterLoop, route: Route,
        options: Options, set_up: SetUp, say: Callable[[str], None],
    ) -> None:  # fmt: skip
        self._again = set_up.restart if options.binary is not None else None
        self._restarts, self._tried = 0, 0.0
        self.plant, self.link, self.loop, self.route = plant, link, loop, route
        self.options, self._tell = options, say
        self.directory = SitlDirectory(options.out, plant, "betaflight", options.command)
        self.directory.note(set_up.version)
        self._pace = Pace(behind_s=BEHIND_S)
        self._origin = plant.description.world.origin or HOME
        self._place = to_geodetic(self._origin, np.zeros(3))
        self._place_due = self._sticks_due = 0.0
        self._sticks: Sticks = IDLE
        self._stage, self._since = "starting", 0.0
        self._begin = math.inf  # s, the plant's time at the start of the route
        self._leg = -1
        self._down_s = 0.0
        self._still_s = 0.0  # s of wall time in which the plant's time paused
        self._why = ""

    def say(self, text: str) -> None:
        """Print and record an event at the plant's time."""
        line = f"t = {self.plant.t:.3f} s: {text}"
        self._tell(line)
        self.directory.note(line)

    def fly(self) -> SitlResult:
        """Fly to the end."""
        outcome, reason = fly_to_end(self.plant, self.options.duration_s, self._fly_a_step)
        if self._still_s > 0.01 * self.plant.t:
            self.say(f"the plant's time stood still for {self._still_s:.1f} s: Betaflight was late")
        directory = self.directory.finish(outcome, reason)
        return SitlResult(
            outcome, reason, directory, self.directory.metrics, self.directory.factor,
            self.link.describe_refused(),
        )  # fmt: skip

    def _fly_a_step(self) -> str | None:
        self._step()
        return "landed" if self._stage == "over" else None

    def _step(self) -> None:
        plant, link = self.plant, self.link
        reading = plant.step(link.command)
        self._pace.wait(reading.t, 1.0)
        estimate = plant.vehicle.estimate
        R = np.array(estimate["R_WB"])
        if reading.t >= self._place_due:
            self._place_due += PLACE_S
            self._place = to_geodetic(self._origin, np.array(estimate["p_WB"]))
        pressure = compute_pressure(self._place.altitude_m)
        state = pack_state(
            reading.gyro, reading.accel, R, np.array(estimate["v_WB"]), self._place, pressure
        )  # fmt: skip
        sticks = None
        if reading.t >= self._sticks_due - 1e-9:
            self._sticks_due = reading.t + STICKS_S
            self._lead(reading, estimate)
            armed = self._stage in ("arming", "flying")
            if link.status is not None:  # before this, its radio is not set up, and remains so
                sticks = pack_sticks(reading.t, self._sticks, MIN_CHECK, armed)
        link.send(state, sticks)
        link.poll()
        if self._stage in ("arming", "flying"):
            self._wait_for_outputs(state)
        self._note(estimate)
        self._watch()
        self.directory.tick()

    def _lead(self, reading: Reading, estimate: Any) -> None:
        """Compute the sticks, and enter the next stage if it is due."""
        t, status = reading.t, self.link.status
        if self._stage == "starting":
            self._sticks = IDLE
            self._wait_until_ready(t)
        elif self._stage == "arming":
            if status is not None and status.armed:
                self._go("flying", "Betaflight is armed")
                self._begin = t + SPIN_UP_S
            elif t - self._since > ARM_S:
                says = "; ".join(status.refusals) if status is not None else ""
                raise AutopilotFailed(f"Betaflight does not arm: {says or 'it gives no reason'}")
        elif self._stage == "flying":
            self._fly_route(t, estimate)
        elif self._stage == "landed":
            self._sticks = IDLE
            if status is not None and not status.armed:
                self._go("over", "Betaflight is disarmed")
            elif t - self._since > ARM_S:
                raise AutopilotFailed("Betaflight does not disarm after the landing")

    def _wait_until_ready(self, t: float) -> None:
        status = self.link.status
        ready = status is not None and not status.refusals and self.plant.vehicle.localised
        if ready and t > 1.0:
            self._go("arming", "Betaflight is ready")
            return
        why = "it does not answer by MSP" if status is None else "; ".join(status.refusals)
        if why and why != self._why:
            self._why = why
            self.say(f"not ready: {why}")
        if t - self._since > self.options.wait_s:
            raise AutopilotFailed(f"Betaflight was not ready within {t:.0f} s: {why}")
        if self.link.untold_s > UNTOLD_S:
            self._restart(
                f"Betaflight has not answered by MSP for {UNTOLD_S:g} s (its last outputs came "
                f"{self.link.silence_s:.2g} s ago)", must=True,
            )  # fmt: skip
        elif t - self._tried > READY_S:
            self._tried = t
            self._restart(f"Betaflight is not ready after {READY_S:g} s", must=False)

    def _restart(self, says: str, must: bool) -> None:
        """Restart a Betaflight that hangs before the flight, if Skywright runs it.

        Its scheduler can starve a task permanently if a busy computer delays its start.
        """
        if self._again is None or self._restarts >= RESTARTS_MAX:
            if must:
                raise AutopilotFailed(says)
            return
        self._restarts += 1
        self.say(f"{says}: it is started again")
        self.link.attach(self._again())
        self._why = ""

    def _fly_route(self, t: float, estimate: Any) -> None:
        at = t - self._begin
        if at < 0.0:
            self._sticks = IDLE
            return
        leg = self.route.find_leg(at)
        if leg != self._leg:
            self._leg = leg
            self.say(self.route.legs[leg].name)
        target = self.route.read(at)
        p, v = np.array(estimate["p_WB"]), np.array(estimate["v_WB"])
        landing = leg == len(self.route.legs) - 1
        free = at > 1.0 and not (landing and p[2] - target.p[2] > DOWN_M)
        self._sticks = self.loop.compute(target, p, v, np.array(estimate["R_WB"]), STICKS_S, free)
        self.plant.notes.p_WB_des[:], self.plant.notes.v_WB_des[:] = target.p, target.v
        still = p[2] - target.p[2] > DOWN_M and abs(v[2]) < DOWN_V
        self._down_s = self._down_s + STICKS_S if landing and still else 0.0
        if self._down_s > DOWN_S:
            self._go("landed", "landed")

    def _go(self, stage: str, says: str) -> None:
        self._stage, self._since = stage, self.plant.t
        self.say(says)

    def _note(self, estimate: Any) -> None:
        """Record the position of the outer loop, and Betaflight's state."""
        notes, status, attitude = self.plant.notes, self.link.status, self.link.attitude
        notes.armed = float(status is not None and status.armed)
        notes.p_WB[:], notes.v_WB[:] = estimate["p_WB"], estimate["v_WB"]
        notes.heard = float(attitude is not None)
        if attitude is not None:
            roll, pitch, heading = np.radians(attitude)
            notes.R_WB[:] = rot_z(-heading) @ _rot_y(pitch) @ _rot_x(roll)

    def _watch(self) -> None:
        """End the flight if Betaflight has ended or is wrong; report a silence."""
        link = self.link
        if link.trouble:
            raise AutopilotFailed(link.trouble)
        if link.gone:
            raise AutopilotFailed(
                "Betaflight has ended or restarted; the rotors stop, because a restarted autopilot "
                "cannot continue the flight"
            )
        status = link.status
        if self._stage == "flying" and status is not None and not status.armed:
            raise AutopilotFailed(
                f"Betaflight disarmed in flight: {'; '.join(status.refusals) or 'no reason given'}"
            )

    def _wait_for_outputs(self, state: bytes) -> None:
        """Pause the plant's time while Betaflight is late; raises an error if it hangs."""
        link, said = self.link, False
        begin = time.monotonic()
        while link.silence_s > LATE_S and not link.gone and not link.trouble:
            check_interrupt()
            if link.silence_s > self.options.patience_s:
                raise AutopilotFailed(
                    f"Betaflight sent no outputs for {self.options.patience_s:g} s; it is stopped "
                    "in a debugger, or hangs (--patience S waits longer)"
                )
            if link.silence_s > SAY_S and not said:
                said = True
                self.say("no outputs of Betaflight: time stands still")
            time.sleep(AGAIN_S)
            link.send(state, None)
            link.poll()
        self._still_s += time.monotonic() - begin


def _rot_x(a: float) -> Any:
    c, s = math.cos(a), math.sin(a)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _rot_y(a: float) -> Any:
    c, s = math.cos(a), math.sin(a)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
