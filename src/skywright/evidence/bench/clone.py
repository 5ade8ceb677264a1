"""Time from a fresh clone of this checkout to the first report."""

import os
import shutil
import sys
import time
from pathlib import Path

from skywright.errors import SimulationError
from skywright.evidence.bench.commands import time_command
from skywright.evidence.bench.machine import read_commit
from skywright.evidence.bench.rows import Row, Session, build_row, build_unmeasured_row

CHECKOUT = Path(__file__).parents[4]
LOCK = "requirements-run.lock"
LIMIT = 60.0  # s


def measure(session: Session) -> list[Row]:
    """Clone the last commit, download the packages of `make demo`, and time it offline, twice.

    The first run uses no cache, neither of packages nor of compiled code.
    """
    missing = [tool for tool in ("git", "make") if shutil.which(tool) is None]
    if missing or read_commit()["commit"] is None:
        why = f"requires {' and '.join(missing)}" if missing else "requires a checkout"
        return [build_unmeasured_row("to_report_s", why)]
    clone, wheels = session.scratch / "clone", session.scratch / "wheels"
    begin = time.perf_counter()
    time_command(["git", "clone", "--quiet", str(CHECKOUT), str(clone)])
    cloning = time.perf_counter() - begin
    try:
        download = time_command([
            sys.executable, "-m", "pip", "download", "--quiet", "--no-cache-dir", "--no-deps",
            "--require-hashes", "-r", str(clone / LOCK), "-d", str(wheels),
        ]).wall_s  # fmt: skip
    except SimulationError as error:
        return [build_unmeasured_row("to_report_s", f"packages were not downloaded: {error}")]
    size = sum(f.stat().st_size for f in wheels.iterdir()) / 1e6
    environment = {
        "PATH": f"{sys.base_prefix}/bin{os.pathsep}{os.environ.get('PATH', '')}",
        "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(wheels), "PIP_NO_CACHE_DIR": "1",
        "UV_NO_INDEX": "1", "UV_FIND_LINKS": str(wheels), "UV_NO_CACHE": "1",
        "NUMBA_CACHE_DIR": str(session.scratch / "compiled"),
    }  # fmt: skip
    make = ["make", "--no-print-directory", "-C", str(clone)]
    install, cold, warm = (
        time_command([*make, goal], environment=environment).wall_s
        for goal in (".venv/.installed-run", "demo", "demo")
    )
    return [
        build_row(
            "to_report_s", cloning + install + cold, "s", limit=LIMIT,
            note="git clone and `make demo`: installation, compilation, flight, report and replay; "
            "downloads excluded",
        ),
        build_row("install_s", install, "s", note="of it, the installation"),
        build_row("compiling_s", cold - warm, "s", note="of it, what the second `make demo` saves"),
        build_row("again_s", warm, "s", note="the second `make demo`"),
        build_row("download_s", download, "s", note="download of all packages, from where pip is "
                  "set to look: not part of the above"),
        build_row("download_mb", size, "MB", note="size of the packages"),
    ]  # fmt: skip
