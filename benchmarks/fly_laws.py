"""Fly comparisons of benchmarks/laws/laws.toml and write their results beside it.

    python benchmarks/fly_laws.py [NAME...] [--runs N] [--out FOLDER] [--workers N] [--judge]

Without NAME all are flown. An interrupted comparison in FOLDER is continued. NAME.json contains the
commit, the date, and the output of `skywright compare laws --json`. `--runs 0` flies nothing and
only finds the laws that are refused before take-off. `--cost` flies nothing and measures the
computing times of the laws again, for an idle machine. `--judge` flies nothing and computes the
differences again from the rows in FOLDER; commit and date stay those of the flights.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tomllib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from skywright.analysis.campaign.store import decode_row
from skywright.analysis.compare_laws.cases import list_law_sets
from skywright.analysis.compare_laws.compare import (
    Flown,
    build_json,
    choose_reference,
    compare_flown,
    compare_laws,
)
from skywright.analysis.compare_laws.cost import measure_cost
from skywright.analysis.compare_laws.paired import find_significant
from skywright.analysis.compare_laws.report import tell_step, write_laws_page
from skywright.core.find import list_kinds
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence.bench.machine import describe_machine
from skywright.run.parts import get_law
from skywright.run.planning import plan_mission
from skywright.run.setup import Setup

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).resolve().parent / "laws"
COMPARISONS = tomllib.loads((KEPT / "laws.toml").read_text(encoding="utf-8"))
RUNS = 10
ALL = "all"
"""Replaces a list of laws: all built-in ones."""


def list_laws(c: dict[str, Any]) -> list[str]:
    """Return the laws of a comparison; of all laws, the one of the mission or its robot first."""
    if c["laws"] != ALL:
        return list(c["laws"])
    d = load_description(c["mission"], c.get("robot"), None, c.get("sets", ()), 1)
    own = get_law(d, Setup(d)).kind
    return [own, *(law for law in list_kinds("law") if law != own)]


def fly(name: str, runs: int, out: Path, workers: int) -> str:
    """Fly one comparison and write its file; return the number of successful flights as text."""
    c = COMPARISONS[name]
    found = compare_laws(
        list_laws(c), c["mission"], robot=c.get("robot"), sets=c.get("sets", ()),
        vary=c.get("vary", ()), cases=c["cases"], runs=runs, seed=1, out=out / name,
        workers=workers, step=tell_step,
    )  # fmt: skip
    write_laws_page(found, out / f"{name}.html")
    write(name, found.to_json())
    total = sum(len(f.rows) for f in found.flown)
    return f"{name}: {sum(f.succeeded for f in found.flown)} of {total} flights"


def refuse(name: str) -> str:
    """Write the refusal of each law of a comparison without flights; return a count as text."""
    c = COMPARISONS[name]
    laws = list_laws(c)
    refused = {law: find_refusal(c, law) for law in laws}
    d = load_description(c["mission"], c.get("robot"), None, c.get("sets", ()), 1)
    write(name, {
        "mission": d.mission.name, "robot": d.robot.name, "world": d.world.name, "seed": 1,
        "reference": laws[0], "cases": {"nominal": []}, "differences": [], "cost_us": {},
        "flown": [
            {"law": law, "case": "nominal", "runs": 0, "succeeded": 0, "refused": why or None,
             "medians": {}}
            for law, why in refused.items()
        ],
    })  # fmt: skip
    return f"{name}: {sum(not why for why in refused.values())} of {len(laws)} laws can fly"


def find_refusal(c: dict[str, Any], law: str) -> str:
    """Return why the mission of a comparison is refused with a law before take-off, or ""."""
    sets = [*c.get("sets", ()), *list_law_sets(law)]
    try:
        plan = plan_mission(load_description(c["mission"], c.get("robot"), None, sets, 1))
    except InputError as error:
        return str(error)
    return "" if plan.feasible else str(plan.blocked_by)


def judge(name: str, out: Path) -> str:
    """Compute the differences of a comparison again; return their number as text."""
    c, file = COMPARISONS[name], KEPT / f"{name}.json"
    found, flown = json.loads(file.read_text(encoding="utf-8")), []
    for f in found["flown"]:
        kept = out / name / f["law"] / f["case"] / "runs.jsonl"
        lines = kept.read_text(encoding="utf-8").splitlines() if f["runs"] else ()
        rows = sorted((decode_row(json.loads(line)) for line in lines), key=lambda row: row.run)
        flown.append(Flown(f["law"], f["case"], rows[: f["runs"]], f["refused"] or ""))
        told = {m: x for m, x in f["medians"].items() if x is not None}
        again = {m: flown[-1].compute_median(m) for m in told}
        if (flown[-1].succeeded, again) != (f["succeeded"], told):
            raise SystemExit(f"{kept}: not the flights of {file.name}; give their --out")
    metrics = list(dict.fromkeys(m for f in found["flown"] for m in f["medians"]))
    found["reference"] = choose_reference(list_laws(c), flown)
    differences = compare_flown(found["reference"], metrics, flown)
    found["differences"] = build_json(differences, find_significant(differences))
    file.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return f"{name}: {len(differences)} differences to {found['reference']}"


def measure(name: str) -> str:
    """Measure the laws that flew again and write the computing times; return them as text."""
    c, file = COMPARISONS[name], KEPT / f"{name}.json"
    found = json.loads(file.read_text(encoding="utf-8"))
    for law in {f["law"] for f in found["flown"] if not f["refused"]}:
        sets = [*c.get("sets", ()), *list_law_sets(law)]
        cost = measure_cost(load_description(c["mission"], c.get("robot"), None, sets, 1))
        found["cost_us"][law] = 1e6 * cost
    found["cost_processor"] = describe_machine()["processor"]
    file.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return f"{name}: {found['cost_us']}"


def write(name: str, result: dict[str, Any]) -> None:
    """Write NAME.json with commit and date."""
    git = ["git", "-C", str(ROOT), "rev-parse", "--short=10", "HEAD"]
    head = {
        "when": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commit": subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip(),
    }
    text = json.dumps({**head, **result}, indent=1, ensure_ascii=False) + "\n"
    (KEPT / f"{name}.json").write_text(text, encoding="utf-8")


def main() -> None:
    """Fly the named comparisons."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "laws")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--cost", action="store_true", help="measure computing times only")
    parser.add_argument("--judge", action="store_true", help="compute the differences again only")
    args = parser.parse_args()
    if unknown := set(args.names) - set(COMPARISONS):
        parser.error(
            f"{', '.join(sorted(unknown))}: no such comparison; valid: {', '.join(COMPARISONS)}"
        )
    if args.runs < 0 or args.workers < 1:
        parser.error(
            f"--runs {args.runs} --workers {args.workers}; valid: 0 runs or more, 1 worker or more"
        )
    if missing := [
        n for n in args.names if (args.cost or args.judge) and not (KEPT / f"{n}.json").is_file()
    ]:
        parser.error(f"{missing[0]}: not flown yet; fly it first, without --cost and --judge")
    old = args.cost or args.judge
    flown = [name for name in COMPARISONS if not old or (KEPT / f"{name}.json").is_file()]
    for name in args.names or flown:
        if args.cost:
            say = measure(name)
        elif args.judge:
            say = judge(name, args.out)
        else:
            say = fly(name, args.runs, args.out, args.workers) if args.runs else refuse(name)
        print(say, flush=True)


if __name__ == "__main__":
    main()
