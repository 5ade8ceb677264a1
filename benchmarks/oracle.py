"""Judge flown missions independently: `python benchmarks/oracle.py DIR [--table FILE]`.

DIR contains run directories, as `skywright campaign ... --record all --out FOLDER` writes them to
FOLDER/runs. The oracle reads the request (mission.toml), the true world and the recorded truth, and
decides independently whether the request was met and reported. It imports nothing of Skywright's
evaluation, inspection or missions. The run's outcome is right if it agrees: "succeeded" for a
request that was met, anything else for one that was not. The exit code is 1 below 97 %.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from oracle_flight import (
    judge_excitation,
    judge_impact,
    judge_modes,
    judge_plan,
    judge_transport,
    judge_waypoints,
)
from oracle_hands import judge_bimanual, judge_insertion, judge_install, judge_tool
from oracle_press import judge_bench, judge_contact
from oracle_scan import judge_scan
from oracle_truth import tell_saturation, tell_stall

from skywright.description.loader import Description, load_description
from skywright.recordings.recording import read_recording

RIGHT = 0.97


class Verdict(NamedTuple):
    """Result of one run."""

    run: str
    mission: str
    outcome: str
    met: bool  # verdict of the oracle
    right: bool
    why: str  # what was not met, according to the oracle
    told: str  # reason in the run


JUDGES: dict[str, Callable[[Description[Any], dict[str, Any], Any], list[str]]] = {
    "scan": judge_scan,
    "waypoints": judge_waypoints,
    "excitation": judge_excitation,
    "flight-modes": judge_modes,
    "impact": judge_impact,
    "bar-transport": judge_transport,
    "follow-plan": judge_plan,
    "arm-test-bench": judge_bench,
    "bridge-contact": judge_contact,
    "bimanual-bench": judge_bimanual,
    "sensor-install": judge_install,
    "tool-install": judge_tool,
    "bar-insertion": judge_insertion,
}
"""Kind of mission -> unmet requirements; each judge's file lists its criteria."""

ENDED = ("aborted", "interrupted", "diverged")


def judge(folder: Path) -> Verdict:
    """Judge one run."""
    told = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    d = load_description(folder)
    if d.mission.kind not in JUDGES:
        sys.exit(f"{folder}: kind {d.mission.kind!r} is not judged yet; valid: {', '.join(JUDGES)}")
    why = [f"{told['outcome']}: {told['reason'][:60]}"] if told["outcome"] in ENDED else []
    if not why:
        samples = read_recording(folder / "recording.mcap").samples
        why = JUDGES[d.mission.kind](d, told, samples)
        if "flight.saturated_max_s" in d.mission.requirements:
            why += tell_saturation(told, samples)
        if "arm.saturated_max_s" in d.mission.requirements:
            why += tell_stall(samples)
    failed = [r["name"] for r in told["requirements"] if not r["passed"]]
    right = (told["outcome"] == "succeeded") == (not why)
    if told["outcome"] != "succeeded" and not (told["reason"] or failed):
        why, right = ["no reason is told"], False
    says = told["reason"] or " ".join(failed)
    return Verdict(
        folder.name, d.mission.name, told["outcome"], not why, right, "; ".join(why), says
    )


def list_refused(folders: list[Path]) -> list[tuple[int, str]]:
    """Return the runs of campaigns that did not fly, with their reasons: they have no recorded
    truth."""
    out = []
    for file in (f.parent / "runs.jsonl" for f in folders):
        lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
        rows = [json.loads(x) for x in lines]
        out += [(r["run"], r["reason"]) for r in rows if r["outcome"] in ("infeasible", "refused")]
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--table", type=Path)
    a = parser.parse_args()
    found = sorted(m.parent for f in a.folders for m in f.glob("*/metrics.json"))
    rows = [judge(run) for run in found if run.suffix != ".partial"]
    for r in rows:
        mark = "right" if r.right else "WRONG"
        print(
            f"{mark} {r.run:10s} {r.outcome:9s} {'met' if r.met else r.why[:110]} | {r.told[:70]}"
        )
    refused = list_refused(a.folders)
    if a.table is not None:
        with a.table.open("w", encoding="utf-8", newline="") as file:
            out = csv.writer(file, lineterminator="\n")
            out.writerow(Verdict._fields)
            out.writerows(rows)
            out.writerows((f"{run:05d}", "", "refused", "", "", "", why) for run, why in refused)
    good = sum(r.right for r in rows)
    for run, reason in refused:
        print(f"refused {run}: {reason[:150]}")
    print(f"{good} of {len(rows)} verdicts right; {len(refused)} runs were refused, for a person")
    return 0 if rows and good >= RIGHT * len(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
