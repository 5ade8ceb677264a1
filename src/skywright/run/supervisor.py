"""Runs a mission phase by phase on any back end. Ordinary Python, between mission ticks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from skywright.core.find import blame
from skywright.core.interrupt import check_interrupt
from skywright.description.mission.spec import Mission, T
from skywright.errors import SimulationError
from skywright.run.flight import Flight, PhaseRecord
from skywright.run.kind import load_kind
from skywright.run.operator import Operator, Stick
from skywright.run.planning import MissionPlan
from skywright.run.records import Measurement
from skywright.vehicle.arms_interface import Arms
from skywright.vehicle.guard import FIX_AGE_MAX, LOST_CONTROL
from skywright.vehicle.interface import Backend, Probe, Uav, WholeBody, require

Table = NDArray[Any]

SPIN_UP = 1.0  # s, motors off on the ground while the estimator settles
START_MAX = 10.0  # s, on the ground without an estimate
RELEASE = 3.0  # s, after the robot was let go in the air


class LostControl(Exception):
    """The robot no longer follows its reference; there is nothing left to command."""


class Supervisor(Generic[T]):
    """Flies a mission's phases; `phases` grows while it does."""

    def __init__(
        self,
        vehicle: Backend,
        mission: Mission[T],
        plan: MissionPlan[Any],
        ground_height: float,
        on_phase: Callable[[int, str], None] | None = None,
        on_tick: Callable[[float, str], None] | None = None,
        on_measurement: Callable[[Measurement], None] | None = None,
        operator: Operator | None = None,
    ) -> None:
        """`ground_height` (m): of the platform's origin when it stands on its feet.

        `on_measurement` is called with each contact measurement as soon as it is finished;
        `operator` is there in person, beside what the plan has.
        """
        self.vehicle, self.mission, self._plan = vehicle, mission, plan
        self.kind, self.task, self.segments = load_kind(mission.kind), mission.task, plan.segments
        self.ground_height = ground_height
        self.phases: list[PhaseRecord] = []
        self._on_phase, self._on_tick = on_phase, on_tick
        self._on_measurement = on_measurement
        self.measurements: list[Measurement] = []
        self.watch: Callable[[], None] | None = None  # called each tick; may raise to stop a move
        self.operator = operator or plan.operator
        self.sticks: list[tuple[float, Stick]] = []  # s since it took over, and what it did
        self._open: tuple[str, float] | None = None
        self.uav, self.arms = Uav(vehicle), Arms(vehicle)
        self.body, self.probe = WholeBody(vehicle), Probe(vehicle)

    def fly(self) -> Flight:
        """Run the whole mission; returns when it has landed, or when control was lost."""
        try:
            return self._fly()
        except LostControl as error:
            self.end("failed")
            return Flight(False, str(error))

    def _fly_kind(self, way: Any) -> Flight:
        with blame(type(self.kind), "mission.kind: fly", SimulationError):
            return self.kind.fly(self, way)

    def _fly(self) -> Flight:
        kind, way = self.kind, self._plan.get_way()
        require(self.vehicle, kind.needs, self.mission.name)
        if not kind.flies:
            flight = self._fly_kind(way)
            self.end("done")
            return flight
        self.begin("start")
        self.wait(SPIN_UP)
        self.wait_for_estimate()
        self.uav.motors(True)
        if kind.held:
            self.begin("release")
            self.vehicle.release()
            self.wait(RELEASE)
        else:
            self.begin("take_off")
            self.uav.take_off(self.mission.hover_height_m)
            self.until_arrived()
            self.wait(1.0)
        flight = self._fly_kind(way)
        if not kind.lands:
            self.end("done")
            return flight
        self.begin("land")
        self.uav.land(self.ground_height)
        self.until_arrived()
        self.uav.motors(False)
        self.wait(1.0)
        self.end("done")
        return flight

    # --- what a kind of mission is written with --------------------------------------------------

    def follow(self, name: str, table: Table) -> None:
        """Fly the phase `name` along a table to its end."""
        self.begin(name)
        self.body.track(table)
        self.until_arrived()
        self.end("done")

    def until_arrived(self) -> None:
        """Tick until the tracked table has ended."""
        while not self.tick().arrived:
            pass

    def wait(self, seconds: float) -> None:
        """Tick for a time (s)."""
        end = self.vehicle.t + seconds
        while self.vehicle.t < end - 1e-9:
            self.tick()

    def wait_for_estimate(self) -> None:
        """Tick until the estimator knows a place; raises LostControl where it never does."""
        while not self.vehicle.localised:
            if self.vehicle.t > START_MAX:
                raise LostControl(
                    f"it did not take off: after {START_MAX:g} s on the ground the localisation "
                    "has not told where it is (world.localisation, and what it needs)"
                )
            self.wait(0.1)

    def tick(self, guards: int = 0) -> Any:
        """Run one mission tick; raises LostControl when there is nothing left to command."""
        check_interrupt()
        ticked = self.vehicle.tick(guards)
        if ticked.fired & LOST_CONTROL:
            raise LostControl(self._explain_lost_control())
        if self._on_tick is not None:
            self._on_tick(ticked.t, self._open[0] if self._open else "")
        if self.watch is not None:
            self.watch()
        return ticked

    def _explain_lost_control(self) -> str:
        est, ref = self.vehicle.estimate, self.vehicle.reference
        error = float(np.linalg.norm(est["p_WB"] - ref["p_WB"]))
        age = self.vehicle.fix_age
        if age > FIX_AGE_MAX:
            return (
                f"control was lost in {self._open[0] if self._open else 'the flight'} at t = "
                f"{self.vehicle.t:.1f} s: nothing told where it is for {age:.1f} s"
            )
        tilt = math.degrees(math.acos(min(max(float(est["R_WB"][2, 2]), -1.0), 1.0)))
        phase = self._open[0] if self._open else "the flight"
        return (
            f"control was lost in {phase} at t = {self.vehicle.t:.1f} s: {error:.2f} m from the "
            f"reference, tilted {tilt:.0f} deg"
        )

    def report(self, measurement: Measurement) -> None:
        """Keep a finished measurement and hand it on."""
        self.measurements.append(measurement)
        if self._on_measurement is not None:
            self._on_measurement(measurement)

    def begin(self, name: str) -> None:
        """End the open phase and start the phase `name`."""
        self.end("done")
        self._open = (name, self.vehicle.t)
        if self._on_phase is not None:
            self._on_phase(len(self.phases), name)

    def end(self, outcome: str) -> None:
        """End the open phase as "done", "retry" or "failed"."""
        if self._open is not None:
            name, start = self._open
            self.phases.append(PhaseRecord(name, start, self.vehicle.t, outcome))
            self._open = None

    def close(self, outcome: str) -> None:
        """End the open phase, if any, when a run stops early."""
        self.end(outcome)
