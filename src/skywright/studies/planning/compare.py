"""The default planner against OMPL's and the paper's on the frozen scenarios, as benchmark rows."""

from __future__ import annotations

import importlib.util
import math
import statistics
from typing import Any

from skywright.studies.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.studies.planning.jobs import (
    DECOUPLED,
    EARLY_S,
    HIGH,
    OMPL,
    OURS,
    PAPER,
    SCENARIOS,
    SUCCESS,
    Effort,
    Job,
    list_jobs,
    run_jobs,
)

LATE_S = 5.0

Found = dict[Job, dict[str, Any]]


def measure_planners(session: Session) -> list[Row]:
    """Measure the scenarios of the session's effort."""
    everywhere = (*SCENARIOS, HIGH)
    effort = session.pick(
        Effort(("paper",), ("paper",), 1, 0.3, 0.3, 2, 0.4),
        Effort(("paper", "draw4", "draw7"), everywhere, 1, 2.0, 5.0, 5, 0.4),
        Effort((*SCENARIOS,), everywhere, 5, LATE_S, 30.0, 20, 1.0),
    )
    with_ompl = importlib.util.find_spec("ompl") is not None
    keep = None if session.resume is None else session.resume / f"planning-{session.effort}"
    found = run_jobs(list_jobs(effort, with_ompl), effort, session.workers, keep)
    rows = []
    for name in effort.scenarios:
        rows += build_rows(name, effort, found)
    return rows + build_decoupled_rows(effort, found)


def build_rows(name: str, effort: Effort, found: Found) -> list[Row]:
    """Rows of one scenario: our planner, the references, and the lower bound."""
    ours, quick = found[Job(name, OURS)], found[Job(name, SUCCESS)]
    early, late = statistics.median(ours["early"]), statistics.median(ours["late"])
    success = [math.isfinite(c) for c in quick["cost"]]
    first = [t for t in (*ours["first_s"], *quick["first_s"]) if math.isfinite(t)]
    rows = [
        build_row(f"{name}_success_1s", sum(success) / len(success), limit=0.95, sense=">=",
                  note=f"of {len(success)} seeds, a path within 1 s"),
    ]  # fmt: skip
    if not first or not math.isfinite(late):
        return [*rows, build_unmeasured_row(f"{name}_cost", "no path found", failed=True)]
    bound = ours["bound"][0]
    rows += [
        build_row(f"{name}_first_ms", [1e3 * t for t in first], "ms", limit=5.0),
        build_row(f"{name}_cost", late, "m", note=f"after {effort.late_s:g} s"),
        build_row(f"{name}_reserve_mm", 1e3 * min(ours["reserve"]), "mm", limit=0.0, sense=">=",
                  note="smallest clearance beyond the margins, at 1 mm resolution"),
        build_row(f"{name}_gap_to_lower_bound_percent", 100.0 * (late / bound - 1.0), "%",
                  limit=2.0 if name == "paper" else None, note=f"bound {bound:.4f}"),
        _compare(
            f"{name}_over_paper_rrt_star", late, found[Job(name, PAPER)]["cost"], 1.0,
            f"both after {effort.late_s:g} s, both with certified edges",
        ),
    ]  # fmt: skip
    if Job(name, OMPL[0]) not in found:
        why = "the package ompl is not installed (extra dev)"
        return [*rows, build_unmeasured_row(f"{name}_over_ompl", why)]
    for planner in OMPL[:2]:
        costs = found[Job(name, planner)]["cost"]
        note = f"ours after {EARLY_S:g} s, theirs after {effort.star_s:g} s"
        rows.append(_compare(f"{name}_over_ompl_{planner.lower()}", early, costs, 1.0, note))
    note = f"both after {effort.late_s:g} s; theirs restarted and simplified until then"
    costs, limit = found[Job(name, OMPL[2])]["cost"], 0.99 if name == "paper" else 1.0
    return [*rows, _compare(f"{name}_over_ompl_rrtconnect", late, costs, limit, note)]


def _compare(row: str, ours: float, theirs: list[float], limit: float, note: str) -> Row:
    """Row of our cost over the median of theirs; a reference without a path is told."""
    their = statistics.median(theirs)
    if not math.isfinite(their):
        return build_unmeasured_row(row, f"the reference found no path; ours {ours:.3f}; {note}")
    return build_row(row, ours / their, limit=limit, note=f"{ours:.3f} over {their:.3f}; {note}")


def build_decoupled_rows(effort: Effort, found: Found) -> list[Row]:
    """Joint against decoupled planning (platform first, arms after) with the same time."""
    rows, total = [], {"joint": 0, "cost": 0}
    for name in effort.decoupled:
        both = found[Job(name, DECOUPLED)]
        count = {key: sum(math.isfinite(c) for c in both[key]) for key in total}
        if name in SCENARIOS:
            total = {key: total[key] + count[key] for key in total}
        joint, apart = (
            statistics.median([c for c in both[key] if math.isfinite(c)] or [math.inf])
            for key in ("joint", "cost")
        )
        note = f"joint {joint:.3f} ({count['joint']} of {effort.seeds} seeds), decoupled "
        row = f"{name}_joint_over_decoupled"
        if math.isfinite(apart) and math.isfinite(joint):
            note += f"{apart:.3f} ({count['cost']} of {effort.seeds})"
            rows.append(build_row(row, joint / apart, note=note))
        else:
            note += f"{count['cost']} of {effort.seeds}: {both['reason']}"
            rows.append(build_unmeasured_row(row, note))
    tried = effort.seeds * sum(name in SCENARIOS for name in effort.decoupled)
    for key, name in (("joint", "joint"), ("cost", "decoupled")):
        note = f"of {tried} plans, all scenarios, {effort.decoupled_s:g} s each"
        rows.append(build_row(f"{name}_success", total[key] / tried, note=note))
    return rows
