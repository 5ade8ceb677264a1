"""Write the tables of docs/reference/laws.md: `python docs/generate_laws.py`.

Rows come from benchmarks/laws: laws.toml says what is flown, NAME.json how it went. The matrix at
the top has a column a mission and robot, and counts the flights of the case `nominal`.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
PAGE = DOCS / "reference" / "laws.md"
KEPT = DOCS.parent / "benchmarks" / "laws"
BEGIN = "<!-- laws: begin, made by docs/generate_laws.py, do not edit -->"
END = "<!-- laws: end -->"
ALL = "all"
"""Of the comparisons that ask for every built-in law: they have a column of the matrix."""
RUNS = 10
"""Flights of a law in a case that benchmarks/fly_laws.py flies by default."""


def tell_number(x: float | None) -> str:
    """Three digits, or a dash."""
    return "–" if x is None else f"{x:.3g}"


class Refusals:
    """Reasons why laws are refused, each with a letter; they differ in the law's name alone."""

    def __init__(self) -> None:
        self.known: list[str] = []

    def mark(self, law: str, why: str) -> str:
        """Return the letter of a reason."""
        plain = why.replace(f"'{law}'", "LAW").replace(f"`{law}`", "LAW")
        if plain not in self.known:
            self.known.append(plain)
        return chr(ord("a") + self.known.index(plain))

    def list_lines(self) -> list[str]:
        """Return a line a reason."""
        return [f"- ({chr(ord('a') + i)}) {why}" for i, why in enumerate(self.known)]


def name_column(one: dict[str, Any]) -> str:
    """Return mission and robot of a comparison."""
    return f"`{one['mission']}`, `{one['robot']}`"


def build_matrix(found: Iterable[dict[str, Any]], refusals: Refusals) -> str:
    """Return which law flew which mission: runs of the case `nominal` that met all requirements."""
    cells: dict[tuple[str, str], dict[str, Any]] = {}
    found = list(found)
    columns = [name_column(one) for one in found if one["laws"] == ALL]
    for one in found:
        column = name_column(one)
        if column not in columns or one["changed"]:
            continue
        for f in (f for f in one["flown"] if f["case"] == "nominal"):
            kept = cells.setdefault((f["law"], column), f)
            if f["runs"] > kept["runs"]:
                cells[f["law"], column] = f
    lines = ["| law | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for law in sorted({law for law, _ in cells}):
        row = []
        for column in columns:
            f = cells.get((law, column))
            if f is None:
                row.append("–")
            elif not f["runs"] and not f["refused"]:
                row.append("not flown")
            elif f["refused"]:
                row.append(f"refused ({refusals.mark(law, f['refused'])})")
            else:
                row.append(f"{f['succeeded']} of {f['runs']}")
        lines.append(f"| `{law}` | " + " | ".join(row) + " |")
    return "\n".join(lines)


def build_table(name: str, asked: dict[str, Any], refusals: Refusals) -> str:
    """Return one comparison: a line a law and case."""
    found = json.loads((KEPT / f"{name}.json").read_text(encoding="utf-8"))
    shown = asked["shown"]
    runs = max(f["runs"] for f in found["flown"])
    if not runs:
        return ""  # only refusals are known, which the matrix shows
    few = "" if runs == RUNS else f" --runs {runs}"
    beyond = {(d["law"], d["case"], d["metric"]) for d in found["differences"] if d["significant"]}
    lines = [
        f"### {asked['task'][0].upper()}{asked['task'][1:]}",
        "",
        f"Mission `{found['mission']}`, robot `{found['robot']}`, commit `{found['commit']}`, "
        f"{found['when']}: `python benchmarks/fly_laws.py {name}{few}`.",
        "",
        "| law | case | succeeded | " + " | ".join(f"`{m}`" for m in shown) + " |",
        "|---|---|---|" + "---|" * len(shown),
    ]
    for law in dict.fromkeys(f["law"] for f in found["flown"]):
        for f in (f for f in found["flown"] if f["law"] == law):
            if f["refused"]:
                mark = refusals.mark(law, f["refused"])
                lines.append(f"| `{law}` | {f['case']} | refused ({mark}) |" + " – |" * len(shown))
                continue
            cells = [
                ("**{}**" if (law, f["case"], m) in beyond else "{}").format(
                    tell_number(f["medians"].get(m))
                )
                for m in shown
            ]
            done = f"{f['succeeded']} of {f['runs']}"
            lines.append(f"| `{law}` | {f['case']} | {done} | {' | '.join(cells)} |")
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    head, rest = text.split(BEGIN)
    asked = tomllib.loads((KEPT / "laws.toml").read_text(encoding="utf-8"))
    flown = [name for name in asked if (KEPT / f"{name}.json").is_file()]
    results = [json.loads((KEPT / f"{n}.json").read_text(encoding="utf-8")) for n in flown]
    for name, result in zip(flown, results, strict=True):
        result |= {"laws": asked[name]["laws"], "changed": asked[name].get("sets", [])}
    refusals = Refusals()
    matrix = build_matrix(results, refusals)
    tables = [table for n in flown if (table := build_table(n, asked[n], refusals))]
    parts = ["### Every law in every main mission", matrix]
    if refusals.known:
        why = ["Why a law is refused, before take-off:", "", *refusals.list_lines()]
        parts.append("\n".join(why))
    body = "\n\n".join([*parts, *tables])
    return f"{head}{BEGIN}\n\n{body}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
