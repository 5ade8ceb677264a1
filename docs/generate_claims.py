"""Write the claims section of a paper's page from measured results.

    skywright reproduce tognon-2018 --json > claims.json
    python docs/generate_claims.py claims.json     (`make claims` does both)

Building the documentation flies nothing: the section is committed, with the command that makes it.
"""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

PAPERS = Path(__file__).parent / "papers"
BEGIN = "<!-- claims: begin, made by docs/generate_claims.py, do not edit -->"
END = "<!-- claims: end -->"
SIGNS = {"<=": "≤", ">=": "≥", "==": "=", "<": "<", ">": ">"}


def _number(value: float | None, unit: str) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    digits = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{digits} {unit}".strip()


def _limit(test: dict[str, Any]) -> str:
    limit = test["paper_value"] if test["bound"] is None else test["bound"]
    if limit is None:
        return "not judged"
    around = f" ± {test['tolerance']:g}" if test["tolerance"] else ""
    return f"{SIGNS[test['sense']]} {limit:g}{around} {test['unit']}".strip()


def _verdict(claim: dict[str, Any]) -> str:
    words = claim["verdict"].replace("_", " ")
    flags = [f.replace("_", " ") for f in ("by_construction", "fitted") if claim[f]]
    return f"{words} ({', '.join(flags)})" if flags else words


def _escape(text: str) -> str:
    return text.replace("|", "\\|").replace("^", "\\^").replace("*", "\\*")


def build_section(paper: str, claims: list[dict[str, Any]]) -> str:
    """Return the section between the markers as Markdown."""
    counts = {v: sum(c["verdict"] == v for c in claims) for v in
              ("reproduced", "contradicted", "not_comparable")}  # fmt: skip
    lines = [
        f"Made by `skywright reproduce {paper}`, which also draws a figure a claim "
        f"(`claims.html`). {counts['reproduced']} of {len(claims)} claims are reproduced, "
        f"{counts['contradicted']} contradicted, {counts['not_comparable']} not comparable. "
        "A verdict follows from the measured value; where the paper uses words, the bound is our "
        "reading of them. A claim that is met because its number was put in (by construction) or "
        "chosen from the figure (fitted) counts as not comparable.",
        "",
        "| claim | the paper prints | here | judged by | verdict |",
        "|---|---|---|---|---|",
    ]
    for c in claims:
        name = c["id"].split("/")[-1]
        printed = "no figure" if c["paper_value"] is None else _number(c["paper_value"], c["unit"])
        value = _number(c["value"], c["unit"])
        statement, how = _escape(c["statement"]), c["judged_by"]
        lines.append(f"| [{statement}](#{name}) | {printed} | {value} | {how} | {_verdict(c)} |")
    for c in claims:
        name = c["id"].split("/")[-1]
        lines += [
            "", f"### {name}", "",
            f"*{_escape(c['statement'])}* (section {c['where']}, judged by {c['judged_by']}): "
            f"**{_verdict(c)}**.",
            "", _escape(c["explanation"]), "",
            "| measured | value | test | bound | reading |", "|---|---|---|---|---|",
        ]  # fmt: skip
        for t in c["tests"]:
            reading = _escape(t["reading"]) or "the printed figure"
            if t["paper_value"] is None and not t["reading"]:
                reading = ""
            value = _number(t["value"], t["unit"])
            whose = {"paper": "the paper's", "ours": "ours", "": ""}[t["bound_by"]]
            lines.append(f"| `{t['quantity']}` | {value} | {_limit(t)} | {whose} | {reading} |")
    return "\n".join(lines)


def main(argv: list[str]) -> int:
    """Fill the sections of all papers that the file holds."""
    source = Path(argv[1])
    claims = json.loads(source.read_text(encoding="utf-8"))["claims"]
    for paper in sorted({c["paper"] for c in claims}):
        page = PAPERS / f"{paper}.md"
        text = page.read_text(encoding="utf-8")
        section = build_section(paper, [c for c in claims if c["paper"] == paper])
        new, count = re.subn(
            re.escape(BEGIN) + ".*?" + re.escape(END),
            lambda _, body=section: f"{BEGIN}\n\n{body}\n\n{END}",
            text, flags=re.S,
        )  # fmt: skip
        if count != 1:
            print(f"{page}: needs one pair of markers {BEGIN} ... {END}", file=sys.stderr)
            return 2
        page.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
