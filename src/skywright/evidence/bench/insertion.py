"""A physics step of the bar's insertion over one of a scan, each over a whole flight.

Control and the mission's Python code are included, planning and recording are not.
"""

from __future__ import annotations

from skywright.description.loader import Description, load_description
from skywright.errors import SimulationError
from skywright.evidence.bench.flights import load_scan
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, read_clock
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor

MISSION = "bar-insertion"
LIMIT = 2.5
"""Of the ratio."""


def measure(session: Session) -> list[Row]:
    """Fly both missions in turns, the insertion with a seed of its own in each round."""
    time_step(load_scan())  # the first flight also loads the compiled code
    steps: dict[str, list[float]] = {"scan": [], "insertion": []}
    for seed in range(1, 1 + session.pick(1, 5, 10)):
        steps["insertion"].append(time_step(load_description(MISSION, seed=seed)))
        steps["scan"].append(time_step(load_scan()))
    seeds = f"seeds 1 to {len(steps['scan'])}"
    rows = [
        build_row(
            "insertion_over_scan_step", compute_ratios(steps["insertion"], steps["scan"]),
            limit=LIMIT, note=f"a physics step of {MISSION} ({seeds}) over one of a plain scan",
        )
    ]  # fmt: skip
    for name, spent in steps.items():
        note = "control and the mission's Python code included"
        rows.append(build_row(f"{name}_step_us", [1e6 * t for t in spent], "us", note=note))
    return rows


def time_step(description: Description) -> float:
    """Fly a mission; return the processor time per physics step (s).

    Raises SimulationError if the flight is not completed.
    """
    plan, vehicle = plan_mission(description), build_vehicle(description)
    height = vehicle.robot.platform.gear_height_m
    begin = read_clock()
    flight = Supervisor(vehicle, description.mission, plan, height, lambda *_: None).fly()
    spent = read_clock() - begin
    if not flight.completed:
        raise SimulationError(f"{description.mission.name}: {flight.reason}")
    return spent / round(vehicle.t / vehicle.scene.model.opt.timestep)
