"""Output of a comparison of laws: a self-contained HTML page, and a table on the terminal."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from skywright.analysis.compare_laws.cases import tell_left_out
from skywright.analysis.compare_laws.compare import Flown, LawComparison
from skywright.analysis.compare_laws.figures import draw_medians
from skywright.analysis.compare_laws.paired import FEWEST, Difference
from skywright.reports.figures.style import house_style
from skywright.reports.page import build_picture, render_page, write_page
from skywright.reports.terminal import new_console, new_table
from skywright.run.rows import CONFIDENCE
from skywright.run.versions import collect_versions


def tell_step(text: str) -> None:
    """Print the current flight to stderr."""
    print(f"  {text}", file=sys.stderr, flush=True)


def write_laws_page(c: LawComparison, path: Path) -> None:
    """Write the self-contained page."""
    with house_style():
        picture = build_picture(
            "Metrics over the cases", draw_medians(c),
            "Each dot is one flight, the bar is the median of its law. Hollow dots are flights "
            "that did not reach their end; the median includes them. Dashed: the mission's limit. "
            "Refused laws, and flights in which the metric was not measured, have no dot.",
        )  # fmt: skip
    write_page(path, render_page(
        "compare_laws.html.j2", c=c, picture=picture, same=c.list_constant(),
        left_out=tell_left_out(c.left_out), number=format_number, fewest=FEWEST,
        tell=tell_difference, state=tell_state, reference=tell_reference(c),
        confidence=f"{CONFIDENCE:.0%}", versions=collect_versions(),
    ))  # fmt: skip


def print_laws(c: LawComparison, page: Path) -> None:
    """Print the number of successful runs and the significant differences."""
    console = new_console()
    table = new_table(
        f"{c.mission}, robot {c.robot}, seed {c.seed}: runs that met every requirement",
        "law", *(case.name for case in c.cases), "a step", right=("a step",),
    )  # fmt: skip
    for law in c.laws:
        cost = 1e6 * c.cost_s[law]
        table.add_row(
            law, *(tell_state(c.find(law, case.name)) for case in c.cases),
            f"{cost:.2f} us" if math.isfinite(cost) else "–",
        )  # fmt: skip
    console.print(table)
    found = [d for d in c.differences if (d.law, d.case, d.metric) in c.significant]
    table = new_table(
        f"Differences to {c.reference} beyond chance ({len(found)} of {len(c.differences)})",
        "law", "case", "metric", c.reference, "difference", f"{CONFIDENCE:.0%} interval",
        right=(c.reference, "difference"),
    )  # fmt: skip
    for d in found:
        table.add_row(
            d.law, d.case, d.metric, format_number(d.reference), f"{d.median:+.4g}",
            f"{d.low:+.3g} to {d.high:+.3g}",
        )  # fmt: skip
    if found:
        console.print(table)
    elif c.differences and c.runs >= FEWEST:
        console.print(f"No difference to {c.reference} is beyond chance (of {len(c.differences)}).")
    if note := tell_reference(c):
        console.print(note)
    for f in c.flown:
        if f.refused or f.reason:
            console.print(f"{f.law}, {f.case}: {f.refused or f.reason}")
    if c.runs < FEWEST:
        console.print(
            f"--runs {c.runs}: differences are tested from {FEWEST} runs on; the page lists the "
            "medians"
        )
    console.print(f"page: {page}")


def tell_reference(c: LawComparison) -> str:
    """Return why the reference is not the first law, or that there are no pairs; else ""."""
    if not c.differences:
        return "No run was flown to its end by two laws, so there are no differences."
    if c.reference == c.laws[0]:
        return ""
    return (
        f"The differences are to {c.reference}: no nominal flight of {c.laws[0]} met every "
        "requirement."
    )


def tell_state(f: Flown) -> str:
    """Return the number of successful runs, or that the law was refused."""
    return "refused" if f.refused else f"{f.succeeded} of {len(f.rows)}"


def tell_difference(d: Difference | None) -> str:
    """Format the difference with its interval."""
    if d is None:
        return "–"
    if not math.isfinite(d.low) or d.low == d.high:
        return f"{d.median:+.3g}"
    return f"{d.median:+.3g} ({d.low:+.2g} to {d.high:+.2g})"


def format_number(x: float) -> str:
    """Format with four digits; a dash for a missing value."""
    return f"{x:.4g}" if math.isfinite(x) else "–"
