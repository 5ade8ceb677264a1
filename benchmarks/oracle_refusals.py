"""Fly refused requests without their margins: `oracle_refusals.py FOLDER [--table FILE]`.

FOLDER is the output of `skywright campaign ... --vary TABLE --out FOLDER`. A refusal that names a
margin is flown without it, and the oracle judges the flight like the others: a fraction of a
computed limit (`mission.wind_fraction`) is set to 1, a reserve or a clearance
(`mission.task.way_clearance_m`) to the minimum of its key. Each refusal is then

- limit: still refused, beyond the computed limit itself or for a reason without a margin;
- right: flown, and the request was not met;
- careful: flown and met. The margin refused a request that this robot, with this seed, can meet.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import sys
from collections import Counter
from pathlib import Path

from oracle import judge

import skywright
from skywright.errors import InfeasibleError

NAMED = re.compile(r"mission\.(?:task\.)?(?:[a-z_]*_(?:fraction|reserve|clearance_m)|clearance_m)")
MOST_TRIES = 6  # a refusal may hide another one


def find_loosest(mission: str, key: str) -> float:
    """Return the least restrictive value of a margin's key: 1 for a fraction, or the key's
    minimum."""
    if key.endswith("_fraction"):
        return 1.0
    spec = skywright.load(mission).mission
    field = type(spec.task if ".task." in key else spec).model_fields[key.split(".")[-1]]
    return max([0.0, *(m.ge for m in field.metadata if getattr(m, "ge", None) is not None)])


def fly_refused(folder: Path, mission: str, row: dict[str, str]) -> tuple[str, str]:
    """Return the result of a refused request, and its reason."""
    keys = [k for k in row if k.split(".")[0] in ("mission", "world", "plant", "robot")]
    robot = row.get("mission.robot") or None
    sets = {k: row[k] for k in keys if k != "mission.robot" and row[k]}
    sets = {k: v.lower() if v in ("True", "False") else v for k, v in sets.items()}  # as in TOML
    reason, loosened = row["reason"], set[str]()
    for _ in range(MOST_TRIES):
        named = NAMED.search(reason)
        if named is None or named[0] in loosened:
            return "limit", reason
        loosened.add(named[0])
        sets[named[0]] = str(find_loosest(mission, named[0]))
        try:
            d = skywright.load(
                mission,
                robot=robot,
                seed=int(row["seed"]),
                sets=[f"{k}={v}" for k, v in sets.items()],
            )
            skywright.run(d, out=folder)
        except InfeasibleError as error:
            reason = str(error)
            continue
        verdict = judge(folder)
        return ("careful", "") if verdict.met else ("right", verdict.why)
    return "limit", reason


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--most", type=int, default=10**6, help="refusals to fly")
    parser.add_argument("--table", type=Path)
    a = parser.parse_args()
    mission = json.loads((a.folder / "campaign.json").read_text(encoding="utf-8"))["mission"]
    with (a.folder / "results.csv").open(encoding="utf-8") as file:
        refused = [r for r in csv.DictReader(file) if r["outcome"] in ("infeasible", "refused")]
    counts, rows = Counter[str](), []
    for row in refused[: a.most]:
        ended, why = fly_refused(a.folder / "refused" / row["run"], mission, row)
        counts[ended] += 1
        rows.append((row["run"], ended, row["reason"], why))
        print(f"{ended:8s} {row['run']:>4s} {row['reason'][:100]} | {why[:80]}", flush=True)
    if a.table is not None:
        with a.table.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(
                [("run", "ended", "reason", "why"), *rows]
            )
    print(f"{len(refused)} refused: {', '.join(f'{n} {k}' for k, n in sorted(counts.items()))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
