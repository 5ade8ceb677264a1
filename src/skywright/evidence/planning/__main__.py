"""The full comparison of planners, in parts: `python -m skywright.evidence.planning DIR`.

Jobs whose results DIR holds are not repeated; `--only` runs some kinds, `--only none` only prints
the existing results. Rows go to standard output, the plot of cost against time to `--figure`.
`skywright bench planning --full --resume DIR` uses the same parts.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from skywright.errors import InputError, SkywrightError
from skywright.evidence.planning.compare import FULL, KEPT, Found, build_kept_rows, has_ompl
from skywright.evidence.planning.figures import Progress, Scenario, draw_convergence
from skywright.evidence.planning.jobs import (
    CURVE_S,
    DECOUPLED,
    OMPL,
    OURS,
    PAPER,
    SUCCESS,
    Job,
    list_jobs,
    load_kept,
    run_jobs,
)
from skywright.reports.figures.style import house_style

KINDS = (OURS, SUCCESS, DECOUPLED, PAPER, *OMPL)
NAMES = {
    OURS: "default planner",
    PAPER: "RRT* of the paper",
    **dict(zip(OMPL, ("OMPL RRT*", "OMPL Informed RRT*", "OMPL RRT-Connect"), strict=True)),
}
PANELS = 4
"""Maximum number of scenarios in the figure; those with all planners come first."""


def draw_found(found: Found) -> Any:
    """Return the figure of the results, the paper's scenario first."""
    names = [job.scenario for job in found if job.what == OURS and "bound" in found[job]]
    full = [n for n in names if all(Job(n, what) in found for what in OMPL)]
    panels = []
    for name in (full or names)[:PANELS]:
        planners = []
        for what, label in NAMES.items():
            curves = found.get(Job(name, what), {}).get("curve", [])
            if curves:
                t = np.array(CURVE_S[: len(curves[0])])
                planners.append(Progress(label, t, np.array(curves)))
        panels.append(Scenario(name, planners, found[Job(name, OURS)]["bound"][0]))
    with house_style():
        return draw_convergence(panels)


def main() -> None:
    """Entry point of the module."""
    parser = argparse.ArgumentParser(prog="python -m skywright.evidence.planning")
    parser.add_argument("dir", type=Path, help="folder that keeps finished jobs")
    parser.add_argument("--only", nargs="+", choices=(*KINDS, "none"), default=list(KINDS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--figure", type=Path, help="picture of cost against time, .png or .svg")
    arguments = parser.parse_args()
    keep = arguments.dir / KEPT.format("full")
    try:
        jobs = list_jobs(FULL, has_ompl())
        wanted = [job for job in jobs if job.what in arguments.only]
        if arguments.figure is not None:
            kept = {job for job, _ in load_kept(jobs, FULL, keep)}
            if all(job.what != OURS for job in (*wanted, *kept)):
                raise InputError(
                    f"--figure: draws results of {OURS!r}, and {arguments.dir} holds none; add "
                    f"{OURS} to --only"
                )
        run_jobs(wanted, FULL, arguments.workers, keep)
        found = dict(load_kept(jobs, FULL, keep))
        for row in build_kept_rows(FULL, found):
            value = "-" if row.value is None else f"{row.value:.4g} {row.unit}".strip()
            print(f"{row.name:44} {value:12} {row.note}")
        if arguments.figure is not None and found:
            draw_found(found).savefig(arguments.figure, dpi=110, metadata={"Software": None})
    except (SkywrightError, OSError) as error:
        raise SystemExit(f"planning: {error}") from None


if __name__ == "__main__":
    main()
