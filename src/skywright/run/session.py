"""A vehicle that a script flies: platform, arms, streams, and the rules that monitor it."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import Description, load_description
from skywright.description.mission.safety import Checklist
from skywright.errors import InputError
from skywright.recordings.columns import build_dtype
from skywright.run.backends import build_vehicle
from skywright.run.directory import MISSION, load_run
from skywright.run.faults._watch import RuleActed
from skywright.run.parts import build_rules
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.commanded_arms import CommandedArms
from skywright.vehicle.commands import State
from skywright.vehicle.component import Component
from skywright.vehicle.ended import VehicleEnded
from skywright.vehicle.interface import Backend, Probe, Ticked
from skywright.vehicle.motions import Arrival
from skywright.vehicle.recorded import Phase, RecordedVehicle
from skywright.vehicle.results import Result
from skywright.vehicle.setpoints import Actuators
from skywright.vehicle.telemetry import (
    HandStates,
    JointState,
    Odometry,
    Pose,
    read_battery,
    read_hands,
    read_joints,
    read_odometry,
    read_reference,
    read_transforms,
)
from skywright.vehicle.uav import Uav

STREAMS: dict[str, Callable[[Any], Any]] = {
    "pose": lambda v: v.pose, "velocity": lambda v: v.odometry[1:],
    "odometry": lambda v: v.odometry,
    "transforms": lambda v: v.transforms, "reference": lambda v: v.reference,
    "state": lambda v: v.state, "mode": lambda v: v.mode, "battery": lambda v: v.battery,
    "joints": lambda v: v.joints, "hands": lambda v: v.hands, "tips": lambda v: v.hands.tips,
    "forces": lambda v: v.hands.forces, "deflections": lambda v: v.hands.deflections,
    "torques": lambda v: v.hands.torques,
}  # fmt: skip
"""The streams of `Vehicle.subscribe`, by name."""
RATE_MAX = 50.0  # Hz: a mission tick


class Subscriber(NamedTuple):
    """A subscription to a stream."""

    read: Callable[[Any], Any]
    tell: Callable[[float, Any], None]
    every: int  # mission ticks


class Vehicle(Uav):
    """The vehicle of `skywright.fly`: the blocking commands of `Uav`, arms, probe and streams."""

    def __init__(
        self, backend: Backend, supervisor: Supervisor[Any] | None, arrival: Arrival | None,
        checklist: Checklist | None,
    ) -> None:  # fmt: skip
        """`supervisor` evaluates the rules; None if a recording is played."""
        self._supervisor, self._piloted = supervisor, False
        if supervisor is not None:
            supervisor.pilot.follows = False  # this class reads the switch
        self._subscribers: list[Subscriber] = []
        self.after_tick: list[Callable[[], None]] = []
        """Called after every mission tick."""
        self.closing: list[Callable[[], None]] = []
        """Called by `close`."""
        self._ticks = 0
        self.acted: list[str] = []
        """Reasons of the rules that acted: each ended the flight with its response."""
        fence = None if supervisor is None else supervisor.mission.fence
        super().__init__(
            backend, arrival=arrival, checklist=checklist, fence=fence, tick=self._fly_tick,
            waits=True,
        )  # fmt: skip
        self.arms, self.probe = CommandedArms(self), Probe(backend)
        self._blocks: list[NDArray[Any]] = []
        if supervisor is not None:
            supervisor.vehicle.on_samples = self._blocks.append  # type: ignore[attr-defined]

    @property
    def flying_rules(self) -> list[str]:
        """Reasons of the rules whose response is flown now; empty if none flies."""
        s = self._supervisor
        return [a.says for a in s.faults.acted] if s is not None and s.senses.responding else []

    def fly_plan(self, file: str | os.PathLike[str]) -> Result:
        """Fly a plan file from the present hover position (run/dispatch.py); returns the result.

        Raises InputError if the file is not a plan, or is a plan for another robot.
        """
        from skywright.run.dispatch import dispatch_plan

        return dispatch_plan(self, file)

    def close(self) -> None:
        """Close all connections of the vehicle, including that to a real vehicle.

        A `with` block calls it.
        """
        while self.closing:
            self.closing.pop()()
        self.backend.close()

    def __enter__(self) -> Vehicle:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- streams -----------------------------------------------------------------------------

    @property
    def t(self) -> float:
        """Mission time (s)."""
        return self.backend.t

    @property
    def pose(self) -> Pose:
        """Estimated pose of the platform in W."""
        return self.odometry.pose

    @property
    def odometry(self) -> Odometry:
        """Estimated pose and velocity of the platform."""
        return read_odometry(self.backend)

    @property
    def reference(self) -> Odometry:
        """Commanded pose and velocity of the platform."""
        return read_reference(self.backend)

    @property
    def transforms(self) -> dict[tuple[str, str], Pose]:
        """Poses by (parent, child)."""
        return read_transforms(self.backend)

    @property
    def actuators(self) -> Actuators:
        """Values of actuators: `vehicle.actuators["winch_speed"] = 0.2` sets one."""
        return self.backend.actuators

    @property
    def battery(self) -> float:
        """Remaining share of the battery's energy; NaN without a gauge."""
        return read_battery(self.backend)

    @property
    def joints(self) -> JointState:
        """Joints of the arms."""
        return read_joints(self.backend)

    @property
    def hands(self) -> HandStates:
        """Hands, forces, deflections and torques of compliant arms."""
        return read_hands(self.backend)

    @property
    def samples(self) -> NDArray[Any]:
        """All samples recorded so far, (n,): the columns of a recording, 100 Hz."""
        if self._supervisor is None:
            raise InputError("a recording is read by skywright.open_run")
        vehicle: Any = self.backend
        vehicle.flush()
        return np.concatenate([np.zeros(0, build_dtype(vehicle.recorded.columns)), *self._blocks])

    def subscribe(
        self, stream: str, tell: Callable[[float, Any], None], rate_hz: float = RATE_MAX
    ) -> None:
        """Call `tell(t, value)` with a stream of STREAMS at `rate_hz` (up to 50).

        Raises InputError for another name or rate.
        """
        if stream not in STREAMS:
            raise InputError(f"stream {stream!r} is unknown; valid: {', '.join(STREAMS)}")
        if not 0.0 < rate_hz <= RATE_MAX:
            raise InputError(f"rate_hz = {rate_hz!r}; valid: above 0, up to {RATE_MAX:g}")
        if not callable(tell):
            raise InputError(f"tell = {tell!r}; valid: a function of time and value")
        every = max(round(RATE_MAX / rate_hz), 1)
        self._subscribers.append(Subscriber(STREAMS[stream], tell, every))

    def subscribe_samples(self, tell: Callable[[str, NDArray[Any]], None]) -> None:
        """Call `tell(topic, rows)` with every sensor sample at the sensor's own rate.

        Deflections of compliant arms arrive at 200 Hz; the rows of one call cover about a second.
        """
        if self._supervisor is None:
            raise InputError("a recording is read by skywright.open_run")
        vehicle: Any = self.backend
        vehicle.on_stream = tell

    # --- ticks -------------------------------------------------------------------------------

    def _fly_tick(self) -> Ticked:
        s = self._supervisor
        if s is None:
            ticked = self.backend.tick()
        else:
            try:
                ticked = s.tick_by_hand() if self._state == State.FLYING_MANUAL else s.tick()
            except RuleActed as acted:
                ticked = self._answer(s, acted)
            except VehicleEnded as ended:
                self.acted.append(str(ended))
                self.end(str(ended))
                ticked = Ticked(self.backend.t, 0, True)
            self._follow_switch()
        self._ticks += 1
        for subscriber in self._subscribers:
            if self._ticks % subscriber.every == 0:
                subscriber.tell(self.backend.t, subscriber.read(self))
        for call in self.after_tick:
            call()
        return ticked

    def _follow_switch(self) -> None:
        """Read the pilot's switch on the vehicle itself, which has priority."""
        b = self.backend
        if b.stopped and self._state != State.LANDED_DISARMED:
            self.end(b.stopped)
        elif b.piloted and not self._piloted:
            self._piloted = True
            self.take_over()
        elif self._piloted and not b.piloted:
            self._piloted = False
            if self._state == State.FLYING_MANUAL:
                self.recover_from_manual(wait=False)

    def _answer(self, s: Supervisor[Any], acted: RuleActed) -> Ticked:
        """Fly the response of the rules; the vehicle is then down, and its commands have failed."""
        lost = []
        try:
            s.respond(acted)
        except VehicleEnded as ended:
            s.end("failed")
            lost = [str(ended)]
        says = [*(a.says for a in s.faults.acted), *lost]
        self.acted += says
        s.reset()
        self.end("; then ".join(says))
        return Ticked(self.backend.t, 0, True)

    def _enter(self, state: State | None) -> None:
        before = self._state
        super()._enter(state)
        s = self._supervisor
        if s is None or state is None or state == before:
            return
        if before == State.FLYING_MANUAL:
            s.faults.told.clear()  # what the pilot was told acts from now on
        if state == State.TAKING_OFF:
            s.trail.crumbs.clear()  # the return path ends over the start
        if state in (State.FLYING_AUTO, State.FLYING_MANUAL):
            s.faults.begin(airborne=True)
        elif state == State.LANDED_DISARMED:
            s.reset()
        else:
            s.faults.land()
        if state in (State.LANDED_ARMED, State.TAKING_OFF):
            s.faults.begin(airborne=False)


