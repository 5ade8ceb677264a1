"""Runs a mission phase by phase on any back end. Ordinary Python, between mission ticks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from skywright.core.find import blame
from skywright.core.interrupt import check_interrupt
from skywright.description.mission.spec import Mission, T
from skywright.errors import SimulationError, SkywrightError
from skywright.models.geometry import ClearanceQuery
from skywright.run.duration import HOVER, RELEASE, SPIN_UP
from skywright.run.faults._response import LANDED_S, respond, wait_until_still
from skywright.run.faults._rule import Acted, Response, Rule
from skywright.run.faults._senses import Senses
from skywright.run.faults._trail import Trail
from skywright.run.faults._watch import RuleActed, Watch
from skywright.run.flight import NO_TAKE_OFF, Flight, PhaseRecord
from skywright.run.kind import load_kind
from skywright.run.operator import Operator, Stick
from skywright.run.orders import Orders
from skywright.run.parts import build_default_rules
from skywright.run.pilot import GivenBack, Pilot, PilotLanded
from skywright.run.planning import MissionPlan
from skywright.run.records import Measurement
from skywright.vehicle.arms_interface import Arms
from skywright.vehicle.ended import VehicleEnded
from skywright.vehicle.interface import Backend, Probe, Ticked, WholeBody, require
from skywright.vehicle.motions import SPIN_S
from skywright.vehicle.moves import Moves
from skywright.vehicle.preflight import Checked, check_rotors, run_checklist
from skywright.vehicle.results import Result
from skywright.vehicle.ticker import StepFailed

Table = NDArray[Any]

START_MAX = 10.0  # s, on the ground without an estimate


class NoEstimate(SkywrightError):
    """Raised if the position is not estimated: the robot stays on the ground."""

    exit_code = 1  # as a mission that ends without take-off


class Supervisor(Generic[T]):
    """Flies a mission's phases and appends them to `phases`."""

    def __init__(
        self,
        vehicle: Backend,
        mission: Mission[T],
        plan: MissionPlan[Any],
        ground_height: float,
        on_phase: Callable[[Sequence[PhaseRecord], str], None] | None = None,
        on_tick: Callable[[float, str], None] | None = None,
        on_measurement: Callable[[Measurement], None] | None = None,
        operator: Operator | None = None,
        rules: Sequence[Rule] | None = None,
        surroundings: Callable[[], ClearanceQuery] | None = None,
        on_acted: Callable[[Acted], None] | None = None,
    ) -> None:
        """`ground_height` (m): height of the platform's origin when the robot stands on the ground.

        `on_phase` is called with the phases before and the name of each phase that begins.
        `on_measurement` is called with each contact measurement as soon as it is finished.
        `operator` is a live operator, who replaces that of the plan. `rules` define the responses
        to faults (default: the built-in ones); `on_acted` is called when one acts. `surroundings`
        returns the nominal scene, for landings beside objects.
        """
        self.vehicle, self.mission, self._plan = vehicle, mission, plan
        self.kind, self.task, self.segments = load_kind(mission.kind), mission.task, plan.segments
        self.ground_height = ground_height
        self.phases: list[PhaseRecord] = []
        self._on_phase, self._on_tick = on_phase, on_tick
        self._on_measurement = on_measurement
        self.measurements: list[Measurement] = []
        self.watch: Callable[[], None] | None = None  # called each tick; may raise to stop a motion
        self.operator = operator or plan.operator
        self.sticks: list[tuple[float, Stick]] = []  # s since it took over, and its input
        self.stretches: list[float] = []  # s, start of each piece of its work
        self.checked: list[Checked] = []  # the pre-flight checks
        self.way: Any = plan.way
        self.turns = False  # the remaining rotors do not hold the heading
        self.R_hold: NDArray[np.float64] | None = None  # of hovering with lost rotors, heading 0
        self._open: tuple[str, float] | None = None
        self.senses, self.trail, self.surroundings = (
            Senses(vehicle, mission.fence, mission.noise_sigmas),
            Trail(),
            surroundings,
        )
        rules = build_default_rules() if rules is None else rules
        self.faults = Watch(rules, self.senses, on_acted)
        self.pilot, self.orders = Pilot(self), Orders(self)
        self.uav, self.arms = Moves(vehicle), Arms(vehicle)
        self.body, self.probe = WholeBody(vehicle), Probe(vehicle)
        self.devices = vehicle.devices.grant(mission.kind, self.kind.devices)

    def fly(self) -> Flight:
        """Run the whole mission; returns when the robot is down, also after a fault."""
        try:
            return self.orders.judge(self._fly())
        except NoEstimate as error:
            self.end("failed")
            return Flight(False, str(error))
        except PilotLanded as landed:
            self.wait(1.0)
            self.end("done")
            return self.conclude(str(landed))
        except VehicleEnded as ended:
            self.end("failed")
            return self.conclude(str(ended))
        except (RuleActed, GivenBack) as first:
            return self._answer(first)

    def _answer(self, first: RuleActed | GivenBack) -> Flight:
        """Fly a response, as far as the vehicle is able to."""
        try:
            return self.conclude(self.respond(first))
        except VehicleEnded as ended:
            self.end("failed")
            return self.conclude(str(ended))

    def conclude(self, says: str = "") -> Flight:
        """Return a flight that rules ended, or that ended early for the reason `says`."""
        acted = tuple(self.faults.acted)
        reasons = [*(a.says for a in acted), *([says] if says else [])]
        return Flight(False, "; then ".join(reasons), acted)

    def respond(self, acted: RuleActed | GivenBack) -> str:
        """Fly the response of the rule that acted, and of stronger ones that act meanwhile.

        If a pilot gave back and the mission cannot continue, the robot comes home. Returns the
        reason due to pilots, or "".
        """
        self.watch, says = None, ""
        response: Response | None = None
        while True:
            self.end("failed")
            try:
                if isinstance(acted, RuleActed):
                    response = self.faults.answer(acted.rule, self)
                else:
                    says = says or str(acted)
                    response = self.faults.rise("come_home", response)
                respond(self, response)
            except (RuleActed, GivenBack) as other:
                acted = other
                continue
            except PilotLanded as landed:
                says = str(landed)
            self.end("done")
            return says

    def reset(self) -> None:
        """Forget the last flight of a session: its responses, its path, the values of its rules.

        Lost rotors remain lost (`turns`, `R_hold`): the allocation works without them.
        """
        self.senses.reset()
        self.faults.reset()
        self.trail.crumbs.clear()

    # --- the pilot ---------------------------------------------------------------------------

    def take_over(self) -> Result:
        """Give a pilot control of the platform from the next tick on; the arms keep their posture.

        Accepted at any time while the motors run; the result has the reason of a refusal.
        """
        return self.pilot.take_over()

    def give_back(self) -> Result:
        """Return control of the platform to the mission: brake, and continue if possible.

        Refused, with the reason, if tilt, speed or height do not allow it.
        """
        return self.pilot.give_back()

    def choose_mode(self, mode: str) -> Result:
        """Select the mode of the pilot's stick: "position", "angle" or "attitude" (the default).

        Refused, with the reason, if the robot cannot fly the mode or there is no such mode.
        """
        return self.pilot.choose(mode)

    def move_stick(self, axes: Sequence[float]) -> Result:
        """Set the pilot's stick (4,): right, ahead, turn to the left, climb, each from -1 to 1.

        Larger values are limited. Refused, with the reason, unless all four are finite numbers.
        """
        return self.pilot.move(axes)

    def order(self, what: str) -> Result:
        """Accept an operator's order: "next", "retry" or "retract" (run/orders.py).

        Refused, with the reason, if it does not apply or there is no such order.
        """
        return self.orders.give(what)

    def _fly_kind(self, way: Any) -> Flight:
        with blame(type(self.kind), "mission.kind: fly", SimulationError):
            return self.kind.fly(self, way)

    def _fly(self) -> Flight:
        kind, way = self.kind, self._plan.get_way()
        require(self.vehicle, kind.needs, self.mission.name, kind.devices)
        if not kind.flies:
            flight = self._fly_kind(way)
            self.end("done")
            return flight
        self.begin("start")
        self.wait(SPIN_UP)
        self.wait_for_estimate()
        failed = [c.says for c in self.check_before_flight() if not c.passed]
        if failed:
            self.end("failed")
            return Flight(False, f"{NO_TAKE_OFF}{'; '.join(failed)} (mission.checklist)")
        self.uav.motors(True)
        self.faults.begin(airborne=False)
        if kind.held:
            self.begin("release")
            self.vehicle.release()
            self.wait(RELEASE)
        else:
            self.begin("take_off")
            self.uav.take_off(self.mission.hover_height_m)
            self.until_arrived()
            self.wait(HOVER)
        self.trail.crumbs.clear()  # the return path ends over the start
        self.faults.begin(airborne=True)
        flight = self._fly_kind(way)
        if not kind.lands:
            self.end("done")
            return flight
        self.begin("land")
        self.faults.land()
        self.uav.land(self.ground_height)
        self.until_arrived()
        self.uav.motors(False)
        wait_until_still(self, LANDED_S)
        self.end("done")
        return flight

    # --- interface of kinds of missions ----------------------------------------------------------

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

    @property
    def clock(self) -> float:
        """Mission time (s) less the time for which pilots interrupted the mission.

        Durations of free flight are measured with it.
        """
        return self.vehicle.t - self.pilot.away_s

    def wait(self, seconds: float) -> None:
        """Tick for a time (s) without pilot flight."""
        end = self.clock + seconds
        while self.clock < end - 1e-9:
            self.tick()

    def hold(self, seconds: float) -> None:
        """Tick for a time (s) without pilot flight; the order `next` ends it early."""
        for _ in self.orders.passes(seconds):
            pass

    def wait_for_estimate(self) -> None:
        """Tick until the estimator has a position; raises NoEstimate after START_MAX."""
        while not self.vehicle.localised:
            if self.vehicle.t > START_MAX:
                raise NoEstimate(
                    f"{NO_TAKE_OFF}the localisation gave no position within {START_MAX:g} "
                    "s on the ground (check world.localisation and its sensors)"
                )
            self.wait(0.1)

    def check_before_flight(self) -> list[Checked]:
        """Run the mission's checklist; if it includes the spin check, the motors run for it."""
        checklist, vehicle = self.mission.checklist, self.vehicle
        self.checked = run_checklist(checklist, vehicle, self.mission.fence)
        if checklist.spin and all(c.passed for c in self.checked):
            self.uav.motors(True)
            self.wait(SPIN_S)
            self.checked.append(check_rotors(checklist, vehicle))
            if not self.checked[-1].passed:
                self.uav.motors(False)
        return self.checked

    def tick(self, guards: int = 0) -> Any:
        """Run one mission tick, followed by the pilot's flight if a pilot takes over.

        Raises RuleActed if a rule ends the mission, GivenBack if a pilot does, and ContactEnded if
        an operator's order ends a contact.
        """
        ticked = self._tick(guards)
        if self.kind.flies:
            if self.pilot.switch:
                self.pilot.fly()
                return self.tick(guards)
            self.trail.drop(self.senses)
            self.faults.look(self.phase)
        if self.watch is not None:
            self.watch()
        self.orders.follow()
        return ticked

    def tick_by_hand(self) -> Ticked:
        """Run one mission tick while a pilot flies: only rules that override the pilot act."""
        ticked = self._tick(0)
        self.trail.drop(self.senses)
        self.faults.tell(self.phase)
        return ticked

    def _tick(self, guards: int) -> Ticked:
        check_interrupt()
        try:
            ticked = self.vehicle.tick(guards)
        except StepFailed as failed:
            if not self.faults.bears(str(failed)):
                raise
            self.senses.restarts = self.vehicle.stop_computer(failed)
            ticked = Ticked(self.vehicle.t, 0, False)
        self.senses.refresh()
        if self.kind.flies:
            self.pilot.follow_switch()
        if self._on_tick is not None:
            self._on_tick(ticked.t, self.phase)
        return ticked

    @property
    def phase(self) -> str:
        """Name of the open phase, "" if there is none."""
        return self._open[0] if self._open else ""

    def report(self, measurement: Measurement) -> None:
        """Store a finished measurement and pass it to `on_measurement`."""
        self.measurements.append(measurement)
        if self._on_measurement is not None:
            self._on_measurement(measurement)

    def begin(self, name: str) -> None:
        """End the open phase and start the phase `name`."""
        self.end("done")
        self._open = (name, self.vehicle.t)
        if self._on_phase is not None:
            self._on_phase(self.phases, name)

    def end(self, outcome: str) -> None:
        """End the open phase, if any, with an outcome of PhaseRecord."""
        if self._open is not None:
            name, start = self._open
            self.phases.append(PhaseRecord(name, start, self.vehicle.t, outcome))
            self._open = None
