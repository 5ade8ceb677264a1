"""Write the tables of planners in docs/papers/caballero-2018.md, and its plot, from kept parts.

    python -m skywright.evidence.planning DIR     (measures; goes on where it stopped)
    python docs/generate_planners.py DIR

A part that DIR lacks, or that another version of a planner has made, shows as a dash.
"""

from __future__ import annotations

import argparse
import math
import re
import statistics
import sys
from pathlib import Path

from skywright.errors import SkywrightError
from skywright.evidence.planning.__main__ import NAMES, draw_found
from skywright.evidence.planning.compare import FULL, KEPT, Found
from skywright.evidence.planning.jobs import (
    DECOUPLED,
    EARLY_S,
    HIGH,
    OMPL,
    OURS,
    PAPER,
    SUCCESS,
    Effort,
    Job,
    list_jobs,
    load_kept,
)

DOCS = Path(__file__).parent
PAGE = DOCS / "papers" / "caballero-2018.md"
PLOT = DOCS / "images" / "planner-convergence.png"
BEGIN = "<!-- planners: begin, made by docs/generate_planners.py, do not edit -->"
END = "<!-- planners: end -->"
NONE = "–"


def _median(values: list[float]) -> float:
    """Median over the seeds; inf where half of them found nothing, nan without any."""
    return statistics.median(values) if values else math.nan


def _write(value: float, pattern: str) -> str:
    return NONE if math.isnan(value) else "none" if math.isinf(value) else pattern.format(value)


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    lines = [f"| {' | '.join(row)} |" for row in (head, *rows)]
    return [lines[0], "|---" * len(head) + "|", *lines[1:], ""]


def build_own_table(found: Found, effort: Effort) -> list[str]:
    """The default planner on every scenario."""
    head = [
        "scenario", "first path", f"cost after {EARLY_S:g} s", f"after {effort.late_s:g} s",
        "above the lower bound", "closest beyond the margin", "path within 1 s",
    ]  # fmt: skip
    rows = []
    for name in effort.scenarios:
        ours, quick = found.get(Job(name, OURS), {}), found.get(Job(name, SUCCESS), {})
        first = [1e3 * t for t in (*ours.get("first_s", []), *quick.get("first_s", []))]
        early, late = _median(ours.get("early", [])), _median(ours.get("late", []))
        bound, reserve = ours.get("bound", [math.nan])[0], min(ours.get("reserve", [math.nan]))
        costs = quick.get("cost", [])
        rows.append([
            name, _write(_median([t for t in first if not math.isnan(t)]), "{:.1f} ms"),
            _write(early, "{:.3f} m"), _write(late, "{:.3f} m"),
            _write(100.0 * (late / bound - 1.0), "{:.2f} %"), _write(1e3 * reserve, "{:.1g} mm"),
            f"{sum(map(math.isfinite, costs))} of {len(costs)}" if costs else NONE,
        ])  # fmt: skip
    return _table(head, rows)


def build_reference_table(found: Found, effort: Effort) -> list[str]:
    """The references where one was measured, and how much cheaper the default planner is."""
    columns = [
        (OMPL[0], "early", effort.star_s), (OMPL[1], "early", effort.star_s),
        (OMPL[2], "late", effort.late_s), (PAPER, "late", effort.late_s),
    ]  # fmt: skip
    head = ["scenario", *(f"{NAMES[what]}, {after:g} s" for what, _, after in columns)]
    head[3] = head[3].replace(NAMES[OMPL[2]], f"{NAMES[OMPL[2]]}, simplified and restarted")
    rows = []
    for name in effort.scenarios:
        if not any(Job(name, what) in found for what, _, _ in columns):
            continue
        row = [name]
        for what, which, _ in columns:
            their = _median(found.get(Job(name, what), {}).get("cost", []))
            own = _median(found.get(Job(name, OURS), {}).get(which, []))
            text = _write(their, "{:.3f} m")
            if math.isfinite(their) and math.isfinite(own):
                text += f" ({100.0 * (1.0 - own / their):+.1f} %)"
            row.append(text)
        rows.append(row)
    if not rows:
        return ["None is measured yet with these planners.", ""]
    return _table([h.replace("*", "\\*") for h in head], rows)


