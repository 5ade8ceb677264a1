"""Waiting times of a user: command line, imports, first report."""

from functools import partial

from skywright.evidence.bench.commands import PYTHON, SKYWRIGHT, time_command, time_run
from skywright.evidence.bench.flights import SCAN
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.evidence.bench.timing import interleave

HELP_LIMIT = 0.4  # s
REPORT_LIMIT = 10.0  # s

COMMANDS = {
    "python": (*PYTHON, "-c", "pass"),
    "import": (*PYTHON, "-c", "import skywright"),
    "help": (*SKYWRIGHT, "--help"),
    "list": (*SKYWRIGHT, "list", "robots"),
    "capability": (*SKYWRIGHT, "capability", "othex", "--json"),
}
NOTES = {
    "python": "python -c pass: what none of ours can be below",
    "import": "python -c 'import skywright'",
    "help": "skywright --help",
    "list": "skywright list robots",
    "capability": "skywright capability othex --json",
}


def measure(session: Session) -> list[Row]:
    """Time short commands in turns, then the first report with compiled code in the cache."""
    chosen = session.pick(["python", "help"], ["python", "import", "help", "list"], [*COMMANDS])
    times = interleave({n: partial(_time_short, n) for n in chosen}, session.pick(1, 3, 15))
    rows = [
        build_row(f"{n}_s", times[n], "s", limit=HELP_LIMIT if n == "help" else None, note=NOTES[n])
        for n in chosen
    ]  # fmt: skip
    if session.effort != "quick":
        rows.append(measure_report(session))
    return rows


def measure_report(session: Session) -> Row:
    """Time the whole command `skywright run`, with report and replay."""
    walls = []
    for i in range(session.pick(1, 1, 5)):
        walls.append(time_run(SCAN, session.scratch / f"report-{i}")[0])
    note = f"skywright run {SCAN}, plan, report and replay included, compiled before"
    return build_row("first_report_s", walls, "s", limit=REPORT_LIMIT, note=note)


def _time_short(name: str) -> float:
    return time_command(COMMANDS[name]).wall_s
