"""Computing time of inspection instruments in the closed loop, relative to the plain scan."""

from functools import partial

from skywright.evidence.bench.flights import count_ticks, fly_into_contact, load_scan, run_ticks
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, interleave

CRACKS = ("world.things.crack.kind=crack", "world.things.crack.s_m=0.05")
WALL = ("world.things.steel.kind=wall", "world.things.steel.paint_m=0.0002")
EDDY = "robot.sensors.eddy.kind=eddy_array"
CASES: dict[str, tuple[str, ...]] = {
    "plain": (),
    "one_coil": (EDDY, *CRACKS),
    "array": (EDDY, "robot.sensors.eddy.coils=16", *CRACKS),
    "ascans": ("robot.sensors.ut.kind=ultrasonic", *WALL),
}
NOTES = {
    "one_coil": "an eddy-current coil, over a crack",
    "array": "an array of 16 coils, over a crack",
    "ascans": "20 A-scans a second, pressed on a painted wall",
}
LIMITS = {"one_coil": 1.1, "array": 2.0, "ascans": 2.0}
"""Target of the ratio; it is reported only, because timings are not tests."""


def measure(session: Session) -> list[Row]:
    """Fly all cases in contact, one second of each in turns."""
    vehicles = {name: fly_into_contact(load_scan(*sets)) for name, sets in CASES.items()}
    ticks = count_ticks(session.pick(0.2, 1.0, 1.0))
    calls = {name: partial(run_ticks, v, ticks) for name, v in vehicles.items()}
    times = interleave(calls, session.pick(2, 12, 80))
    return [
        build_row(
            f"{name}_over_plain", compute_ratios(times[name], times["plain"]),
            note=f"fast closed loop: {NOTES[name]}; wanted: up to {LIMITS[name]:g}",
        )
        for name in CASES
        if name != "plain"
    ]  # fmt: skip
