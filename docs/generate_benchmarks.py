"""Write the tables in docs/reference/benchmarks.md from benchmarks/results/*.json.

python docs/generate_benchmarks.py     (`make bench` measures first; a test holds the page equal)
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from skywright.evidence.bench.registry import BENCHMARKS

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "reference" / "benchmarks.md"
RESULTS = ROOT / "benchmarks" / "results"
BEGIN, END = "<!-- benchmarks -->\n", "<!-- end of benchmarks -->\n"
HISTORY = 5
"""Measurements of one benchmark that its table shows, the newest first."""
SIGNS = {"<=": "≤", ">=": "≥"}

Result = dict[str, Any]


def load_results(folder: Path = RESULTS) -> list[Result]:
    """Return all results of `skywright bench`, the oldest first; quick ones say nothing.

    They are named by their date; what other scripts keep there has a name of its own.
    """
    dated = sorted(folder.glob("[0-9]*.json"))
    found = [json.loads(p.read_text(encoding="utf-8")) for p in dated]
    return sorted((r for r in found if r["effort"] != "quick"), key=lambda r: r["when"])


def _number(value: float | None, unit: str = "") -> str:
    if value is None:
        return "–"
    digits = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{digits} {unit}".strip()


def _escape(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_")


def _build_measurements(results: list[Result]) -> list[str]:
    lines = [
        "## Measurements", "",
        "| | when (UTC) | commit | machine | cores | load before | Python, MuJoCo, numba |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for i, r in reversed(list(enumerate(results, 1))):
        m, v = r["machine"], r["versions"]
        commit = f"`{r['commit']['commit']}`" if r["commit"]["commit"] else "–"
        if r["commit"]["changed"]:
            commit += " and changes"
        load = _number(r["load"]["before"])
        if r["busy"]:
            load += " (**busy**: ratios hold roughly, times are unreliable)"
        cores = m["cores"] or "–"
        versions = ", ".join(v.get(n, "–") for n in ("python", "mujoco", "numba"))
        when = r["when"].replace("T", " ").removesuffix("Z")[:16]
        lines.append(
            f"| #{i} | {when} | {commit} | {_escape(m['processor'])} | {cores} | {load} "
            f"| {versions} |"
        )
    return lines


def _build_benchmark(name: str, results: list[Result]) -> list[str]:
    """The newest rows of a benchmark, and the same rows in earlier measurements."""
    rows = {
        i: {row["name"]: row for row in r["rows"] if row["name"].startswith(f"{name}.")}
        for i, r in enumerate(results, 1)
    }
    shown = [i for i in reversed(rows) if rows[i]][:HISTORY]
    known = BENCHMARKS[name].description if name in BENCHMARKS else "not measured any more"
    lines = ["", f"## {name}", "", f"{known[0].upper()}{known[1:]}: `skywright bench {name}`.", ""]
    if not shown:
        return [*lines, "No result is committed."]
    newest, earlier = shown[0], shown[1:]
    head = ["name", "limit", f"#{newest}", "quartiles", *(f"#{i}" for i in earlier), "what"]
    lines += [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for key, row in rows[newest].items():
        limit = "" if row["limit"] is None else f"{SIGNS[row['sense']]} {row['limit']:g}"
        value = _number(row["value"], row["unit"])
        if row["passed"] is False:
            value = f"**{value}** missed"
        spread = "" if row["low"] is None else f"{_number(row['low'])} to {_number(row['high'])}"
        past = [_number(rows[i].get(key, {}).get("value"), row["unit"]) for i in earlier]
        cells = [f"`{key}`", limit, value, spread, *past, _escape(row["note"])]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def build_section(results: list[Result]) -> str:
    """Return what stands between the markers."""
    names = list(BENCHMARKS)
    for r in results:
        names += [n for row in r["rows"] if (n := row["name"].split(".")[0]) not in names]
    lines = _build_measurements(results)
    for name in dict.fromkeys(names):
        lines += _build_benchmark(name, results)
    return "\n".join(lines)


def build_page(text: str, results: list[Result] | None = None) -> str:
    """Return the page with its tables made anew."""
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    section = build_section(load_results() if results is None else results)
    return head + BEGIN + "\n" + section + "\n\n" + END + tail


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
