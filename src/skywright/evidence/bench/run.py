"""Real-time factor of whole runs: planned, flown, recorded and evaluated, without the report."""

from typing import NamedTuple

from skywright.evidence.bench.commands import time_run
from skywright.evidence.bench.flights import FULL_STRENGTH, SCAN, load_scan
from skywright.evidence.bench.rows import Row, Session, build_row
from skywright.run.run import run_mission

COARSE = "mission.timestep_ms=2"


class Case(NamedTuple):
    """A run to time."""

    mission: str
    sets: tuple[str, ...]
    limit: float
    """Limit of the real-time factor in a separate process."""
    note: str


CASES = {
    "": Case(SCAN, (), 40.0, "plain scan"),
    "full_strength_": Case(
        SCAN, FULL_STRENGTH, 40.0, "scan with gusts, link, artefacts, varying friction"
    ),
    "scan_2_ms_": Case(SCAN, (COARSE,), 70.0, "plain scan, physics of 2 ms"),
    "bimanual_2_ms_": Case("bimanual-bench", (COARSE,), 30.0, "bimanual-bench, physics of 2 ms"),
    "long_reach_2_ms_": Case("sensor-install", (COARSE,), 22.0, "sensor-install, physics of 2 ms"),
}
AGAIN = ("", "full_strength_", "scan_2_ms_")
"""Cases that are also flown in a process that has flown before."""


def measure(session: Session) -> list[Row]:
    """Time runs in this process with loaded code, then each in a separate process."""
    rounds = session.pick(1, 2, 15)
    factors = [{name: _fly(name, session, i) for name in AGAIN} for i in range(rounds + 1)]
    rows = [
        build_row(
            f"{name}real_time_factor", [f[name] for f in factors[1:]], limit=CASES[name].limit,
            sense=">=", note=f"{CASES[name].note}, report excluded, in a process that has flown "
            "before",
        )
        for name in AGAIN
    ]  # fmt: skip
    if session.effort == "quick":
        return rows
    return rows + [_measure_process(name, session) for name in CASES]


def _fly(name: str, session: Session, i: int) -> float:
    out = session.scratch / f"{name}run-{i}"
    return run_mission(load_scan(*CASES[name].sets), out=out).timing["real_time_factor"]


def _measure_process(name: str, session: Session) -> Row:
    """Time `skywright run` from its start, including the loading of compiled code."""
    case, factors = CASES[name], []
    for i in range(session.pick(1, 3, 5)):
        _, found = time_run(case.mission, session.scratch / f"{name}process-{i}", *case.sets)
        factors.append(found["timing"]["real_time_factor"])
    return build_row(
        f"{name}process_real_time_factor", factors, limit=case.limit, sense=">=",
        note=f"{case.note}, report excluded, as `skywright run` reports it",
    )  # fmt: skip
