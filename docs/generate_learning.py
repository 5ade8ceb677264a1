"""Write the result of docs/howto/learn-a-policy.md: `python docs/generate_learning.py`.

It comes from benchmarks/learning, which holds what examples/learning/train.py wrote.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from statsmodels.stats.proportion import proportion_confint

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "learn-a-policy.md"
KEPT = DOCS.parent / "benchmarks" / "learning"
BEGIN = "<!-- learning: begin, made by docs/generate_learning.py, do not edit -->"
END = "<!-- learning: end -->"
PLAYERS = {
    "push_and_slide": "`push_and_slide` alone",
    "learned": "`push_and_slide` steered by the policy",
    "direct_force": "`direct_force`",
}


def build_line(name: str, rows: list[dict[str, Any]]) -> str:
    """Return the line of one player."""
    good = sum(r["success"] for r in rows)
    low, high = proportion_confint(good, len(rows), method="wilson")
    error = np.array([r["force_error_n"] for r in rows])
    std = np.array([r["force_std_n"] for r in rows])
    lost = sum(bool(r["reason"]) for r in rows)
    return (
        f"| {PLAYERS[name]} | {good} of {len(rows)} | {100 * low:.0f} to {100 * high:.0f} % | "
        f"{np.median(error):.3f} | {np.percentile(error, 90):.3f} | {np.median(std):.3f} | {lost} |"
    )


def count_better(rows: list[dict[str, Any]]) -> int:
    """Return in how many conditions the policy has the smaller mean error."""
    mean = {
        (p, c): np.mean(
            [r["force_error_n"] for r in rows if (r["player"], r["condition"]) == (p, c)]
        )
        for p in ("learned", "direct_force")
        for c in {r["condition"] for r in rows}
    }
    return sum(mean["learned", c] < mean["direct_force", c] for p, c in mean if p == "learned")


def describe_other_seeds() -> list[str]:
    """Return a line on the trainings with other seeds: judged-SEED.json beside judged.json."""
    found = []
    for path in sorted(KEPT.glob("judged-*.json")):
        rows = json.loads(path.read_text(encoding="utf-8"))["episodes"]
        error = [r["force_error_n"] for r in rows if r["player"] == "learned"]
        good = sum(r["success"] for r in rows if r["player"] == "learned")
        found.append(
            f"seed {path.stem.removeprefix('judged-')} succeeded in {good} of {len(error)} episodes"
            f" with a median error of {np.median(error):.3f} N"
        )
    return ["", f"Policies of other trainings: {', '.join(found)}."] if found else []


def build_result() -> str:
    """Return the text between the marks."""
    told = json.loads((KEPT / "training.json").read_text(encoding="utf-8"))
    judged = json.loads((KEPT / "judged.json").read_text(encoding="utf-8"))
    rows = judged["episodes"]
    with (KEPT / "curve.csv").open(encoding="utf-8") as file:
        curve = list(csv.DictReader(file))
    picked = [curve[i] for i in sorted({0, *np.linspace(0, len(curve) - 1, 7).astype(int)})]
    lines = [
        "| player | succeeded | interval (95 %) | median force error (N) | 90 % below (N) | "
        "median std of the force (N) | ended early |",
        "|---|---|---|---|---|---|---|",
        *(build_line(name, [r for r in rows if r["player"] == name]) for name in PLAYERS),
        "",
        f"{len(rows) // len(PLAYERS)} episodes each, in {judged['conditions']} conditions, the "
        "same for all. The interval is Wilson's; episodes of one condition share its wind and "
        "mass, so it is narrower than that of as many independent conditions.",
        "",
        f"In {count_better(rows)} of {judged['conditions']} conditions the policy is nearer to 2 N "
        "than `direct_force`, in the mean over its episodes.",
        *describe_other_seeds(),
        "",
        f"Training: {told['steps']} steps ({told['steps'] * 0.02 / 3600:.1f} h of flight) in "
        f"{told['conditions']} conditions, {told['wall_s'] / 60:.0f} min of wall time, of which "
        f"{told['build_s'] / 60:.0f} min were the flights to where episodes begin; on one of "
        f"{told['cores']} cores, shared with other work (load {told['load_1_min']:.0f}, nice "
        f"{told['nice']}); {told['cpu_s'] / 60:.0f} min of processor time. Measured at commit "
        f"{told['commit']}.",
        "",
        "| steps | " + " | ".join(f"{int(r['steps']):,}".replace(",", " ") for r in picked) + " |",
        "|---|" + "---|" * len(picked),
        "| mean return of 100 episodes | " + " | ".join(r["return"] for r in picked) + " |",
    ]
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its result made anew."""
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{build_result()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
