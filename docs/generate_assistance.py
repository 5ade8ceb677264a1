"""Write the table of docs/howto/assistance.md: `python docs/generate_assistance.py`.

Its numbers come from benchmarks/assistance.csv, which benchmarks/fly_assistance.py flies.
"""

from __future__ import annotations

import csv
from operator import itemgetter
from pathlib import Path
from statistics import median

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "assistance.md"
KEPT = DOCS.parent / "benchmarks" / "assistance.csv"
BEGIN = "<!-- assistance: begin, made by docs/generate_assistance.py, do not edit -->"
END = "<!-- assistance: end -->"
LEVELS = ("none", "slow", "guard", "hold")
ORDER = (
    "calm", "gusts", "fast", "late", "position", "force", "practised", "careful", "hasty", "0",
    "150", "300", "600",
)  # fmt: skip
"""Of conditions, controls, operators and delays."""


def _quote(rows: list[dict[str, str]], column: str, digits: int) -> str:
    values = sorted(float(r[column]) for r in rows if r[column])
    return f"{median(values):.{digits}f} ({values[-1]:.{digits}f})" if values else "–"


def _order(row: dict[str, str]) -> list[int]:
    names = ("condition", "control", "operator", "delay_ms")
    return [ORDER.index(row[name]) for name in names]


def build_table(rows: list[dict[str, str]]) -> str:
    """One line for each condition, control, operator, delay and level."""
    lines = [
        "| condition | control | operator | delay | assistance | succeeded | peak force, N "
        "| time, s | rms error of the held force, N |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    case = itemgetter("condition", "control", "operator", "delay_ms")
    for found in dict.fromkeys(map(case, rows)):
        for level in LEVELS:
            mine = [r for r in rows if case(r) == found and r["assistance"] == level]
            if not mine:
                continue
            good = sum(r["outcome"] == "succeeded" for r in mine)
            lines.append(
                f"| {' | '.join(found)} ms | {level} | {good} of {len(mine)} "
                f"| {_quote(mine, 'force_max_n', 2)} | {_quote(mine, 'time_s', 1)} "
                f"| {_quote(mine, 'force_rms_error_n', 2)} |"
            )
    return "\n".join(lines)


def build_summary(rows: list[dict[str, str]]) -> str:
    """One line for each condition and control: how many presses of each level succeeded."""
    lines = [
        f"| condition | control | {' | '.join(LEVELS)} |",
        f"|---|---|{'---|' * len(LEVELS)}",
    ]
    case = itemgetter("condition", "control")
    for found in dict.fromkeys(map(case, rows)):
        cells = []
        for level in LEVELS:
            mine = [r for r in rows if case(r) == found and r["assistance"] == level]
            good = sum(r["outcome"] == "succeeded" for r in mine)
            cells.append(f"{good} of {len(mine)}, {_quote(mine, 'force_max_n', 2)} N")
        lines.append(f"| {' | '.join((*found, *cells))} |")
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    with KEPT.open(newline="", encoding="utf-8") as file:
        rows = sorted(csv.DictReader(file), key=_order)
    head, rest = text.split(BEGIN)
    made = f"{build_summary(rows)}\n\n{build_table(rows)}"
    return f"{head}{BEGIN}\n\n{made}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
