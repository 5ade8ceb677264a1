"""Write the table of flights in gusts in docs/papers/suarez-2020.md from its benchmark.

python docs/generate_long_reach.py     (a test holds the page equal to it)
"""

from __future__ import annotations

import csv
from pathlib import Path

FLOWN = Path(__file__).parents[1] / "benchmarks" / "long-reach-gusts.csv"
PAGE = Path(__file__).parent / "papers" / "suarez-2020.md"
BEGIN, END = "<!-- long reach -->\n", "<!-- end of long reach -->\n"


def build_table() -> str:
    """One row a condition: the least and the largest of its seeds."""
    with FLOWN.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    lines = [
        "| condition | plan | flights | excursion (mm) | released at (deg) | decay (s) | met |",
        "|---|---|---|---|---|---|---|",
    ]

    def span(mine: list[dict[str, str]], key: str) -> str:
        values = sorted({r[key] for r in mine if r[key] not in ("", "nan")}, key=float)
        return " to ".join(dict.fromkeys((values[0], values[-1]))) if values else "-"

    for condition in dict.fromkeys(r["condition"] for r in rows):
        mine = [r for r in rows if r["condition"] == condition]
        met = sum(r["met"] == "True" for r in mine)
        refused = sum(bool(r["refused"]) for r in mine)
        plan = "accepted" if not refused else "refused" if refused == len(mine) else "by seed"
        cells = [span(mine, key) for key in ("excursion_mm", "start_deg", "decay_s")]
        lines.append(
            f"| {condition} | {plan} | {len(mine)} | {' | '.join(cells)} | {met} of {len(mine)} |"
        )
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return head + BEGIN + "\n" + build_table() + "\n\n" + END + rest.split(END)[1]


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
