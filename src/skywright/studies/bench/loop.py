"""The closed loop over bare `mj_step`.

The same stretch of a scan in contact is flown with sensors, estimation, control and recording in
both ways of running, and stepped by MuJoCo alone with what the flight applied (left alone the
robot would fall off the pipe, which is cheaper to simulate).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from skywright.core.recording import RecordingWriter
from skywright.models.rigid_body import joint_names
from skywright.studies.bench.flights import (
    FULL_STRENGTH,
    count_ticks,
    fly_into_contact,
    load_scan,
    record_applied,
    run_ticks,
    step_bare,
)
from skywright.studies.bench.rows import Row, Session, build_row
from skywright.studies.bench.timing import compute_ratios, interleave
from skywright.vehicle.simulated import SimulatedVehicle

LIMITS = {"fast": 1.5, "interactive": 2.2}
CASES = {"": (), "full_strength_": FULL_STRENGTH}
NOTES = {
    "": "contact scan, sensors at 1 kHz, filter, recording",
    "full_strength_": "with gusts, link, artefacts, varying friction",
}


def measure(session: Session) -> list[Row]:
    """Measure both ways of running, of the plain scan and with every disturbance on."""
    return [
        row
        for name, sets in CASES.items()
        for row in measure_case(name, sets, session.scratch, session.pick(2, 20, 100))
    ]


def measure_case(name: str, sets: tuple[str, ...], folder: Path, rounds: int) -> list[Row]:
    """Measure one case; a round is 1 s of simulated time of each way."""
    description = load_scan(*sets)
    vehicle = fly_into_contact(description)
    ticks = count_ticks(1.0)
    robot = description.robot
    with RecordingWriter(
        folder / f"{name}loop.mcap", joint_names(robot), len(robot.rotors.azimuth_deg)
    ) as writer:
        vehicle.on_samples = writer.append
        times = interleave(
            {
                "bare": lambda: step_bare(vehicle, record_applied(vehicle, ticks)),
                "fast": partial(_fly, vehicle, ticks, False),
                "interactive": partial(_fly, vehicle, ticks, True),
            },
            rounds,
        )
    steps = ticks * vehicle.n_ticks * vehicle.n_steps
    rows = [
        build_row(
            f"{name}{way}_over_bare", compute_ratios(times[way], times["bare"]), limit=limit,
            note=f"{way} way; {NOTES[name]}",
        )
        for way, limit in LIMITS.items()
    ]  # fmt: skip
    for way, seconds in times.items():
        note = "mj_step with what the flight applied" if way == "bare" else f"{way} way"
        per_step = [1e6 * t / steps for t in seconds]
        rows.append(build_row(f"{name}{way}_step_us", per_step, "us", note=f"{note}, a 1 ms step"))
    return rows


def _fly(vehicle: SimulatedVehicle, ticks: int, interactive: bool) -> float:
    vehicle.interactive = interactive
    try:
        return run_ticks(vehicle, ticks)
    finally:
        vehicle.interactive = False
