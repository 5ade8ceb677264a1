"""Computing time of a step of each control law relative to the first one.

Each law hovers in its own vehicle, with the first of ROBOTS that it can fly; only its row of the
schedule is called, in compiled code.
`whole_body_qp` is also measured at a limit, where its solver runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from skywright.core.find import list_kinds
from skywright.errors import InputError
from skywright.evidence.bench.flights import load_scan
from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.evidence.bench.timing import compute_ratios, interleave, read_clock
from skywright.run.backends import build_vehicle
from skywright.vehicle.bus import Clock
from skywright.vehicle.schedule import repeat_row
from skywright.vehicle.stepped import LawStep

FIRST = "push_and_slide"
ROBOTS = ("othex", "othex-force", "f550-bridge-torque")
"""The robot of the scan, it with a sensor of the probe's force, and one whose arm takes torques."""
CALLS = 500
BOUND = "whole_body_qp"
DEEP = 0.5
"""m, offset of the reference that demands more than the rotors can produce."""


def measure(session: Session) -> list[Row]:
    """Measure every law."""
    return measure_laws(list_kinds("law"), session.pick(2, 15, 40))


def measure_laws(kinds: Sequence[str], rounds: int) -> list[Row]:
    """Return one row per law: its time relative to `push_and_slide`, measured in turns.

    A row names the robot where it is not that of `push_and_slide`. A law that can fly none of
    ROBOTS has a row with the reason.
    """
    laws, notes = dict[str, LawStep](), dict[str, str]()
    refused = []
    for kind in [FIRST, *(k for k in kinds if k != FIRST)]:
        try:
            laws[kind], robot = hover(kind)
        except InputError as error:
            refused.append(build_unmeasured_row(f"{kind}_over_{FIRST}", str(error)))
        else:
            notes[kind] = "a step" if robot == ROBOTS[0] else f"a step, with the robot {robot}"
    if BOUND in laws:
        at_limits, _ = hover(BOUND)
        at_limits.reference.p_WB = at_limits.reference.p_WB + [DEEP, 0.0, 0.0]
        at_limits.step()
        laws[f"{BOUND}.at_limits"], notes[f"{BOUND}.at_limits"] = at_limits, notes[BOUND]
    times = interleave({name: partial(time_step, law) for name, law in laws.items()}, rounds)
    first = times[FIRST]
    out = [
        build_row(f"{FIRST}_us", [1e6 * t / CALLS for t in first], "us", note="a step, hovering")
    ]
    out += [
        build_row(f"{name}_over_{FIRST}", compute_ratios(spent, first), note=notes[name])
        for name, spent in times.items()
        if name != FIRST
    ]
    return out + refused


def hover(kind: str) -> tuple[LawStep, str]:
    """Return a hovering law in the scan's vehicle, and the first of ROBOTS that it can fly.

    Raises InputError with the reason of the first robot if it can fly none.
    """
    refused: InputError | None = None
    for robot in ROBOTS:
        try:
            law = LawStep(build_vehicle(load_scan(f"mission.law={kind}", robot=robot)))
        except InputError as error:
            refused = refused or error
        else:
            law.step()
            return law, robot
    assert refused is not None
    raise refused


def time_step(law: LawStep) -> float:
    """Return the time (s) of CALLS steps on unchanged records."""
    a, row = law.assembly, law.rows[-1]
    clock = a.get(Clock)
    every = int(a.rows["every"][row])
    clock["tick"] += (int(a.rows["phase"][row]) - int(clock["tick"])) % every  # make the step due
    begin = read_clock()
    repeat_row(int(a.rows.ctypes.data), row, a.address(Clock), CALLS)
    return read_clock() - begin
