"""Presentation of claims: on the terminal, on a page, in the docs."""

import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn
from rich.table import Table
from rich.text import Text

from skywright.evidence.reproduce.figures import draw_claim
from skywright.evidence.reproduce.runner import ClaimResult, CriterionResult, Report, Steps
from skywright.reports.figures.style import house_style
from skywright.reports.page import build_picture, render_page, write_page
from skywright.reports.terminal import new_console
from skywright.run.versions import collect_versions

STYLES = {"reproduced": "green", "contradicted": "red", "not_comparable": "yellow"}
SIGNS = {"<=": "≤", ">=": "≥", "==": "="}


def write_number(value: float | None, unit: str = "") -> str:
    """Format a number with three significant digits and its unit; a missing one is a dash."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    digits = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{digits} {unit}".strip()


def write_limit(result: CriterionResult) -> str:
    """Format the limit of a value."""
    test = result.test
    if test.limit is None:
        return "not judged"
    around = f" ± {test.tolerance:g}" if test.tolerance else ""
    return f"{SIGNS.get(test.sense, test.sense)} {test.limit:g}{around} {test.unit}".strip()


def write_paper_value(result: CriterionResult) -> str:
    """Format the paper's value."""
    test = result.test
    return "no figure" if test.paper_value is None else f"{test.paper_value:g} {test.unit}".strip()


def write_verdict(claim: ClaimResult) -> str:
    """Format the verdict with its flags, as in "not comparable (fitted)"."""
    words = claim.verdict.replace("_", " ")
    flags = ", ".join(name.replace("_", " ") for name in claim.claim.flags)
    return f"{words} ({flags})" if flags else words


def write_bound(result: CriterionResult) -> str:
    """Format the origin of a value's limit."""
    return {"paper": "the paper's", "ours": "ours", "": ""}[result.test.whose]


def count_verdicts(report: Report) -> str:
    """Return one sentence with the numbers of verdicts."""
    counts = {name: sum(c.verdict == name for c in report.claims) for name in STYLES}
    lost = sum(bool(c.trouble) for c in report.claims)
    put_in = sum(c.verdict == "not_comparable" and bool(c.claim.flags) for c in report.claims)
    notes = [f"{put_in} of these by construction or fitted"] if put_in else []
    notes += [f"{lost} could not be measured"] if lost else []
    return (
        f"{counts['reproduced']} of {len(report.claims)} claims reproduced, "
        f"{counts['contradicted']} contradicted, {counts['not_comparable']} not comparable"
        + (f" ({', '.join(notes)})." if notes else ".")
    )


def write_claims_page(reports: Sequence[Report], path: Path) -> None:
    """Write claims.html, a self-contained page with one figure per claim.

    Raises InputError if it cannot be written.
    """
    with house_style():
        pictures = {
            c.id: build_picture(c.claim.statement, draw_claim(c.figure), c.figure.caption, c.id)
            for report in reports for c in report.claims if c.figure is not None
        }  # fmt: skip
    write_page(path, render_page(
        "claims.html.j2", reports=reports, pictures=pictures, versions=collect_versions(),
        count=count_verdicts, number=write_number, limit=write_limit, printed=write_paper_value,
        verdict=write_verdict, bound=write_bound,
    ))  # fmt: skip


def print_reports(reports: Sequence[Report], page: Path) -> None:
    """Print one table per paper on standard output, then the claims not reproduced, with
    reasons."""
    console = new_console()
    for report in reports:
        _print_report(report, console)
    console.print(f"{page}  a figure a claim")


def _print_report(report: Report, console: Console) -> None:
    table = Table(
        title=f"Claims of {report.file.paper.short}", title_justify="left", title_style="bold",
        header_style="bold",
    )  # fmt: skip
    for name in ("claim", "the paper", "here", "test", "bound", "judged by", "verdict"):
        table.add_column(name, overflow="fold")
    for c in report.claims:
        first = c.tests[0]
        table.add_row(
            c.claim.id, write_paper_value(first), write_number(first.value, first.test.unit),
            write_limit(first), write_bound(first), c.claim.judged_by,
            Text(write_verdict(c), style=STYLES[c.verdict]),
        )  # fmt: skip
    console.print(table)
    for c in report.claims:
        if c.verdict != "reproduced":
            console.print(Text(f"{c.claim.id}: ", style="bold") + Text(c.explanation))
    console.print(count_verdicts(report))
    for note in report.notes:
        console.print(note)


class Bar(Steps):
    """A progress bar on standard error; without a terminal, one line per flight."""

    def __init__(self) -> None:
        self._console = new_console(stderr=True)
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._done = -1

    def begin(self, total: int) -> None:
        """Start the bar."""
        if not self._console.is_terminal:
            return
        self._bar = Progress(
            TextColumn("{task.description:<44}"), BarColumn(bar_width=30), MofNCompleteColumn(),
            console=self._console, transient=True, auto_refresh=False,
        )  # fmt: skip
        self._task = self._bar.add_task("flights", total=total)
        self._bar.start()

    def step(self, name: str, cached: bool) -> None:
        """Show the current flight."""
        self._done += 1
        if self._bar is None or self._task is None:
            if not cached:
                self._console.print(f"flying {name}")
            return
        self._bar.update(self._task, description=name, completed=self._done)
        self._bar.refresh()

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
