"""Write the table of docs/howto/betaflight.md from benchmarks/betaflight.csv.

python docs/generate_betaflight.py     (a test holds the page equal to it)
"""

from __future__ import annotations

import csv
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "howto" / "betaflight.md"
KEPT = ROOT / "benchmarks" / "betaflight.csv"
BEGIN, END = "<!-- flights -->\n", "<!-- end of flights -->\n"


def build_table() -> str:
    """Return the table of the flights."""
    with KEPT.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    lines = [
        "| robot | seed | outcome | hover, rms | after the step, rms | overshoot "
        "| tilt in hover, rms | factor of real time |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        lines.append(
            f"| `{r['robot']}` | {r['seed']} | {r['outcome']} "
            f"| {1e3 * float(r['hover_rms_m']):.0f} mm "
            f"| {1e3 * float(r['step_rms_m']):.0f} mm | {100 * float(r['overshoot_m']):.0f} cm "
            f"| {float(r['tilt_rms_deg']):.1f}° | {float(r['real_time_factor']):.2f} |"
        )
    firmware = sorted({r["firmware"] for r in rows if r["firmware"]})
    return "\n".join([*lines, "", f"Firmware: {'; '.join(firmware)}."])


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return head + BEGIN + "\n" + build_table() + "\n\n" + END + rest.split(END)[1]


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text("utf-8")), encoding="utf-8")
