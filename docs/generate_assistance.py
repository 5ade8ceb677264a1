"""Write the tables of docs/howto/assistance.md: `python docs/generate_assistance.py`.

Their numbers come from benchmarks/assistance.csv, which benchmarks/fly_assistance.py flies, and
from benchmarks/retrieval.csv, which benchmarks/fly_retrieval.py flies.
"""

from __future__ import annotations

import csv
from operator import itemgetter
from pathlib import Path
from statistics import median

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "assistance.md"
KEPT = DOCS.parent / "benchmarks" / "assistance.csv"
RETRIEVAL = DOCS.parent / "benchmarks" / "retrieval.csv"
BEGIN = "<!-- {}: begin, made by docs/generate_assistance.py, do not edit -->"
END = "<!-- {}: end -->"
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


def build_retrieval() -> str:
    """One line for each operator and aim."""
    with RETRIEVAL.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    lines = [
        "| operator | sees the hooks beside by (ahead, left) | installed and brought back "
        "| installation: time, s | peak force, N | retrieval: time, s | peak force, N "
        "| collisions |",
        "|---|---|---|---|---|---|---|---|",
    ]
    cases = dict.fromkeys((r["operator"], r["ahead_mm"], r["left_mm"]) for r in rows)
    for operator, ahead, left in cases:
        case = (operator, ahead, left)
        mine = [r for r in rows if (r["operator"], r["ahead_mm"], r["left_mm"]) == case]
        good = sum(r["outcome"] == "succeeded" for r in mine)
        met = sum(int(r["collisions"]) for r in mine)
        lines.append(
            f"| {operator} | {ahead}, {left} mm | {good} of {len(mine)} "
            f"| {_quote(mine, 'install_s', 1)} | {_quote(mine, 'install_n', 2)} "
            f"| {_quote(mine, 'retrieval_s', 1)} | {_quote(mine, 'retrieval_n', 2)} | {met} |"
        )
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    with KEPT.open(newline="", encoding="utf-8") as file:
        rows = sorted(csv.DictReader(file), key=_order)
    presses = f"{build_summary(rows)}\n\n{build_table(rows)}"
    for name, table in (("assistance", presses), ("retrieval", build_retrieval())):
        begin, end = BEGIN.format(name), END.format(name)
        head, rest = text.split(begin)
        text = f"{head}{begin}\n\n{table}\n\n{end}{rest.split(end)[1]}"
    return text


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
