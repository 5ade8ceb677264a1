"""Whole runs against real time: planned, flown, recorded and evaluated; the report apart."""

from skywright.evidence.bench.commands import time_run
from skywright.evidence.bench.flights import FULL_STRENGTH, SCAN, load_scan
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.run.run import run_mission

LIMIT = 40.0
CASES = {"": (), "full_strength_": FULL_STRENGTH}
NOTES = {"": "plain scan", "full_strength_": "scan with gusts, link, artefacts, varying friction"}


def measure(session: Session) -> list[Row]:
    """Runs in this process, compiled code loaded; then each in a process of its own."""
    rounds = session.pick(1, 2, 15)
    factors = [{name: _fly(name, session, i) for name in CASES} for i in range(rounds + 1)]
    rows = [
        build_row(
            f"{name}real_time_factor", [f[name] for f in factors[1:]], limit=LIMIT, sense=">=",
            note=f"{NOTES[name]}, report excluded, in a process that has flown before",
        )
        for name in CASES
    ]  # fmt: skip
    if session.effort == "quick":
        return rows
    return rows + [_measure_process(name, session) for name in CASES]


def _fly(name: str, session: Session, i: int) -> float:
    out = session.scratch / f"{name}run-{i}"
    return run_mission(load_scan(*CASES[name]), out=out).timing["real_time_factor"]


def _measure_process(name: str, session: Session) -> Row:
    """`skywright run` from its start: loading compiled code is part of the run."""
    factors = []
    for i in range(session.pick(1, 1, 5)):
        _, found = time_run(SCAN, session.scratch / f"{name}process-{i}", *CASES[name])
        factors.append(found["timing"]["real_time_factor"])
    return build_row(
        f"{name}process_real_time_factor", factors, limit=LIMIT, sense=">=",
        note=f"{NOTES[name]}, report excluded, as `skywright run` tells it",
    )  # fmt: skip
