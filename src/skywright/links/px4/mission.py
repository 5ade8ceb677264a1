"""The back end `px4`: a mission in software in the loop with a platform that PX4 flies.

One process is PX4's simulator (TCP, lockstep) and the robot's onboard computer (MAVLink, UDP): the
plant has arms, contact, wind and sensors as in every simulated flight. PX4 commands the rotors. The
platform's references are sent to PX4 as set-points, and the estimate of the platform is PX4's.
Arms, hands, force sensor and probe are controlled in the plant, as by a servo bus.

Mission time is the plant's. While the mission waits for PX4 (a mode, arming, landing) the plant
continues, in lockstep, and the reference pauses.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.interrupt import check_interrupt
from skywright.core.types import TASK_FORCE
from skywright.errors import InputError
from skywright.links.mavlink.body_force import find_forceless
from skywright.links.mavlink.endpoint import Endpoint, Url
from skywright.links.mavlink.frames import move_point
from skywright.links.mavlink.link import PERIOD, WANTED, VehicleLink
from skywright.links.mavlink.offboard import CONNECT_S, Offboard
from skywright.links.mavlink.stream import load_dialect
from skywright.links.px4.check import find_losses, find_refusal
from skywright.links.px4.docked import DockedAttitude
from skywright.links.px4.parameters import build_airframe
from skywright.links.px4.sensors import FIRST_US, Px4Sensors
from skywright.links.px4.server import PORT, Px4Server
from skywright.links.sitl.earth import HOME
from skywright.links.sitl.fly import AutopilotFailed
from skywright.links.sitl.onboard import AutopilotPose, AutopilotRotors
from skywright.links.sitl.pace import Pace
from skywright.links.sitl.plant import Placed, Reading, Sockets
from skywright.run.parts import build_law, uses_truth
from skywright.vehicle.bus import Allocated, Clock, WrenchCommand
from skywright.vehicle.component import Component
from skywright.vehicle.geodesy import Geodetic, to_local
from skywright.vehicle.interface import Ticked
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.simulated import SimulatedVehicle

Array = NDArray[np.float64]

HOST = "127.0.0.1"
ONBOARD_PORT = 14540
"""UDP port of PX4's first instance for an onboard computer."""
ATTITUDE, POSITION = 31, 32
RATES = {ATTITUDE: 200.0, POSITION: 100.0}
"""Hz, of PX4's estimate."""
PATIENCE_S = 30.0  # s of the wall clock for an answer of PX4
WAIT_S = 120.0  # s of the wall clock for PX4 to connect
READY_S = 20.0  # s of the plant's time until PX4's checks before arming pass
POSE_HZ, POSE_RAD = 30.0, 0.01
"""Poses that the robot's own estimator sends to PX4: their rate, and noise of the attitude."""
FULL = 0.999
"""Command of a rotor that counts as saturated."""


class Options(NamedTuple):
    """Options of the connection to PX4."""

    port: int = PORT
    force: bool = False  # whether body forces are sent instead of positions
    speed: float = 1.0  # factor of real time; infinite: as fast as possible
    onboard: int = ONBOARD_PORT
    wait_s: float = WAIT_S


class PlantClock:
    """The plant's time, which advances while the mission waits."""

    threaded = False

    def __init__(self) -> None:
        self.vehicle: Px4Vehicle | None = None

    def now(self) -> float:
        """Return s."""
        return 0.0 if self.vehicle is None else self.vehicle.t

    def sleep(self, seconds: float) -> None:
        """Advance the plant; the reference pauses."""
        if self.vehicle is not None:
            self.vehicle.stand_still(seconds)


