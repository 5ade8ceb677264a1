"""Benchmarks on the terminal: one table each, printed when it is measured."""

from rich.table import Table
from rich.text import Text

from skywright.evidence.bench.rows import Row
from skywright.evidence.bench.runner import Report
from skywright.reports.terminal import format_number, new_console

SIGNS = {"<=": "≤", ">=": "≥"}


class Tables:
    """Prints one table per benchmark to standard output, and the progress to standard error."""

    def __init__(self, *, quiet: bool = False) -> None:
        """`quiet` prints no tables, because `--json` uses standard output."""
        self._quiet = quiet
        self._out, self._err = new_console(width=120), new_console(stderr=True)

    def begin(self, name: str, description: str) -> None:
        """Print the current benchmark."""
        text = f"{name}: {description} ..." if name else f"{description} ..."
        if not self._err.is_terminal:
            self._err.print(text)
            return
        self.close()
        # no animation: its thread would disturb the measurement
        self._err.print(text, end="\r")

    def end(self, name: str, rows: list[Row]) -> None:
        """Print the rows of a benchmark."""
        self.close()
        if not self._quiet:
            self._out.print(build_table(name, rows))

    def close(self) -> None:
        """Remove the progress line."""
        if self._err.is_terminal:
            self._err.print(" " * 79, end="\r")


def build_table(name: str, rows: list[Row]) -> Table:
    """Build the table of one benchmark; the quartiles show the spread of a value."""
    table = Table(title=name, title_justify="left", title_style="bold", header_style="bold")
    table.add_column("name", overflow="fold")
    table.add_column("median", justify="right")
    table.add_column("quartiles", justify="right")
    table.add_column("limit", justify="right")
    table.add_column("")
    table.add_column("what", overflow="fold")
    for row in rows:
        quartiles = ""
        if row.low is not None and row.high is not None:
            quartiles = f"{format_number(row.low)} to {format_number(row.high)}"
        limit = "" if row.limit is None else f"{SIGNS[row.sense]} {row.limit:g}"
        mark = Text("")
        if row.passed is not None:
            mark = Text("met", "green") if row.passed else Text("MISSED", "bold red")
        if row.value is None and row.passed is False:
            mark = Text("FAILED", "bold red")
        table.add_row(
            row.name.split(".", 1)[-1], format_number(row.value, row.unit), quartiles, limit, mark,
            Text(row.note),
        )  # fmt: skip
    return table


def print_end(report: Report) -> None:
    """Print the summary and the path of the file."""
    console = new_console()
    judged = [r for r in report.rows if r.limit is not None]
    missed = [r for r in judged if not r.passed]
    m, load = report.machine, report.load["before"]
    console.print(
        f"{len(judged) - len(missed)} of {len(judged)} limits met in {report.wall_s:.0f} s on "
        f"{m['cores']} cores of {m['processor']}, load average before {load}",
    )
    for row in missed:
        sign = SIGNS[row.sense]
        text = f"{row.name}: {format_number(row.value, row.unit)}, limit {sign} {row.limit:g}"
        console.print(Text("missed ", "bold red") + Text(text))
    for name in report.failed:
        console.print(Text("failed ", "bold red") + Text(name))
    if report.busy:
        console.print(
            "the machine was busy: ratios hold roughly, times do not; measure again on an idle one"
        )
    if report.file is not None:
        console.print(str(report.file))
