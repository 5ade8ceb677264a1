"""What a step of each control law costs beside that of the first one, and a program at its limits.

Each law stands in a vehicle of its own that hovers; its row of the schedule alone is called, in
compiled code. `whole_body_qp` is measured twice more: where a limit binds and the solver runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from skywright.core.find import list_kinds
from skywright.errors import InputError
from skywright.evidence.bench.flights import load_scan
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import compute_ratios, interleave, read_clock
from skywright.run.backends import build_vehicle
from skywright.vehicle.bus import Clock
from skywright.vehicle.schedule import repeat_row
from skywright.vehicle.stepped import LawStep

FIRST = "push_and_slide"
CALLS = 500
BOUND = "whole_body_qp"
DEEP = 0.5
"""m, of a reference beside the robot: more than its rotors can push."""


def measure(session: Session) -> list[Row]:
    """Measure the laws that fly the scan's robot."""
    return measure_laws(list_kinds("law"), session.pick(2, 15, 40))


def measure_laws(kinds: Sequence[str], rounds: int) -> list[Row]:
    """Return a row a law, its time over that of `push_and_slide`, measured by turns."""
    laws: dict[str, LawStep] = {}
    for kind in [FIRST, *(k for k in kinds if k != FIRST)]:
        try:
            laws[kind] = hover(kind)
        except InputError:
            continue  # the robot is none for it
    if BOUND in laws:
        at_limits = hover(BOUND)
        at_limits.reference.p_WB = at_limits.reference.p_WB + [DEEP, 0.0, 0.0]
        at_limits.step()
        laws[f"{BOUND}.at_limits"] = at_limits
    times = interleave({name: partial(time_step, law) for name, law in laws.items()}, rounds)
    first = times[FIRST]
    out = [
        build_row(f"{FIRST}_us", [1e6 * t / CALLS for t in first], "us", note="a step, hovering")
    ]
    return out + [
        build_row(f"{name}_over_{FIRST}", compute_ratios(spent, first), note="a step")
        for name, spent in times.items()
        if name != FIRST
    ]


def hover(kind: str) -> LawStep:
    """Build the scan's vehicle with a law that hovers; raises InputError where it cannot fly it."""
    law = LawStep(build_vehicle(load_scan(f"mission.law={kind}")))
    law.step()
    return law


def time_step(law: LawStep) -> float:
    """Return the seconds of CALLS steps on the records as they are."""
    a, row = law.assembly, law.rows[-1]
    clock = a.get(Clock)
    every = int(a.rows["every"][row])
    clock["tick"] += (int(a.rows["phase"][row]) - int(clock["tick"])) % every  # it is due
    begin = read_clock()
    repeat_row(int(a.rows.ctypes.data), row, a.address(Clock), CALLS)
    return read_clock() - begin
