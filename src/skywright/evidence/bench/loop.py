"""Computing time of the closed loop relative to bare `mj_step`.

A flight segment runs with sensors, estimation, control and recording in both modes. MuJoCo alone
replays it with the recorded inputs; without inputs the robot would fall, which is cheaper to
simulate. The scan is flown in contact, the F550 docked, and the two-arm robots in the air. In the
air MuJoCo has the least work, so the ratio is largest.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from skywright.evidence.bench.flights import (
    FULL_STRENGTH,
    count_ticks,
    fly_docked,
    fly_into_contact,
    fly_with_bar,
    fly_with_hands,
    load_scan,
    record_applied,
    run_ticks,
    step_bare,
)
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, interleave
from skywright.recordings.writer import RecordingWriter
from skywright.vehicle.simulated import SimulatedVehicle

LIMITS = {"fast": 1.5, "interactive": 2.2}


class Case(NamedTuple):
    """A flight to time."""

    fly: Callable[[], SimulatedVehicle]
    """Flies to the start of the segment."""
    note: str


CASES = {
    "": Case(
        lambda: fly_into_contact(load_scan()),
        "contact scan, sensors at 1 kHz, filter, recording",
    ),
    "full_strength_": Case(
        lambda: fly_into_contact(load_scan(*FULL_STRENGTH)),
        "with gusts, link, artefacts, varying friction",
    ),
    "docked_": Case(
        lambda: fly_docked(),
        "f550-bridge docked, pressing; total station, tracking camera, range finder",
    ),
    "docked_mocap_": Case(
        lambda: fly_docked("world.localisation=mocap"), "the same with motion capture"
    ),
    "two_arms_": Case(
        lambda: fly_with_hands("bimanual"), "bimanual, both hands keep their places in the air"
    ),
    "long_reach_": Case(
        lambda: fly_with_hands("bimanual-longreach"), "the same with bimanual-longreach"
    ),
    "transport_": Case(fly_with_bar, "ars-lrm carries a bar of 2 m between pipes"),
}


def measure(session: Session) -> list[Row]:
    """Measure both modes for all cases, and the effect of the physics step."""
    rounds = session.pick(2, 20, 100)
    rows = [
        row
        for name, case in CASES.items()
        for row in measure_case(name, case, session.scratch, rounds)
    ]
    return [*rows, measure_step(rounds)]


def measure_step(rounds: int) -> Row:
    """Measure the scan at a physics step of 2 ms relative to 1 ms, without recording."""
    coarse = fly_into_contact(load_scan("mission.timestep_ms=2"))
    fine, ticks = fly_into_contact(load_scan()), count_ticks(1.0)
    times = interleave(
        {"1": partial(_fly, fine, ticks, False), "2": partial(_fly, coarse, ticks, False)}, rounds
    )
    note = "contact scan, fast way: mission.timestep_ms = 2 over 1, the same simulated time"
    return build_row("step_2_ms_over_1_ms", compute_ratios(times["2"], times["1"]), note=note)


def measure_case(name: str, case: Case, folder: Path, rounds: int) -> list[Row]:
    """Measure one case; a round is 1 s of simulated time in each mode."""
    vehicle = case.fly()
    ticks = count_ticks(1.0)
    with RecordingWriter(folder / f"{name}loop.mcap", *vehicle.recorded) as writer:
        vehicle.on_samples, vehicle.on_stream = writer.append, writer.append_stream
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
            note=f"{way} way; {case.note}",
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
