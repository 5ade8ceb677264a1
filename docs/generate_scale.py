"""Write the table of cost of docs/howto/campaign.md: `python docs/generate_scale.py`.

It comes from benchmarks/scale.json, which `python benchmarks/campaign_scale.py` wrote.
"""

from __future__ import annotations

import json
from pathlib import Path

DOCS = Path(__file__).parent
PAGE = DOCS / "howto" / "campaign.md"
KEPT = DOCS.parent / "benchmarks" / "scale.json"
BEGIN = "<!-- scale: begin, made by docs/generate_scale.py, do not edit -->"
END = "<!-- scale: end -->"


def build_table() -> str:
    """Return a line a mission."""
    found = json.loads(KEPT.read_text(encoding="utf-8"))
    n = found["planned"]
    lines = [
        f"| mission | flight (CPU s) | handing out (CPU s a run) | two workers over one | {n} "
        "workers, planned (s a run) | limited by | most useful workers |",
        "|---|---|---|---|---|---|---|",
    ]
    for m in found["missions"]:
        each, serial = m["flight_cpu_s"] / n, m["parent_cpu_s"]
        limit = "the process that hands out" if serial > each else "the flights"
        lines.append(
            f"| `{m['mission']}` | {m['flight_cpu_s']:.2f} | {m['parent_cpu_s']:.3f} | "
            f"{m['two_over_one']:.2f} | {max(each, serial):.3f} | {limit} | "
            f"{m['most_workers']} |"
        )
    lines += [
        "",
        f"Measured on {found['cores']} cores under a load of {found['load_1_min']:.0f}, workers in "
        "turns; on an idle machine two workers gain more.",
    ]
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{build_table()}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
