"""Write the tables of docs/reference/laws.md: `python docs/generate_laws.py`.

Rows come from benchmarks/laws: laws.toml says what is flown, NAME.json how it went.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
PAGE = DOCS / "reference" / "laws.md"
KEPT = DOCS.parent / "benchmarks" / "laws"
BEGIN = "<!-- laws: begin, made by docs/generate_laws.py, do not edit -->"
END = "<!-- laws: end -->"
RUNS = 10
"""Flights of a law in a case that benchmarks/fly_laws.py flies by default."""


def tell_number(x: float | None) -> str:
    """Three digits, or a dash."""
    return "–" if x is None else f"{x:.3g}"


def build_table(name: str, asked: dict[str, Any]) -> str:
    """Return one comparison: a line a law and case."""
    found = json.loads((KEPT / f"{name}.json").read_text(encoding="utf-8"))
    shown = asked["shown"]
    runs = max(f["runs"] for f in found["flown"])
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
    for law in asked["laws"]:
        for f in (f for f in found["flown"] if f["law"] == law):
            if f["refused"]:
                lines.append(f"| `{law}` | {f['case']} | refused |" + " – |" * len(shown))
                continue
            cells = [
                ("**{}**" if (law, f["case"], m) in beyond else "{}").format(
                    tell_number(f["medians"].get(m))
                )
                for m in shown
            ]
            done = f"{f['succeeded']} of {f['runs']}"
            lines.append(f"| `{law}` | {f['case']} | {done} | {' | '.join(cells)} |")
    refused = {f["law"]: f["refused"] for f in found["flown"] if f["refused"]}
    lines += ["", *(f"`{law}`: {why}." for law, why in refused.items())]
    return "\n".join(lines).rstrip()


def build_page(text: str) -> str:
    """Return the page with its tables made anew."""
    head, rest = text.split(BEGIN)
    asked = tomllib.loads((KEPT / "laws.toml").read_text(encoding="utf-8"))
    tables = [build_table(n, a) for n, a in asked.items() if (KEPT / f"{n}.json").is_file()]
    body = "\n\n".join(tables)
    return f"{head}{BEGIN}\n\n{body}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
