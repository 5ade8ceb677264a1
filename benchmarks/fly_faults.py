"""Fly the conditions of benchmarks/faults-MISSION.csv, and judge each flight.

    python benchmarks/fly_faults.py [MISSION...] [--again RUN...] [--keep FOLDER] [--table FILE]

Each run has the description and the seed of `skywright campaign MISSION --runs 50 --seed SEED
--vary benchmarks/faults-MISSION.csv` (SEED: SEEDS of benchmarks/fault_conditions.py). A run is
evaluated after its landing (benchmarks/judge_faults.py), and its recording is deleted unless
`--keep` names a folder. The table benchmarks/faults-judged.csv is written after each run. Runs in
the table are not repeated unless `--again` names their numbers, or `failed` for all that did not
pass. A run without a plan, or one that diverges, is a row that does not pass.
"""

from __future__ import annotations

import argparse
import csv
import fcntl
import subprocess
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fault_conditions import MISSIONS, SEEDS
from judge_faults import FIELDS, judge, to_row

from skywright.analysis.campaign.spec import Campaign, build_campaign, draw_run, load_run
from skywright.errors import SkywrightError
from skywright.run.run import run_mission

HERE = Path(__file__).resolve().parent
TABLE = HERE / "faults-judged.csv"
Rows = dict[tuple[str, int], dict[str, str]]


def read_table(file: Path) -> Rows:
    """Read the evaluated runs: (mission, run) -> row."""
    if not file.exists():
        return {}
    with file.open(encoding="utf-8", newline="") as text:
        return {(r["mission"], int(r["run"])): r for r in csv.DictReader(text)}


@contextmanager
def change_table(file: Path) -> Iterator[Rows]:
    """Read the table, yield it for changes and write it, under a lock for several processes."""
    lock_file = Path(tempfile.gettempdir()) / f"{file.stem}.lock"
    with lock_file.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        rows = read_table(file)
        yield rows
        with file.open("w", encoding="utf-8", newline="") as text:
            out = csv.DictWriter(text, FIELDS, lineterminator="\n")
            out.writeheader()
            out.writerows(row for _, row in sorted(rows.items()))


def fly(campaign: Campaign, run: int, keep: Path | None) -> dict[str, str]:
    """Fly one condition and evaluate it."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = (keep or Path(scratch)) / campaign.mission / f"{run:05d}"
        try:
            flown = run_mission(load_run(campaign, draw_run(campaign, run)), out=folder)
            return to_row(judge(flown.directory))
        except SkywrightError as error:
            traceback.print_exc()
            row = dict.fromkeys(FIELDS, "")
            return row | {"run": f"{run:05d}", "mission": campaign.mission, "passed": "False",
                          "outcome": type(error).__name__, "reason": str(error)}  # fmt: skip


def main() -> None:
    """Fly the missing or the named runs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("missions", nargs="*", metavar="MISSION")
    parser.add_argument("--again", nargs="+", default=[], metavar="RUN", help="numbers, or failed")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where run directories stay")
    parser.add_argument("--table", type=Path, default=TABLE)
    args = parser.parse_args()
    if unknown := set(args.missions) - set(MISSIONS):
        parser.error(f"{', '.join(sorted(unknown))}: valid: {', '.join(MISSIONS)}")
    git = ["git", "-C", str(HERE), "rev-parse", "--short=10", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    for mission in args.missions or MISSIONS:
        conditions = HERE / f"faults-{mission}.csv"
        campaign = build_campaign(mission, [str(conditions)], seed=SEEDS[mission])
        count = len(conditions.read_text(encoding="utf-8").splitlines()) - 1
        for run in range(count):
            known = read_table(args.table).get((mission, run))
            failed = "failed" in args.again and known is not None and known["passed"] != "True"
            named = str(run) in args.again
            if not (named or failed or (known is None and not args.again)):
                continue
            row = fly(campaign, run, args.keep) | {"commit": commit}
            with change_table(args.table) as rows:
                rows[mission, run] = row
            print(" ".join(row[k] for k in FIELDS), flush=True)


if __name__ == "__main__":
    main()
