"""Runs a mission phase by phase on any back end. Ordinary Python, between mission ticks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.missions.planning import MissionPlan
from skywright.missions.spec import Mission
from skywright.missions.tables import build_retreat, cut_table, lift_table, reverse_table
from skywright.vehicle.guard import CONTACT_LOST, FIX_AGE_MAX, LOST_CONTROL
from skywright.vehicle.interface import Backend, Probe, Uav, WholeBody, require

Table = NDArray[Any]

SPIN_UP = 1.0  # s, motors off on the ground while the estimator settles
TRIM_ERROR = 0.003  # m, tip error at which the free-flight integral is called settled
TRIM_TIMES = (2.0, 12.0)  # s, least and most time for it
SETTLE = 4.0  # s in contact before sliding: the attitude integral takes up the push
LOST_PATIENCE = 0.5  # s without contact before the scan backs off


class PhaseRecord(NamedTuple):
    """One phase as it was flown."""

    name: str
    start_s: float
    end_s: float
    outcome: str  # "done", "retry", "failed"


class Flight(NamedTuple):
    """How a mission went."""

    completed: bool
    reason: str  # why it was cut short, or ""


class LostControl(Exception):
    """The robot no longer follows its reference; there is nothing left to command."""


class Supervisor:
    """Flies a mission's phases; `phases` grows while it does."""

    def __init__(
        self,
        vehicle: Backend,
        mission: Mission,
        plan: MissionPlan,
        ground_height: float,
        on_phase: Callable[[int, str], None] | None = None,
        on_tick: Callable[[float, str], None] | None = None,
    ) -> None:
        """`ground_height` (m): of the platform's origin when it stands on its feet."""
        self.vehicle, self.mission, self.plan = vehicle, mission, plan
        self.ground_height = ground_height
        self.phases: list[PhaseRecord] = []
        self._on_phase, self._on_tick = on_phase, on_tick
        self._open: tuple[str, float] | None = None
        self.uav, self.body, self.probe = Uav(vehicle), WholeBody(vehicle), Probe(vehicle)

    def fly(self) -> Flight:
        """Run the whole mission; returns when it has landed, or when control was lost."""
        try:
            return self._fly()
        except LostControl as error:
            self._end("failed")
            return Flight(False, str(error))

    def _fly(self) -> Flight:
        kind = self.mission.kind
        needs = {"scan": {"uav", "whole_body", "probe"}, "waypoints": {"uav"}}[kind]
        require(self.vehicle, frozenset(needs), self.mission.name)
        self._begin("start")
        self._wait(SPIN_UP)
        self._begin("take_off")
        self.uav.motors(True)
        self.uav.take_off(self.mission.hover_height_m)
        self._until_arrived()
        self._wait(1.0)
        flight = self._scan() if kind == "scan" else self._waypoints()
        self._begin("land")
        self.uav.land(self.ground_height)
        self._until_arrived()
        self.uav.motors(False)
        self._wait(1.0)
        self._end("done")
        return flight

    # --- the missions --------------------------------------------------------------------------

    def _waypoints(self) -> Flight:
        for i, (name, table) in enumerate(self.plan.segments.items()):
            self._follow(name, table)
            hold = self.mission.waypoints[i].hold_s if i < len(self.mission.waypoints) else 0.0
            if hold > 0.0:
                self._begin(f"hold {i + 1}")
                self._wait(hold)
        return Flight(True, "")

    def _scan(self) -> Flight:
        segments = self.plan.segments
        assert self.mission.scan is not None
        for name in ("approach", "unfold", "close_in"):
            self._follow(name, segments[name])
        retries = self.mission.scan.retries
        table, done = segments["scan"], 0.0
        touch: Table = segments["touch"]
        away: Table | None = None  # from the present surface place back to the stand-off
        for attempt in range(retries + 1):
            self._trim()
            if not self._touch(touch):
                away = reverse_table(touch)
                self._follow("back_off", away)
                continue
            lost_at = self._slide(cut_table(table, done) if done else table)
            if lost_at is None:
                for name in ("leave", "fold", "return"):
                    self._follow(name, segments[name])
                return Flight(True, "")
            done += lost_at
            row = np.array(self.vehicle.reference)
            distance = float(np.linalg.norm(touch["p_WT"][0] - touch["p_WT"][-1]))
            self._follow("back_off", build_retreat(row, distance, 4.0))
            touch = build_retreat(row, distance, 8.0, back=True)
            if attempt == retries:
                break
        self._go_home(done)
        where = f"after {done:.1f} s of the scan" if done else "at the first touch"
        return Flight(False, f"no lasting contact {where}, {retries} retries used")

    def _touch(self, table: Table) -> bool:
        self._follow("touch", table)
        self._begin("settle")
        self.body.hold()
        self._wait(SETTLE)
        made = self.probe.in_contact()
        self._end("done" if made else "retry")
        return made

    def _slide(self, table: Table) -> float | None:
        """Follow the scan; returns the time along `table` at which contact was lost for good."""
        self._begin("scan")
        self.body.track(table)
        start, out_since = self.vehicle.t, None
        while True:
            ticked = self._tick(CONTACT_LOST)
            if self.probe.in_contact():
                out_since = None
            elif out_since is None:
                out_since = ticked.t
            elif ticked.t - out_since > LOST_PATIENCE:
                self._end("retry")
                return out_since - start
            if ticked.arrived:
                self._end("done")
                return None

    def _trim(self) -> None:
        """Let the integral settle at the stand-off, all directions, before touching."""
        self._begin("trim")
        self.body.hold()
        start = good_since = self.vehicle.t
        while True:
            t = self._tick().t
            error = self.vehicle.reference["p_WT"] - self.vehicle.estimate["p_WT"]
            if float(np.linalg.norm(error)) > TRIM_ERROR:
                good_since = t
            if (t - start > TRIM_TIMES[0] and t - good_since > 1.0) or t - start > TRIM_TIMES[1]:
                self._end("done")
                return

    def _go_home(self, done: float) -> None:
        """Back along the planned way: over the scanned path at the stand-off, then the approach."""
        segments = self.plan.segments
        flown = segments["scan"][segments["scan"]["t"] <= done]
        touch = segments["touch"]
        lift = float(np.linalg.norm(touch["p_WT"][0] - touch["p_WT"][-1]))
        if done > 0.0 and len(flown) > 1:
            self._follow("retrace", reverse_table(lift_table(flown, lift), speed_up=4.0))
        for name in ("close_in", "unfold", "approach"):
            self._follow(f"reverse {name}", reverse_table(segments[name]))

    # --- the machinery -------------------------------------------------------------------------

    def _follow(self, name: str, table: Table) -> None:
        self._begin(name)
        self.body.track(table)
        self._until_arrived()
        self._end("done")

    def _until_arrived(self) -> None:
        while not self._tick().arrived:
            pass

    def _wait(self, seconds: float) -> None:
        end = self.vehicle.t + seconds
        while self.vehicle.t < end - 1e-9:
            self._tick()

    def _tick(self, guards: int = 0) -> Any:
        ticked = self.vehicle.tick(guards)
        if ticked.fired & LOST_CONTROL:
            raise LostControl(self._explain_lost_control())
        if self._on_tick is not None:
            self._on_tick(ticked.t, self._open[0] if self._open else "")
        return ticked

    def _explain_lost_control(self) -> str:
        est, ref = self.vehicle.estimate, self.vehicle.reference
        error = float(np.linalg.norm(est["p_WB"] - ref["p_WB"]))
        age = self.vehicle.fix_age
        if age > FIX_AGE_MAX:
            return (
                f"control was lost in {self._open[0] if self._open else 'the flight'} at t = "
                f"{self.vehicle.t:.1f} s: no motion capture for {age:.1f} s"
            )
        tilt = math.degrees(math.acos(min(max(float(est["R_WB"][2, 2]), -1.0), 1.0)))
        phase = self._open[0] if self._open else "the flight"
        return (
            f"control was lost in {phase} at t = {self.vehicle.t:.1f} s: {error:.2f} m from the "
            f"reference, tilted {tilt:.0f} deg"
        )

    def _begin(self, name: str) -> None:
        self._end("done")
        self._open = (name, self.vehicle.t)
        if self._on_phase is not None:
            self._on_phase(len(self.phases), name)

    def _end(self, outcome: str) -> None:
        if self._open is not None:
            name, start = self._open
            self.phases.append(PhaseRecord(name, start, self.vehicle.t, outcome))
            self._open = None

    def close(self, outcome: str) -> None:
        """End the open phase, if any, when a run stops early."""
        self._end(outcome)
