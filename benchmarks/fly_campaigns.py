"""Fly campaigns of benchmarks/campaigns/campaigns.toml and write their results beside it.

    python benchmarks/fly_campaigns.py [NAME...] [--out FOLDER] [--workers N]

Without NAME all are flown, which takes hours. An interrupted campaign in FOLDER is continued.
NAME.json contains the commit, the number of runs that met every requirement, and each other run
with its reason.
"""

from __future__ import annotations

import argparse
import csv
import json
import shlex
import subprocess
import sys
import tomllib
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).resolve().parent / "campaigns"
CAMPAIGNS = tomllib.loads((KEPT / "campaigns.toml").read_text(encoding="utf-8"))


def fly(name: str, out: Path, workers: int) -> str:
    """Fly one campaign and write its file; return the number of successful runs as text."""
    command = [sys.executable, "-m", "skywright", "campaign"]
    command += shlex.split(CAMPAIGNS[name]["flags"]) + ["--out", str(out / name)]
    ended = subprocess.run([*command, "--workers", str(workers)], cwd=ROOT, check=False).returncode
    if ended > 1:  # 1: below the target rate
        sys.exit(f"{name}: the campaign ended with exit code {ended}")
    with (out / name / "results.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    others = [r for r in rows if r["outcome"] != "succeeded"]
    git = ["git", "-C", str(ROOT), "rev-parse", "--short=10", "HEAD"]
    result = {
        "when": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commit": subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip(),
        "flags": CAMPAIGNS[name]["flags"],
        "runs": len(rows),
        "succeeded": len(rows) - len(others),
        "others": [{k: r[k] for k in ("run", "outcome", "reason")} for r in others],
    }
    means = compute_means(rows, CAMPAIGNS[name].get("means", {}))
    if means:
        result["means"] = means
    if "largest" in CAMPAIGNS[name]:
        result["largest"] = {
            metric: max(float(r[metric]) for r in rows if r[metric])
            for metric in CAMPAIGNS[name]["largest"]
        }
    if "counted" in CAMPAIGNS[name]:
        result["counted"] = {
            metric: dict(Counter(f"{float(r[metric]):g}" for r in rows if r[metric]))
            for metric in CAMPAIGNS[name]["counted"]
        }
    text = json.dumps(result, indent=1, ensure_ascii=False) + "\n"
    (KEPT / f"{name}.json").write_text(text, encoding="utf-8")
    return f"{name}: {result['succeeded']} of {result['runs']}"


def compute_means(rows: list[dict[str, str]], limits: dict[str, float]) -> dict[str, object]:
    """Return the mean of metrics over the runs that have them, and whether its limit is met."""
    out: dict[str, object] = {}
    for metric, limit in limits.items():
        values = [float(r[metric]) for r in rows if r.get(metric)]
        mean = sum(values) / len(values) if values else None
        met = mean is not None and abs(mean) <= limit
        out[metric] = {"runs": len(values), "mean": mean, "limit": limit, "met": met}
    return out


def main() -> None:
    """Fly the named campaigns."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "campaigns")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    if unknown := set(args.names) - set(CAMPAIGNS):
        sys.exit(f"{', '.join(sorted(unknown))}: no such campaign; valid: {', '.join(CAMPAIGNS)}")
    for name in args.names or CAMPAIGNS:
        print(fly(name, args.out, args.workers), flush=True)


if __name__ == "__main__":
    main()