def build_decoupled_table(found: Found, effort: Effort) -> list[str]:
    """Joint planning against platform first, arms after."""
    rows = []
    for name in effort.decoupled:
        both = found.get(Job(name, DECOUPLED), {})
        row = ["paper, ceiling at 6 m" if name == HIGH else name]
        for key in ("joint", "cost"):
            costs = both.get(key, [])
            free = [c for c in costs if math.isfinite(c)]
            row.append(f"{len(free)} of {len(costs)}" if costs else NONE)
            row.append(_write(_median(free), "{:.3f} m"))
        rows.append(row)
    head = ["scenario", "joint: plans", "cost", "decoupled: plans", "cost"]
    return _table(head, rows)


def build_section(found: Found, effort: Effort = FULL) -> str:
    """Return what stands between the markers."""
    early, late, star = (f"{s:g} s" for s in (EARLY_S, effort.late_s, effort.star_s))
    lines = [
        "Made by `python docs/generate_planners.py DIR`. All times are processor time; costs are "
        f"medians of {effort.seeds} seeds, the first path of these and {effort.success_seeds} "
        "more. *Closest beyond the margin* is the least clearance of any seed's path less 0.2 m, "
        "looked at each millimetre.", "",
        *build_own_table(found, effort),
        f"References. In brackets: by how much the default planner is cheaper, after {early} than "
        f"OMPL's RRT\\* and Informed RRT\\* after {star}, after {late} than the others as late.",
        "", *build_reference_table(found, effort),
        f"Joint planning against decoupled planning (platform first, arms after), "
        f"{effort.decoupled_s:g} s each; costs are of the plans that were found.", "",
        *build_decoupled_table(found, effort),
    ]  # fmt: skip
    return "\n".join(lines).rstrip()


def build_page(text: str, found: Found, effort: Effort = FULL) -> str:
    """Return the page with its tables made anew; raises ValueError without one pair of markers."""
    section = build_section(found, effort)
    new, count = re.subn(
        re.escape(BEGIN) + ".*?" + re.escape(END),
        lambda _: f"{BEGIN}\n\n{section}\n\n{END}", text, flags=re.S,
    )  # fmt: skip
    if count != 1:
        raise ValueError(f"needs one pair of markers {BEGIN} ... {END}")
    return new


def main() -> int:
    """Fill the section and draw the plot."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("dir", type=Path, help="folder of python -m skywright.evidence.planning")
    parser.add_argument("--page", type=Path, default=PAGE)
    parser.add_argument("--figure", type=Path, default=PLOT)
    arguments = parser.parse_args()
    try:
        found = dict(load_kept(list_jobs(FULL, True), FULL, arguments.dir / KEPT.format("full")))
        if not any(Job(name, OURS) in found for name in FULL.scenarios):
            print(
                f"{arguments.dir}: holds no part of the default planner that is still true; run "
                f"python -m skywright.evidence.planning {arguments.dir}",
                file=sys.stderr,
            )
            return 2
        text = arguments.page.read_text(encoding="utf-8")
        arguments.page.write_text(build_page(text, found), encoding="utf-8")
        draw_found(found).savefig(arguments.figure, dpi=110, metadata={"Software": None})
    except (SkywrightError, OSError, ValueError) as error:
        print(f"{arguments.page}: {error}", file=sys.stderr)
        return 2
    left = [f"{job.scenario} {job.what}" for job in list_jobs(FULL, True) if job not in found]
    missing = f", without {', '.join(left)}" if left else ""
    print(f"{arguments.page}: {len(found)} parts{missing}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