def open_vehicle(
    description: Description[Any], backend: str, arrival: Arrival | None, checklist: bool,
    parts: Sequence[Component] = (),
) -> Vehicle:  # fmt: skip
    """Build a vehicle and wait until its position is estimated; see `skywright.fly`.

    Raises NoEstimate if it is not; the vehicle's connections are then closed.
    """
    setup = Setup(description)
    vehicle = build_vehicle(description, setup=setup, backend=backend, parts=parts)
    try:
        plan: MissionPlan[Any] = MissionPlan(True, None, 0.0, 0.0, 0.0, 0.0, {})
        supervisor: Supervisor[Any] = Supervisor(
            vehicle, description.mission, plan, description.robot.platform.gear_height_m,
            rules=build_rules(description), surroundings=lambda: setup.clearance_aloft,
        )  # fmt: skip
        checks = description.mission.checklist
        spun = checks.model_copy(update={"spin": True}) if checklist else None
        out = Vehicle(vehicle, supervisor, arrival, spun)
        supervisor.wait_for_estimate()
        while out.state == State.UNINITIALIZED:
            out.tick()
    except BaseException:
        vehicle.close()
        raise
    return out


def open_recording(directory: Path) -> Vehicle:
    """Play a run through the interface of a vehicle; raises InputError if there is no run."""
    run = load_run(directory)
    phases = [Phase(p.name, p.start_s, p.end_s) for p in run.phases]
    setup = Setup(load_description(directory / MISSION))
    recorded = RecordedVehicle(setup, run.samples, phases)
    return Vehicle(recorded, None, None, None)
