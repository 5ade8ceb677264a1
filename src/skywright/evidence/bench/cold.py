"""The first run on a machine, without compiled code (takes about a minute)."""

from skywright.evidence.bench.commands import time_run
from skywright.evidence.bench.flights import SCAN
from skywright.evidence.bench.rows import Row, Session, build_row

LIMIT = 40.0  # s


def measure(session: Session) -> list[Row]:
    """Time `skywright run` with an empty cache, and again with the filled cache."""
    cache = {"NUMBA_CACHE_DIR": str(session.scratch / "cache")}
    cold, warm = (
        time_run(SCAN, session.scratch / f"cold-{i}", environment=cache)[0] for i in range(2)
    )
    return [
        build_row(
            "first_report_s", cold, "s", limit=LIMIT,
            note="skywright run with nothing compiled, report and replay included",
        ),
        build_row("compiling_s", cold - warm, "s", note="of it, what the second time saves"),
    ]  # fmt: skip
