"""Flight segments for the benchmarks: in contact, hovering, and replayed with physics alone."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.loader import Description, load_description
from skywright.description.map_error import KEYS
from skywright.description.robot.limbs import SIDES
from skywright.errors import InfeasibleError, SimulationError
from skywright.evidence.bench.timing import read_clock
from skywright.models.rigid_body import posture
from skywright.run.backends import build_vehicle
from skywright.run.flight import PhaseRecord
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import Hands
from skywright.vehicle.arms_interface import Arms
from skywright.vehicle.interface import WholeBody
from skywright.vehicle.moves import Moves
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.simulation import Snapshot

SCAN = "pipe-weld-scan"

FULL_STRENGTH = (
    "world.wind.kind=dryden", "world.wind.mean_mps=2", "world.mocap.outlier_fraction=0.01",
    "world.link.delay_s=0.004", "world.link.jitter_s=0.001", "world.link.loss_fraction=0.01",
    "world.pipe.friction_variation=0.3",
)  # fmt: skip
"""Settings of a scan with gusts, a link, artefacts of motion capture and varying friction."""


class Applied(NamedTuple):
    """Inputs of the plant during a flight, one row per control tick."""

    controls: Array
    forces: Array
    frictions: Array
    start: Snapshot
    end: Snapshot


def count_ticks(seconds: float) -> int:
    """Return the number of mission ticks in `seconds` of simulated time."""
    return max(round(seconds / MISSION_TICK), 1)


def load_scan(*sets: str, robot: str | None = None) -> Description:
    """Load the scan with changes; the pipe is at its map position, so no survey is needed."""
    exact = [f"plant.{key}=0" for key in KEYS]
    return load_description(SCAN, robot, sets=[*exact, *sets])


def fly_into_contact(description: Description) -> SimulatedVehicle:
    """Fly a scan until the probe slides on the pipe. After the scan the robot keeps pressing.

    Raises InfeasibleError if the scan has no plan, SimulationError if there is no contact.
    """
    plan = plan_mission(description)
    if not plan.feasible:
        raise InfeasibleError(f"no plan: {plan.blocked_by}", str(plan.blocked_by))
    vehicle = fly_to_hover(description)
    body = WholeBody(vehicle)
    for name in ("approach", "unfold", "close_in", "touch", "scan"):
        body.track(plan.segments[name])
        while name != "scan" and not vehicle.tick().arrived:
            pass
    run_ticks(vehicle, count_ticks(2.0))
    if not vehicle.in_contact():
        raise SimulationError("the probe does not touch the pipe where the scan begins")
    return vehicle


def fly_to_hover(description: Description) -> SimulatedVehicle:
    """Take off and hover."""
    vehicle = build_vehicle(description)
    run_ticks(vehicle, count_ticks(1.0))
    uav = Moves(vehicle)
    uav.motors(True)
    uav.take_off(description.mission.hover_height_m)
    while not vehicle.tick().arrived:
        pass
    return vehicle


def fly_with_hands(robot: str) -> SimulatedVehicle:
    """Hover with the arms in working posture, with both hands holding their positions."""
    vehicle = fly_to_hover(load_description("waypoints", robot=robot))
    arms = Arms(vehicle)
    arms.move_to(posture(vehicle.robot, "working"))
    while not vehicle.tick().arrived:
        pass
    arms.hands_to({side: vehicle.read(Hands).p_WH[h].copy() for h, side in enumerate(SIDES)})
    run_ticks(vehicle, count_ticks(2.0))
    return vehicle


def fly_with_bar() -> SimulatedVehicle:
    """Carry the bar of the transport mission for some seconds of its path."""
    description = load_description("bar-transport", sets={"mission.task.planner_slices": 50})
    plan, vehicle = plan_mission(description), build_vehicle(description)
    run_ticks(vehicle, count_ticks(1.0))
    Moves(vehicle).motors(True)
    vehicle.release()
    run_ticks(vehicle, count_ticks(3.0))
    WholeBody(vehicle).track(plan.segments["transport"])
    run_ticks(vehicle, count_ticks(3.0))
    return vehicle


class _Docked(Exception):
    """The flight has reached the start of the segment."""


def fly_docked(*sets: str) -> SimulatedVehicle:
    """Fly the inspection of a bridge with an exact map until the docked robot holds its first
    force.

    Raises InfeasibleError if it has no plan, SimulationError if the robot does not dock.
    """
    known = ("plant.map_error_m=0", "plant.map_error_deg=0")
    description = load_description("bridge-contact", sets=(*known, *sets))
    plan = plan_mission(description)
    if not plan.feasible:
        raise InfeasibleError(f"no plan: {plan.blocked_by}", str(plan.blocked_by))
    vehicle = build_vehicle(description)

    def stop(before: Sequence[PhaseRecord], name: str) -> None:
        if name.startswith("hold"):
            raise _Docked

    height = vehicle.robot.platform.gear_height_m
    try:
        flight = Supervisor(vehicle, description.mission, plan, height, stop).fly()
    except _Docked:
        return vehicle
    raise SimulationError(f"the robot did not dock: {flight.reason}")


def run_ticks(vehicle: SimulatedVehicle, ticks: int) -> float:
    """Run mission ticks; return the processor time (s)."""
    start = read_clock()
    for _ in range(ticks):
        vehicle.tick()
    vehicle.flush()
    return read_clock() - start


def record_applied(vehicle: SimulatedVehicle, ticks: int) -> Applied:
    """Fly one control tick at a time and record the inputs of the plant."""
    rows: list[tuple[Array, ...]] = []
    sim, keep = vehicle.sim, (vehicle.interactive, vehicle.n_ticks)
    start = Snapshot(sim)
    vehicle.interactive, vehicle.n_ticks = True, 1
    for _ in range(ticks * keep[1]):
        vehicle.tick()
        rows.append((sim.ctrl.copy(), sim.xfrc.copy(), sim.pair_friction.copy()))
    vehicle.interactive, vehicle.n_ticks = keep
    vehicle.flush()  # otherwise the next timed segment would write these samples
    controls, forces, frictions = (np.array(column) for column in zip(*rows, strict=True))
    return Applied(controls, forces, frictions, start, Snapshot(sim))


def step_bare(vehicle: SimulatedVehicle, applied: Applied) -> float:
    """Replay the segment with `mj_step` alone, called from Python; return the processor time (s).

    The robot ends in the state after the recorded flight; a test checks that it is bit-identical.
    """
    sim, n = vehicle.sim, vehicle.n_steps
    applied.start.restore(sim)
    vary = bool(np.ptp(applied.frictions, axis=0).any())
    begin = read_clock()
    for control, force, friction in zip(
        applied.controls, applied.forces, applied.frictions, strict=True
    ):
        sim.ctrl[:] = control
        sim.xfrc[:] = force
        if vary:
            sim.pair_friction[:] = friction
        sim.step(n)
    spent = read_clock() - begin
    applied.end.restore(sim)
    return spent