class Px4Vehicle(Offboard):
    """A back end (vehicle.interface.Backend) with a plant that PX4 flies."""

    def __init__(
        self, server: Px4Server, link: VehicleLink, options: Options, setup: Any, *args: Any,
        parts: Sequence[Component] = (), say: Callable[[str], None], **kwargs: Any,
    ) -> None:  # fmt: skip
        """Wait for PX4, start the plant and wait until PX4 is ready to fly.

        Raises InputError if PX4 does not connect or is not ready.
        """
        self._server, self._options, self._sockets = server, options, Sockets()
        own = AutopilotPose("autopilot pose"), AutopilotRotors("autopilot rotors")
        super().__init__(
            link, setup, *args, parts=[*parts, *self._sockets.parts, *own], **kwargs
        )  # fmt: skip
        self._says = say
        self._sockets.attach(self)
        self._samples = max(round(MISSION_TICK / self._sockets.period), 1)
        self._per_sample = self.n_ticks
        self._pose, self._made = (self.get_memory(c.name) for c in own)
        self._ticks = self.assembly.get(Clock)
        world = setup.description.world
        self._sensors = Px4Sensors(
            server.stream.dialect, self.robot, world, kwargs["seed"], self._sockets.period
        )
        self._home = world.origin or HOME
        airframe = build_airframe(self.robot, self.world)
        self._mass, self._docked = airframe.mass, DockedAttitude(airframe)
        self._told = world.localisation == "total-station"
        self._pose_due = self._step_due = 0.0
        self._pacer, self._met, self._was_locked = Pace(), False, False
        assert isinstance(self.clock, PlantClock)
        self.clock.vehicle = self
        self._begin()

    def _begin(self) -> None:
        server, options = self._server, self._options
        self._says(f"waiting for PX4 on {HOST}:{server.port}")
        if not server.wait_for_connection(options.wait_s):
            raise InputError(
                f"no PX4 connected to {HOST}:{server.port} within {options.wait_s:g} s; start it "
                "with PX4_SIM_MODEL set (docs: PX4 SITL)"
            )
        self._meet(options.force)
        self._met, self._again_s = True, READY_S
        self.stand_still(0.5)
        self._says(f"t = {self.t:.2f} s: PX4 reports its position; the mission begins")
        self.flush()  # the recording begins with the mission

    def _align(self) -> None:
        """Align PX4's frame with W: poses sent to PX4 are already in W."""
        self._restarts = self.link.heard.restarts
        if self.world.localisation != "gnss":
            self._shift = np.zeros(3)
            return
        if not self.link.wait(lambda h: h.origin is not None, CONNECT_S):
            raise InputError("PX4 reports no origin of its local frame (GPS_GLOBAL_ORIGIN)")
        assert self.link.heard.origin is not None
        self._shift = to_local(self._home, Geodetic(*self.link.heard.origin))

    # --- ticks -------------------------------------------------------------------------------

    def _fly_tick(self, guards: int) -> Ticked:
        fired = 0
        for _ in range(self._samples):
            fired |= self._fly_sample(guards)
            if fired:
                break
        return Ticked(self.t, fired, self.t - self._table_start >= self._table_end - 1e-9)

    def stand_still(self, seconds: float) -> None:
        """Fly for a time (s) during which the reference pauses."""
        for _ in range(max(round(seconds / self._sockets.period), 1)):
            check_interrupt()
            self._fly_sample(0)
            self._table_start += self._sockets.period
            self._follower.delay(self._sockets.period)

    def _fly_sample(self, guards: int) -> int:
        """Fly from one inertial sample to the next; return the guards that fired."""
        command = self._server.lockstep.command
        self._sockets.command(command)
        self._made.thrust[: len(command)] = self.rotors.thrust_max * command**2
        self._made.saturated = float(bool(np.any(command > FULL)))
        left, fired = self._per_sample, 0
        while left > 0:  # a guard ends a tick early: the sample still has its full length
            before = int(self._ticks["tick"])
            self.n_ticks = left
            fired |= SimulatedVehicle.tick(self, 0 if fired else guards).fired
            left -= int(self._ticks["tick"]) - before
        self.n_ticks = self._per_sample
        self._exchange(self._sockets.read())
        return fired

    def _exchange(self, reading: Reading) -> None:
        """Send the sensors to PX4 and receive its commands and its estimate."""
        server, lockstep = self._server, self._server.lockstep
        if self._told and self._pose.own_ready > 0.5 and reading.t >= self._pose_due - 1e-9:
            self._pose_due = reading.t + 1.0 / POSE_HZ
            self._sensors.set_pose_noise(max(float(self._pose.own_std), 1e-3), POSE_RAD)
            placed = Placed(reading.t, np.array(self._pose.own_p), np.array(self._pose.own_R))
            reading = reading._replace(pose=placed)
        try:
            server.exchange(reading.t, self._sensors.build(reading))
        except AutopilotFailed as error:
            self._end(str(error))
        if lockstep.truth_interval is not None:
            self._sensors.set_truth_interval(lockstep.truth_interval)
            lockstep.truth_interval = None
        locked = lockstep.state == "locked"
        if self._was_locked and not locked:
            self._end("PX4 has gone: the rotors stop")
        self._was_locked = locked
        if reading.t >= self._step_due - 1e-9:
            self._step_due = reading.t + PERIOD
            self.link.step()
        else:
            self.link.hear()
        self._take_estimate()
        speed = self._options.speed
        self._pacer.wait(reading.t, speed if locked else min(speed, 1.0))

    def _end(self, says: str) -> None:
        self._was_locked = False
        if not self._met:
            raise InputError(says)
        self._give_up(says)

    def _take_estimate(self) -> None:
        """Copy PX4's estimate to the laws and to the recording."""
        h, me, notes = self.link.heard, self._pose, self._sockets.notes
        R, w = h.R_WB, h.w_B
        me.R_WB[:], me.w_WB_B[:] = R, w
        me.p_WB[:], me.v_WB[:] = move_point(h.p + self._shift, h.v, R, w, -self._p_BC)
        me.t, me.t_turn = (1e-3 * ms - 1e-6 * FIRST_US for ms in (h.place_ms, h.turn_ms))
        me.std = h.std
        if self._is_placed(h):
            me.heard = self.t
        me.given = float(self._met)
        notes.heard, notes.armed = float(self._met), float(self._server.lockstep.armed)
        notes.p_WB[:], notes.v_WB[:], notes.R_WB[:] = me.p_WB, me.v_WB, R

    def _lead(self) -> None:
        super()._lead()
        row, notes = self.reference_now, self._sockets.notes
        notes.p_WB_des[:], notes.v_WB_des[:] = row["p_WB"], row["v_WB"]

    def _choose_attitude(self, planned: Array) -> Array:
        if self._force is None:
            return planned
        law, made = self.look(WrenchCommand).t_B, self.look(Allocated).t_B_alloc
        docked = self.reference_now["docked"] > 0.5
        return self._docked.choose(docked, planned, self.link.heard.R_WB, law, made)

    def _feed_forward(self) -> Array:
        """Return the acceleration (3,) m/s^2 that compensates the forces of hands and probe."""
        row, force = self.reference_now, np.zeros(3)
        force += row["f_WH"][np.asarray(row["task"]) == TASK_FORCE].sum(axis=0)
        if row["press"] > 0.5:
            est = self.estimate
            force += max(float(est["f_tip"]), 0.0) * est["R_WT"][:, 2]
        return force / self._mass

    def give_up_rotor(self, i: int) -> None:
        """Return None: without a rotor the others do not hold the robot, because PX4 allocates."""
        return None

    def close(self) -> None:
        """End both links."""
        self.link.close()  # the plant ends here: no vehicle remains that could hold
        self._server.close()


