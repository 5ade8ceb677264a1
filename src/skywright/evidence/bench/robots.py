"""Growth of the computing time with the number of robots.

One model: copies of the robot in one MuJoCo world, stepped with the recorded inputs of one flight.
The vehicle layer flies one robot per world. Several robots fly as independent vehicles in one
process, which is measured for comparison with the closed loop.
"""

from functools import partial
from typing import NamedTuple

from skywright.core.arrays import Array
from skywright.description.loader import Description
from skywright.evidence.bench.flights import (
    count_ticks,
    fly_to_hover,
    load_scan,
    record_applied,
    run_ticks,
)
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, interleave, read_clock
from skywright.models.crowd import Crowd, build_crowd, repeat_controls, set_crowd, step_crowd
from skywright.models.deviation import build_deviation
from skywright.run.backends import build_vehicle
from skywright.vehicle.simulated import SimulatedVehicle

COUNTS = (1, 2, 4, 8)


class Stretch(NamedTuple):
    """A flight segment of one robot: initial state and inputs."""

    qpos: Array
    qvel: Array
    act: Array
    controls: Array
    forces: Array
    n_steps: int


def measure(session: Session) -> list[Row]:
    """Time 1, 2, 4 and 8 robots in turns: hovering, standing, and as vehicles."""
    counts = session.pick(COUNTS[:2], COUNTS, COUNTS)
    ticks = count_ticks(session.pick(0.1, 0.5, 0.5))
    rounds = session.pick(2, 10, 40)
    description = load_scan()
    standing = build_vehicle(description)
    run_ticks(standing, count_ticks(1.0))
    crowds = {n: build_plants(description, n) for n in counts}
    rows = []
    for name, vehicle, what in (
        ("air", fly_to_hover(description), "hovering"),
        ("feet", standing, "standing, 4 contacts each"),
    ):
        stretch = record_stretch(vehicle, ticks)
        calls = {str(n): partial(step_all, crowd, stretch) for n, crowd in crowds.items()}
        note = f"one MuJoCo model, mj_step alone, {what}"
        rows += _build_rows(name, interleave(calls, rounds), counts, note)
    fleet = [fly_to_hover(description) for _ in range(counts[-1])]
    calls = {str(n): partial(_run_vehicles, fleet[:n], ticks) for n in counts}
    note = "independent vehicles in one process, fast closed loop, hovering"
    return rows + _build_rows("vehicles", interleave(calls, rounds), counts, note)


def build_plants(description: Description, count: int) -> Crowd:
    """Compile several copies of a description's plant into its world."""
    d = description
    deviation = build_deviation(d.plant, d.robot, d.mission.seed)
    return build_crowd(d.robot, d.world, deviation, count)


def record_stretch(vehicle: SimulatedVehicle, ticks: int) -> Stretch:
    """Fly on and record what is needed to repeat the segment with more robots."""
    sim = vehicle.sim
    start = (sim.qpos.copy(), sim.qvel.copy(), sim.act.copy())
    applied = record_applied(vehicle, ticks)
    return Stretch(*start, applied.controls, applied.forces, vehicle.n_steps)


def step_all(crowd: Crowd, stretch: Stretch) -> float:
    """Step all robots of a crowd through a segment; return the processor time (s)."""
    set_crowd(crowd, stretch.qpos, stretch.qvel, stretch.act)
    controls, forces = repeat_controls(crowd, stretch.controls, stretch.forces)
    begin = read_clock()
    step_crowd(crowd, controls, forces, stretch.n_steps)
    return read_clock() - begin


def _run_vehicles(vehicles: list[SimulatedVehicle], ticks: int) -> float:
    """Tick the vehicles in turn, like robots that share a clock."""
    begin = read_clock()
    for _ in range(ticks):
        for vehicle in vehicles:
            vehicle.tick()
    return read_clock() - begin


def _build_rows(
    name: str, times: dict[str, list[float]], counts: tuple[int, ...], note: str
) -> list[Row]:
    """Return the time of `n` robots over `n` times that of one: 1 is linear growth."""
    return [
        build_row(
            f"{name}_{n}_over_{n}_times_1",
            [r / n for r in compute_ratios(times[str(n)], times[str(counts[0])])],
            note=f"{n} robots, each over one alone: {note}",
        )
        for n in counts[1:]
    ]  # fmt: skip
