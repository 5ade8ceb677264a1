"""Growth of time and memory with the length of a scan: planning, recorded flight, evaluation."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.evidence.bench.flights import load_scan
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import read_clock
from skywright.run.planning import plan_mission
from skywright.run.run import run_mission

PASSES = (2, 4, 8, 16)


class Cost(NamedTuple):
    """Cost of one run; processor times (s)."""

    simulated_s: float
    plan_s: float
    run_s: float  # without planning
    recording_mb: float


def measure(session: Session) -> list[Row]:
    """Scan the same area with more passes; return exponents of cost over simulated time."""
    passes = session.pick(PASSES[:2], PASSES[:3], PASSES)
    rounds = session.pick(1, 2, 5)
    fly_passes(PASSES[0], session.scratch / "first")  # warms up
    costs = [
        {n: fly_passes(n, session.scratch / f"scan-{n}-{i}") for n in passes} for i in range(rounds)
    ]
    first, last = costs[0][passes[0]], costs[0][passes[-1]]
    span = f"{passes[0]} to {passes[-1]} passes, {first.simulated_s:.0f} to {last.simulated_s:.0f}"
    what = {
        "plan_s": "planning",
        "run_s": "flight, recording and evaluation",
        "recording_mb": "size of the recording",
    }
    rows = [
        build_row(
            f"{field.rsplit('_', 1)[0]}_exponent", [fit_exponent(c, field) for c in costs],
            note=f"{text} over simulated time, {span} s; 1 is linear",
        )
        for field, text in what.items()
    ]  # fmt: skip
    for n in passes:
        each = [1e3 * c[n].run_s / c[n].simulated_s for c in costs]
        note = f"flight, recording and evaluation, a simulated second of {n} passes"
        rows.append(build_row(f"passes_{n}_ms_per_s", each, "ms/s", note=note))
    return rows


def fly_passes(passes: int, out: Path) -> Cost:
    """Plan, then run a scan with `passes` passes."""
    description = load_scan(f"mission.task.passes={passes}")
    begin = read_clock()
    plan_mission(description)
    plan = read_clock() - begin
    begin = read_clock()
    result = run_mission(description, out=out)
    whole = read_clock() - begin
    size = (result.directory / "recording.mcap").stat().st_size / 1e6
    return Cost(result.timing["simulated_s"], plan, whole - plan, size)


def fit_exponent(costs: dict[int, Cost], field: str) -> float:
    """Return the slope of log cost over log simulated time."""
    x = np.log([c.simulated_s for c in costs.values()])
    y = np.log([getattr(c, field) for c in costs.values()])
    return float(np.polyfit(x, y, 1)[0])
