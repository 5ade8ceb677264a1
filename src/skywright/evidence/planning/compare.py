"""The default planner against OMPL's and the paper's on fixed scenarios, as benchmark rows."""

import importlib.util
import math
import statistics
from typing import Any

from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row
from skywright.evidence.planning.jobs import (
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

EVERYWHERE = (*SCENARIOS, HIGH)
QUICK = Effort(("paper",), ("paper",), 1, 0.3, 0.3, 2, 0.4)
DEFAULT = Effort(("paper", "draw4", "draw7"), EVERYWHERE, 1, 2.0, 5.0, 5, 0.4)
FULL = Effort((*SCENARIOS,), EVERYWHERE, 5, LATE_S, 30.0, 20, 1.0)

KEPT = "planning-{}"
"""Folder of the parts of an effort, below that of `--resume`."""

Found = dict[Job, dict[str, Any]]


def measure_planners(session: Session) -> list[Row]:
    """Measure the scenarios of the session's effort."""
    effort = session.pick(QUICK, DEFAULT, FULL)
    keep = None if session.resume is None else session.resume / KEPT.format(session.effort)
    found = run_jobs(list_jobs(effort, has_ompl()), effort, session.workers, keep)
    rows = []
    for name in effort.scenarios:
        rows += build_rows(name, effort, found)
    return rows + build_decoupled_rows(effort, found)


def build_kept_rows(effort: Effort, found: Found) -> list[Row]:
    """Return rows of the scenarios with finished jobs of the default planner, and of decoupled
    planning."""
    rows = []
    for name in effort.scenarios:
        if Job(name, OURS) in found and Job(name, SUCCESS) in found:
            rows += build_rows(name, effort, found)
    if all(Job(name, DECOUPLED) in found for name in effort.decoupled):
        rows += build_decoupled_rows(effort, found)
    return rows


def has_ompl() -> bool:
    """Whether the package ompl (extra dev) is installed."""
    return importlib.util.find_spec("ompl") is not None


def build_rows(name: str, effort: Effort, found: Found) -> list[Row]:
    """Return the rows of one scenario: default planner, references, lower bound."""
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
    ]  # fmt: skip
    if not any(Job(name, planner) in found for planner in OMPL):
        why = "not measured yet" if has_ompl() else "the package ompl is not installed (extra dev)"
        rows.append(build_unmeasured_row(f"{name}_over_ompl", why))
    both = f"both after {effort.late_s:g} s"
    quickly = f"ours after {EARLY_S:g} s, theirs after {effort.star_s:g} s"
    simplified = 0.99 if name == "paper" else 1.0
    for row, planner, own, limit, note in (
        ("paper_rrt_star", PAPER, late, 1.0, f"{both}, both with certified edges"),
        ("ompl_rrtstar", OMPL[0], early, 1.0, quickly),
        ("ompl_informedrrtstar", OMPL[1], early, 1.0, quickly),
        ("ompl_rrtconnect", OMPL[2], late, simplified,
         f"{both}; theirs restarted and simplified until then"),
    ):  # fmt: skip
        if Job(name, planner) in found:
            costs = found[Job(name, planner)]["cost"]
            rows.append(_compare(f"{name}_over_{row}", own, costs, limit, note))
    return rows


def _compare(row: str, ours: float, theirs: list[float], limit: float, note: str) -> Row:
    """Return the row of our cost over the median of theirs, or a note if the reference has no
    path."""
    their = statistics.median(theirs)
    if not math.isfinite(their):
        return build_unmeasured_row(row, f"the reference found no path; ours {ours:.3f}; {note}")
    return build_row(row, ours / their, limit=limit, note=f"{ours:.3f} over {their:.3f}; {note}")


def build_decoupled_rows(effort: Effort, found: Found) -> list[Row]:
    """Compare joint with decoupled planning (platform first, then arms) at equal time."""
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
