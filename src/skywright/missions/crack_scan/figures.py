"""Figures of a report on a crack search: display map, area, contact."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure

from skywright.description.loader import Description
from skywright.description.world.surface import roll_points
from skywright.missions.crack_scan.cover import list_gaps
from skywright.missions.crack_scan.judge import list_flaws
from skywright.missions.crack_scan.plan import CrackWay
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.figures import FIGURES as SCAN
from skywright.missions.skills.datum import describe_datum, list_datum_marks
from skywright.missions.skills.told import name_flight, tell_block
from skywright.reports.figures.style import BLACK, LIMIT, new_map
from skywright.run.flight import Flown
from skywright.run.kind import Chart, Figures, Mark, Sketch
from skywright.run.result import RunResult
from skywright.run.setup import Setup

SWATH, MISSED = (86, 180, 233), (213, 94, 0)
NATURES = {"crack": (204, 121, 167), "weld": (120, 120, 120), "ambiguous": (230, 159, 0)}
"""Colours that colour-blind readers can distinguish (Okabe and Ito's palette)."""


def draw_map(result: RunResult[CrackScan, CrackWay]) -> Figure | None:
    """Draw the display's height over the unrolled surface, indications, and the true cracks."""
    found = result.details
    if found is None or not np.isfinite(found.height).any():
        return None
    seen, cells = np.isfinite(found.height), found.cover.sector.cells
    s, c, up = found.s[seen], found.c[seen], found.height[seen]
    figure, ax = new_map(cells[:, 0], cells[:, 1], 0.2, below=0.85, right=0.65)
    order = np.argsort(np.abs(up))
    shown = ax.scatter(1e3 * s[order], 1e3 * c[order], c=up[order], s=3, cmap="RdBu_r", vmin=-60,
                       vmax=60, lw=0, rasterized=True)  # fmt: skip
    gaps = cells[~found.cover.covered]
    ax.plot(1e3 * gaps[:, 0], 1e3 * gaps[:, 1], "s", color="#c9ced6", ms=1.5, label="not covered")
    for x in found.indications:
        ax.plot(1e3 * x.s, 1e3 * x.c, "o", mfc="none", color=LIMIT, ms=11)
        ax.annotate(x.nature, (1e3 * x.s, 1e3 * x.c), xytext=(7, 5), textcoords="offset points",
                    fontsize=8, color=LIMIT)  # fmt: skip
    run = Flown(Setup(result.description), result.plan, result.samples, result.phases)
    for f in list_flaws(run)[0]:
        turn, half = np.radians(f.crack.angle_deg), 0.5e3 * f.crack.length_m
        ds, dc = half * np.sin(turn), half * np.cos(turn)
        ax.plot([1e3 * f.s - ds, 1e3 * f.s + ds], [1e3 * f.c - dc, 1e3 * f.c + dc], color=BLACK)
    ax.plot([], [], color=BLACK, label="true crack")
    ax.plot([], [], "o", mfc="none", color=LIMIT, label="indication")
    ax.set_aspect("equal")
    ax.set(xlabel="s, along the pipe's axis (mm)", ylabel="c, around the pipe (mm)")
    ax.grid(False)
    figure.colorbar(shown, ax=ax, label="% of full screen")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=4.1, ncols=3, fontsize=8,
              frameon=False)  # fmt: skip
    return figure


def describe(result: RunResult[CrackScan, CrackWay]) -> str:
    """Return a sentence on coverage and reported cracks."""
    m = result.metrics
    if "crack.expected" not in m:
        return f"{name_flight(result)} searched nothing"
    return (
        f"{name_flight(result)} covered {m['coverage.area_fraction']:.0%} of the sector and "
        f"reported {m['crack.expected'] - m['crack.missed']:.0f} of {m['crack.expected']:.0f} "
        "cracks"
    )


def list_notes(result: RunResult[CrackScan, CrackWay]) -> list[str]:
    """Return notes on procedure, block, and each indication."""
    p, found = result.description.mission.task.procedure, result.details
    out = [
        f"Procedure: {p.name}, revision {p.revision}. The display was set up on a notch of "
        f"{1e3 * p.notch_m:g} mm at 80 % of full screen; what exceeds {p.threshold_percent:g} % is "
        f"an indication; readings count up to a gap of {1e3 * p.gap_max_m:g} mm. The readings are "
        "simulated."
    ]
    if found is None:
        return [*out, "The run did not reach the scan."]
    out += describe_datum(result.metrics, "The place of an indication")
    out.append(tell_block(found.check.reasons))
    return out + [
        f"Indication at s = {1e3 * x.s:.1f} mm, c = {1e3 * x.c:.1f} mm (u95 {1e3 * x.u95:.1f} mm): "
        f"{x.nature}, {x.height:.0f} %, {1e3 * x.length:.0f} mm long."
        for x in found.indications
    ]


def sketch(description: Description[CrackScan], way: CrackWay | None) -> Sketch:
    """Return the passes, as in a scan."""
    if way is None:
        return Sketch()
    shown: Any = SCAN.sketch(cast(Any, description), way.scan)
    return cast(Sketch, shown)


def list_marks(result: RunResult[CrackScan, CrackWay]) -> list[Mark]:
    """Return the edges of the swath, the missed parts, and the indications."""
    found = result.details
    if found is None:
        return []
    radius = found.known.radius
    marks, t = list_datum_marks(result), found.t
    jumps = np.flatnonzero(np.diff(t) > 0.5) + 1  # between two scans
    for part in np.split(np.arange(len(t)), jumps):
        kept = part[::25]
        for k in sorted({0, found.s.shape[1] - 1}):
            line = np.column_stack([found.s[kept, k], found.c[kept, k] / radius])
            marks.append(Mark("edge of the swath", SWATH, on_pipe=line, size_m=0.0012,
                              since_s=float(t[part[-1]])))  # fmt: skip
    end = float(t[-1])
    for gap in list_gaps(found.cover):
        (s0, c0), (s1, c1) = gap.start, gap.end
        box = np.array([[s0, c0], [s1, c0], [s1, c1], [s0, c1], [s0, c0]]) / [1.0, radius]
        marks.append(Mark("missed", MISSED, on_pipe=box, size_m=0.0015, since_s=end))
    for x in found.indications:
        p, n = roll_points(found.known, x.s, x.c)
        marks.append(Mark(f"indication: {x.nature}", NATURES[x.nature], p[0] + 0.003 * n[0],
                          since_s=x.t))  # fmt: skip
    return marks


FIGURES = Figures(
    describe,
    notes=list_notes,
    phases=SCAN.phases,
    judged=SCAN.judged,
    title="Search for cracks",
    charts={
        "crack-map": Chart(
            "Map of the display",
            "Vertical part of the display over the unrolled surface, in % of full screen. Red: "
            "upwards, as the notch. Circles are indications; black lines are the true cracks, "
            "which only a simulation knows. Grey: not covered.",
            draw_map,
        ),
    },
    sketch=sketch,
    marks=list_marks,
)
