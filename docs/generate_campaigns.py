"""Write the campaigns of docs/reference/benchmarks.md: `python docs/generate_campaigns.py`.

Rows come from benchmarks/campaigns: campaigns.toml says what is flown, NAME.json how it went.
"""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
PAGE = DOCS / "reference" / "benchmarks.md"
KEPT = DOCS.parent / "benchmarks" / "campaigns"
BEGIN = "<!-- campaigns: begin, made by docs/generate_campaigns.py, do not edit -->"
END = "<!-- campaigns: end -->"


def tell_result(name: str, campaign: dict[str, Any]) -> tuple[str, str]:
    """Return what a campaign reached, and at which commit."""
    path = KEPT / f"{name}.json"
    if not path.is_file():
        return campaign["noted"], "–"
    result = json.loads(path.read_text(encoding="utf-8"))
    if result["flags"] != campaign["flags"]:
        raise SystemExit(f"{path}: flown with other flags: {result['flags']}; fly it again")
    others = Counter(other["outcome"] for other in result["others"])
    told = f"{result['succeeded']} of {result['runs']}"
    if others:
        told += f" ({', '.join(f'{n} {what}' for what, n in sorted(others.items()))})"
    return told, f"`{result['commit']}`, {result['when']}"


def build_table() -> str:
    """One line a campaign."""
    lines = [
        "| task | met every requirement | target | commit | command |",
        "|---|---|---|---|---|",
    ]
    campaigns = tomllib.loads((KEPT / "campaigns.toml").read_text(encoding="utf-8"))
    for name, campaign in campaigns.items():
        told, commit = tell_result(name, campaign)
        target = f"{campaign['target']} %" if "target" in campaign else "–"
        command = f"`skywright campaign {campaign['flags']}`"
        lines.append(f"| {campaign['task']} | {told} | {target} | {commit} | {command} |")
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{build_table()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
