"""One execution of a mission and its directory.

`run_mission` executes these steps in order: plan, open the directory, fly, evaluate, write, rename.
The directory is NAME.partial until it is complete; its recording can be read up to the last
seconds.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from skywright.core.find import blame, explain
from skywright.core.threads import on_one_thread
from skywright.description.loader import Description, load_description
from skywright.description.mission.spec import T
from skywright.errors import InfeasibleError, InputError, SimulationError, SkywrightError
from skywright.models.capability import check_can_fly
from skywright.planning.motion.plan_file import write_plan_file
from skywright.recordings.columns import build_dtype
from skywright.run.backends import PHYSICS, build_for_mission, check_backend
from skywright.run.directory import (
    MISSION,
    UNFINISHED,
    load_run,
    open_directory,
    to_plain,
    write_json,
    write_unfinished,
)
from skywright.run.faults._rule import Acted, Rule
from skywright.run.flight import Flight, Flown, PhaseRecord
from skywright.run.flight_recording import FlightRecording, Pace
from skywright.run.inspected import Inspected, read_inspected
from skywright.run.kind import P, load_kind
from skywright.run.metrics import compute_common_metrics
from skywright.run.operated import check_operator, keep_operator, write_mission
from skywright.run.operator import Operator
from skywright.run.parts import build_rules
from skywright.run.planning import MissionPlan, plan_mission
from skywright.run.records import FlightRecords, Measurement
from skywright.run.requirements import (
    BROKEN,
    Verdict,
    check_requirements,
    describe_outcome,
    is_judgement,
    judge_run,
)
from skywright.run.result import RunResult
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.run.warm_up import is_compiled, start_warm_up
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.time_limit import watch


class Observer(Protocol):
    """Observes a run; the optional method `on_acted(acted)` is called when a rule acts.

    The optional method `on_supervisor(supervisor)` is called once: it may `take_over`, `give_back`.
    """

    def on_plan(self, plan: MissionPlan[Any], description: Description) -> None:
        """Called after planning, before the flight."""

    def on_tick(self, t: float, phase: str, vehicle: SimulatedVehicle) -> None:
        """Called after each mission tick."""

    def close(self) -> None:
        """Called after the flight."""


@on_one_thread
def run_mission(
    description: Description,
    *,
    out: Path | None = None,
    observers: Sequence[Observer] = (),
    write_report: Callable[[RunResult], None] | None = None,
    records: Path | None = None,
    operator: Operator | None = None,
    command: str = "",
    backend: str = PHYSICS,
) -> RunResult:
    """Plan, fly and evaluate a mission, and write its run directory.

    `write_report` is called with the result while the directory is still NAME.partial. `records` is
    the file (SQLite) in which contact measurements are stored as soon as they are finished.
    `backend` flies the mission (run/backends.py). `operator` is a live operator at the stick, for
    missions that have one; its input is written to operator.csv. `command` is stored in
    metrics.json.

    Raises InputError (nothing was started), InfeasibleError (no plan exists). The directory of a
    diverged or interrupted run stays NAME.partial.
    """
    start = time.perf_counter()
    if operator is not None:
        check_operator(description)
    setup, rules = Setup(description), build_rules(description)
    check_backend(setup, backend)  # reports a back end that cannot fly it before planning
    plan, vehicle = _prepare(setup, backend, observers)  # reports an invalid component first
    try:
        store = None if records is None else FlightRecords(records, setup)
        final, partial = open_directory(out, description.mission.name)
        write_mission(partial, description, plan)
        write_unfinished(partial)
        if plan.file is not None:
            write_plan_file(partial / "plan", plan.file)
    except BaseException:
        vehicle.close()
        raise
    try:
        for observer in observers:
            observer.on_plan(plan, description)
        keep = None if store is None else store.start(final)
        samples, phases, flight, outcome = _fly(
            setup, plan, vehicle, rules, partial, observers, keep, operator
        )
    finally:
        vehicle.close()
        if store is not None:
            store.close()
        for observer in observers:
            observer.close()
    flown = Flown(setup, plan, samples, phases)
    result = _evaluate(flown, flight, outcome, partial)
    result = result._replace(command=command, backend=backend)
    _add_timing(result, start)
    try:
        write_json(partial / "metrics.json", result.to_json())
        if write_report is not None and outcome not in UNFINISHED:
            write_report(result)
    except (KeyboardInterrupt, Exception) as error:
        if outcome not in UNFINISHED:  # otherwise the reason for this outcome is the first one
            reason = f"the run's directory was not finished: {_describe(error)}"
            result = result._replace(outcome="interrupted", reason=reason)
            with suppress(InputError):  # on a full disk only the directory's name states it
                write_json(partial / "metrics.json", result.to_json())
    if result.outcome in UNFINISHED:
        return result
    partial.rename(final)
    if store is not None:
        store.add(flown)
    return result._replace(directory=final)


@on_one_thread
def fly_and_evaluate(description: Description, observers: Sequence[Observer] = ()) -> RunResult:
    """Plan, fly and evaluate a mission without writing anything; `directory` is the current one.

    The result equals that of `run_mission` bit for bit, except for timing. Raises the same errors,
    and KeyboardInterrupt. Only `on_tick` of the `observers` is called.
    """
    start = time.perf_counter()
    setup, rules = Setup(description), build_rules(description)
    plan, vehicle = _prepare(setup)
    samples, phases, flight, outcome = _fly(setup, plan, vehicle, rules, None, observers)
    result = _evaluate(Flown(setup, plan, samples, phases), flight, outcome, Path())
    _add_timing(result, start)
    return result


@on_one_thread
def evaluate_directory(directory: Path) -> RunResult:
    """Evaluate a run's directory (or NAME.partial) again from its recording.

    A killed run is evaluated as interrupted, with phases from the recording's events. Raises
    InputError if files are missing or damaged.
    """
    stored = load_run(directory)
    setup = Setup(load_description(directory / MISSION))
    check_requirements(setup.description.mission)
    plan = plan_mission(setup.description, setup)
    outcome = stored.outcome if stored.outcome in UNFINISHED else ""
    reason = "" if is_judgement(stored.reason) else stored.reason  # it is judged again
    whole = stored.outcome in ("succeeded", "failed")
    flown = Flown(setup, plan, stored.samples, stored.phases)
    result = _evaluate(flown, Flight(whole, reason, stored.acted), outcome, directory)
    return result._replace(
        timing=stored.timing, command=str(stored.written.get("command", "")),
        backend=str(stored.written.get("backend", PHYSICS)),
        checklist=tuple(stored.written.get("checklist", ())),
    )  # fmt: skip


def _prepare(
    setup: Setup[Any], backend: str = PHYSICS, observers: Sequence[Observer] = ()
) -> tuple[MissionPlan[Any], SimulatedVehicle]:
    """Plan the mission and build its vehicle; compiles both in parallel if necessary."""
    description, mission = setup.description, setup.description.mission
    check_can_fly(description.robot, description.world.gravity_mps2)
    check_requirements(mission)
    warm_up = None if is_compiled() else start_warm_up(description)
    try:
        plan = plan_mission(description, setup)
        if warm_up is not None:
            plan = plan_mission(description, setup)  # the first one compiled: its time is invalid
        if not plan.feasible:
            raise InfeasibleError(f"no plan: {plan.blocked_by}", str(plan.blocked_by))
        if warm_up is not None:
            warm_up.wait()
    except BaseException:
        if warm_up is not None:
            warm_up.terminate()  # the part compiled so far is cached
        raise
    parts = [part for o in observers for part in getattr(o, "parts", ())]
    return plan, build_for_mission(description, setup, backend, parts)


def _add_timing(result: RunResult, start: float) -> None:  # of time.perf_counter
    wall = time.perf_counter() - start
    simulated = float(result.samples["t"][-1]) if len(result.samples) else 0.0
    result.timing.update(
        simulated_s=simulated, wall_s=wall, real_time_factor=simulated / wall,
        plan_s=result.plan.plan_s, started_unix_s=round(time.time() - wall, 3),
    )  # fmt: skip


def _fly(
    setup: Setup[Any],
    plan: MissionPlan[Any],
    vehicle: SimulatedVehicle,
    rules: list[Rule],
    partial: Path | None,
    observers: Sequence[Observer],
    on_measurement: Callable[[Measurement], None] | None = None,
    operator: Operator | None = None,
) -> tuple[NDArray[Any], list[PhaseRecord], Flight, str]:
    """Fly the mission and record it; returns samples, phases, flight and outcome.

    Without a directory `partial` nothing is recorded.
    """
    description, robot = setup.description, setup.robot
    written, pace, blocks = 0, Pace(), list[NDArray[Any]]()
    writer: FlightRecording | None = None
    if partial is not None:
        writer = FlightRecording(partial, robot, vehicle.recorded)
        vehicle.on_stream = writer.append_stream
    vehicle.on_samples = blocks.append

    def flush() -> None:
        nonlocal written
        vehicle.flush()
        if writer is not None and written < len(blocks):
            writer.append(np.concatenate(blocks[written:]))
            written = len(blocks)

    def on_tick(t: float, phase: str) -> None:
        if pace.is_due(t):
            flush()
        for observer in observers:
            observer.on_tick(t, phase, vehicle)

    def on_phase(before: Sequence[PhaseRecord], name: str) -> None:
        vehicle.set_phase(len(before))
        if writer is not None:
            writer.phase(vehicle.t, name, before[-1].outcome if before else "done")

    def on_acted(acted: Acted) -> None:
        hearing = [getattr(o, "on_acted", None) for o in observers]
        for hear in filter(None, [writer and writer.acted, *hearing]):
            hear(acted)

    supervisor = Supervisor(
        vehicle, description.mission, plan, robot.platform.gear_height_m, on_phase, on_tick,
        on_measurement, operator, rules, lambda: setup.clearance_aloft, on_acted,
    )  # fmt: skip
    for hear in filter(None, [getattr(o, "on_supervisor", None) for o in observers]):
        hear(supervisor)

    def on_stuck(says: str) -> None:  # ends the process: compiled code cannot be interrupted
        flush()
        if writer is not None and partial is not None:
            writer.event(vehicle.t, f"diverged: {says}")
            writer.close()
            write_unfinished(partial, "diverged", says)
        print(f"error: {says}", file=sys.stderr, flush=True)
        os._exit(SimulationError.exit_code)

    outcome, flight = "", Flight(False, "")
    try:
        with watch(vehicle.ticker, on_stuck, description.mission.step_limit_s):
            flight = supervisor.fly()
    except KeyboardInterrupt:
        if writer is None:  # nothing of this flight is stored, so the caller is interrupted
            raise
        outcome, flight = "interrupted", supervisor.conclude("interrupted by the user")
    except SimulationError as error:
        outcome, flight = "diverged", supervisor.conclude(str(error))
    except InputError as error:  # the recording cannot be written: the disk is full
        outcome, flight = "interrupted", supervisor.conclude(str(error))
    supervisor.end("interrupted" if outcome else "done")
    flight = flight._replace(checklist=tuple(c.to_json() for c in supervisor.checked))
    try:
        flush()
        if operator is not None and partial is not None and supervisor.sticks:
            keep_operator(partial, description, supervisor.sticks, supervisor.stretches)
        if writer is not None:
            if outcome:
                writer.event(vehicle.t, f"{outcome}: {flight.reason}")
            writer.close()
    except InputError as error:
        outcome, flight = "interrupted", supervisor.conclude(str(error))
    samples = np.concatenate(blocks or [np.zeros(0, build_dtype(vehicle.recorded.columns))])
    blocks.clear()  # the vehicle is in a reference cycle, which Python may free many flights later
    return samples, supervisor.phases, flight, outcome


def _describe(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted by the user"
    return str(error) if isinstance(error, SkywrightError | OSError) else explain(error)


def _evaluate(run: Flown[T, P], flight: Flight, outcome: str, directory: Path) -> RunResult[T, P]:
    description, plan = run.setup.description, run.plan
    kind, arm = load_kind(description.mission.kind), description.robot.arm
    metrics, reason, broken = dict[str, float](), flight.reason, ""
    verdicts, waived, details, found = list[Verdict](), dict[str, str](), None, dict[str, Any]()
    try:
        if len(run.samples):
            metrics = compute_common_metrics(
                run.samples, run.phases, arm is not None and arm.sides == 2, flight.acted
            )
            with blame(type(kind), "metrics"):
                metrics.update({name: float(x) for name, x in kind.metrics(run).items()})
                details, described = kind.result(run), kind.describe(run)
            found = to_plain(described, f"describe of {type(kind).__qualname__}")
    except Exception as error:  # e.g. no approach to calibrate on after an abort
        broken = f"{BROKEN}{_describe(error)}"
    metrics["plan.wall_s"] = plan.plan_s
    metrics["plan.min_clearance_m"] = plan.min_clearance_m
    metrics["plan.min_rotor_margin"] = plan.min_rotor_margin
    try:
        verdicts, waived = judge_run(kind, run, metrics)
    except Exception as error:
        broken = broken or f"{BROKEN}{_describe(error)}"
    inspected: Inspected | None = None
    try:
        if len(run.samples):
            with blame(type(kind), "inspected"):
                seen = kind.inspected(run)
            if seen is not None:
                what = f"inspected of {type(kind).__qualname__}"
                inspected = read_inspected(to_plain(seen.to_json(), what))
    except Exception as error:
        broken = broken or f"{BROKEN}{_describe(error)}"
    reason = reason or broken
    if not outcome:
        met = not broken and all(v.passed for v in verdicts)
        outcome = "aborted" if not flight.completed else "succeeded" if met else "failed"
    reason = reason or describe_outcome(outcome, verdicts)
    return RunResult(
        description, plan, run.samples, run.phases, outcome, reason, metrics, verdicts, {}, details,
        directory, flight.acted, found, waived, inspected=inspected, checklist=flight.checklist,
    )  # fmt: skip
