"""Write the tables of docs/reference/laws.md: `python docs/generate_laws.py`.

Rows come from benchmarks/laws: laws.toml says what is flown, NAME.json how it went. The matrix at
the top has a column a mission and robot, and counts the flights of the case `nominal` of the newest
comparison that flew or refused a law; the table below it says which.
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
        return self._name(self.known.index(plain))

    def list_lines(self) -> list[str]:
        """Return a line a reason."""
        return [f"- ({self._name(i)}) {why}" for i, why in enumerate(self.known)]

    @staticmethod
    def _name(i: int) -> str:
        """Return a to z, then aa, ab and so on."""
        letter = chr(ord("a") + i % 26)
        return letter if i < 26 else Refusals._name(i // 26 - 1) + letter


def name_column(one: dict[str, Any]) -> str:
    """Return mission and robot of a comparison."""
    return f"`{one['mission']}`, `{one['robot']}`"


def choose_cells(found: Iterable[dict[str, Any]]) -> dict[tuple[str, str], tuple[Any, Any]]:
    """Return (comparison, what flew in its case `nominal`) by (law, column): the newest that flew.

    Of comparisons of one day that with more runs, then the later of laws.toml.
    """
    cells: dict[tuple[str, str], tuple[Any, Any]] = {}
    for one in found:
        for f in (f for f in one["flown"] if f["case"] == "nominal" and not one["changed"]):
            key = f["law"], name_column(one)
            kept = cells.setdefault(key, (one, f))
            ranks = [
                (bool(x["runs"] or x["refused"]), c["when"], x["runs"]) for c, x in (kept, (one, f))
            ]
            if ranks[1] >= ranks[0]:
                cells[key] = one, f
    return cells


def build_matrix(found: Iterable[dict[str, Any]], refusals: Refusals) -> str:
    """Return which law flew which mission: runs of the case `nominal` that met all requirements."""
    found = list(found)
    cells = choose_cells(found)
    columns = [name_column(one) for one in found if one["laws"] == ALL]
    lines = ["| law | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    sources: dict[tuple[str, str], list[str]] = {}
    for law in sorted({law for law, column in cells if column in columns}):
        row = []
        for column in columns:
            one, f = cells.get((law, column), (None, None))
            if f is None:
                row.append("–")
                continue
            sources.setdefault((column, one["name"]), []).append(law)
            if f["refused"]:
                row.append(f"refused ({refusals.mark(law, f['refused'])})")
            elif not f["runs"]:
                row.append("not flown")
            else:
                row.append(f"{f['succeeded']} of {f['runs']}")
        lines.append(f"| `{law}` | " + " | ".join(row) + " |")
    by = {one["name"]: one for one in found}
    lines += ["", "| mission, robot | comparison | commit | date | laws |", "|---|---|---|---|---|"]
    for column in columns:
        mine = {name: laws for (c, name), laws in sources.items() if c == column}
        for name, laws in mine.items():
            told = "all" if len(mine) == 1 else ", ".join(f"`{law}`" for law in laws)
            one = by[name]
            lines.append(f"| {column} | `{name}` | `{one['commit']}` | {one['when']} | {told} |")
    return "\n".join(lines)


def tell_changes(asked: dict[str, Any]) -> str:
    """Return sentences on the keys that all cases set, and on those of the cases defined here."""
    told = "".join(
        f" {what}: {', '.join(f'`{key}`' for key in asked[name])}."
        for name, what in (("sets", "All cases set"), ("vary", "All cases vary")) if name in asked
    )  # fmt: skip
    cases: dict[str, list[str]] = {}
    for case in asked["cases"]:
        label, _, key = case.partition(":")
        if key:
            cases.setdefault(label, []).append(f"`{key}`")
    return told + "".join(f" Case {label}: {', '.join(keys)}." for label, keys in cases.items())


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
        f"{found['when']}: `python benchmarks/fly_laws.py {name}{few}`.{tell_changes(asked)}",
        "",
        "| law | case | succeeded | " + " | ".join(f"`{m}`" for m in shown) + " | a step (µs) |",
        "|---|---|---|" + "---|" * (len(shown) + 1),
    ]
    lost = []
    for law in dict.fromkeys(f["law"] for f in found["flown"]):
        mine = [f for f in found["flown"] if f["law"] == law]
        marks = [f["refused"] and refusals.mark(law, f["refused"]) for f in mine]
        same = len(mine) > 1 and len(set(marks)) == 1 and marks[0]
        for f, mark in zip(mine, marks, strict=True):
            if mark:
                if not same or f is mine[0]:
                    case = "all" if same else f["case"]
                    lines.append(
                        f"| `{law}` | {case} | refused ({mark}) |" + " – |" * (len(shown) + 1)
                    )
                continue
            if why := f.get("reason"):
                lost.append(f"- `{law}`, {f['case']}: {why}")
            cells = [
                ("**{}**" if (law, f["case"], m) in beyond else "{}").format(
                    tell_number(f["medians"].get(m))
                )
                for m in shown
            ]
            done = f"{f['succeeded']} of {f['runs']}"
            cells.append(tell_number(found["cost_us"].get(law)))
            mark = " (reference)" if law == found["reference"] and f is mine[0] else ""
            lines.append(f"| `{law}`{mark} | {f['case']} | {done} | {' | '.join(cells)} |")
    if lost:
        lines += ["", "Most frequent reason of the runs that did not succeed:", "", *lost]
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    head, rest = text.split(BEGIN)
    asked = tomllib.loads((KEPT / "laws.toml").read_text(encoding="utf-8"))
    flown = [name for name in asked if (KEPT / f"{name}.json").is_file()]
    results = [json.loads((KEPT / f"{n}.json").read_text(encoding="utf-8")) for n in flown]
    for name, result in zip(flown, results, strict=True):
        result |= {
            "name": name,
            "laws": asked[name]["laws"],
            "changed": asked[name].get("sets", []),
        }
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