def parse_options(text: str) -> Options:
    """Return the options of `[PORT][?OPTION&...]`; raises InputError for others."""
    port, _, rest = text.partition("?")
    found: dict[str, Any] = {}
    if port:
        found["port"] = _parse_port("px4:PORT", port)
    for item in filter(None, rest.split("&")):
        name, _, value = item.partition("=")
        if name == "force" and not value:
            found["force"] = True
        elif name == "onboard":
            found["onboard"] = _parse_port("px4?onboard", value)
        elif name == "wait":
            found["wait_s"] = _parse_number("px4?wait", value, 0.0, 86400.0)
        elif name == "speed":
            fast = value == "max"
            found["speed"] = math.inf if fast else _parse_number("px4?speed", value, 0.01, 1000.0)
        else:
            raise InputError(
                f"backend px4: ?{item[:40]} is unknown; valid: force, speed=FACTOR, onboard=PORT, "
                "wait=S"
            )
    return Options(**found)


def _parse_port(name: str, text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) < 6 and 0 < int(text) < 65536):
        raise InputError(f"backend {name}: {text[:20]!r}; valid: 1 to 65535")
    return int(text)


def _parse_number(name: str, text: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise InputError(f"backend {name}: {text[:20]!r}; valid: {low:g} to {high:g}")
    return value


def check_backend(address: str, setup: Any) -> None:
    """Raise InputError if a mission cannot fly with PX4 in the loop."""
    d, force = setup.description, parse_options(address).force
    says = find_refusal(setup, uses_truth(d))
    if force and not says:
        says = find_forceless(setup.robot, build_law(d, setup), setup.world.gravity_mps2)
    if says:
        raise InputError(f"backend px4: {says}")


def open_backend(text: str) -> Callable[..., Px4Vehicle]:
    """Return a function that builds the back end of `px4[:PORT][?OPTIONS]`; raises InputError."""
    options = parse_options(text)
    load_dialect()  # fails early if pymavlink is not installed

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    def build(setup: Any, law: Any, estimator: Any, **kwargs: Any) -> Px4Vehicle:
        check_backend(text, setup)
        for line in find_losses(setup, law, options.force):
            say(line)
        link: VehicleLink | None = None
        server = Px4Server(
            len(setup.rotors.spin), HOST, options.port, patience_s=PATIENCE_S, say=say
        )
        try:
            onboard = Endpoint(Url("udpin", HOST, options.onboard), 1, 191)
            link = VehicleLink(onboard, PlantClock(), WANTED | RATES)
            return Px4Vehicle(server, link, options, setup, law, estimator, say=say, **kwargs)
        except BaseException:
            server.close()
            if link is not None:
                link.close()
            raise

    return build
