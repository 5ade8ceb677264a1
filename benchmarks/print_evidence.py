"""Run modules of skywright.evidence and keep what they print, for tables of the pages.

    python benchmarks/print_evidence.py [NAME...]      # writes benchmarks/evidence/NAME.md
    python docs/generate_evidence.py                   # and the tables of the pages

Without NAME all are run, which takes some ten minutes.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

from skywright.evidence.bench.machine import read_commit

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).resolve().parent / "evidence"
COMMANDS = {
    "consistency": "-m skywright.evidence.consistency --set plant.sensor_noise_error=0",
    "stated-deviations": "-m skywright.evidence.stated_deviations",
    "identify-accuracy": "-m skywright.evidence.identify_accuracy",
    "identify-lags": "-m skywright.evidence.identify_accuracy --lags",
    "force-estimators": "-m skywright.evidence.force_estimators",
    "impacts": "-m skywright.evidence.impacts",
    "transport-laws": "-m skywright.evidence.transport_laws",
    "transport-gust": "-m skywright.evidence.transport_gust benchmarks/transport-conditions.csv "
    "--run 11",
}


def keep(name: str) -> None:
    """Run one command and write its output."""
    command = COMMANDS[name]
    ended = subprocess.run(
        [sys.executable, *shlex.split(command)], cwd=ROOT, check=False, text=True,
        stdout=subprocess.PIPE,
    )  # fmt: skip
    if ended.returncode:
        sys.exit(f"{name}: python {command} ended with exit code {ended.returncode}")
    state = read_commit()
    told = f"{state['commit']}{', changed' if state['changed'] else ''}"
    when = datetime.now(UTC).strftime("%Y-%m-%d")
    KEPT.mkdir(exist_ok=True)
    text = f"<!-- python {command}; commit {told}, {when} -->\n\n{ended.stdout}"
    (KEPT / f"{name}.md").write_text(text, encoding="utf-8")


def main() -> None:
    """Run the named modules."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    asked = parser.parse_args()
    for name in asked.names:
        if name not in COMMANDS:
            parser.error(f"{name}: no such table; valid: {', '.join(COMMANDS)}")
    for name in asked.names or COMMANDS:
        keep(name)
        print(f"{name}: {KEPT / name}.md", flush=True)


if __name__ == "__main__":
    main()
