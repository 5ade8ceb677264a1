"""Write the table of docs/howto/import-a-robot.md from benchmarks/imported_models.csv.

python docs/generate_imports.py     (a test holds the page equal to it)
"""

from __future__ import annotations

import csv
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "howto" / "import-a-robot.md"
KEPT = ROOT / "benchmarks" / "imported_models.csv"
BEGIN, END = "<!-- models -->\n", "<!-- end of models -->\n"


def build_table() -> str:
    """Return the table of the models."""
    with KEPT.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    names = {
        "model": "model", "from": "from", "format": "format", "bodies": "bodies",
        "rotors": "rotors", "joints": "joints", "gripper": "gripper",
        "meshes": "meshes in the file",
        "drawn": "drawn as", "not_read": "mesh files not read", "outcome": "outcome",
        "deviation": "largest deviation", "commit": "commit",
    }  # fmt: skip
    lines = ["| " + " | ".join(names.values()) + " |", "|" + "---|" * len(names)]
    lines += ["| " + " | ".join(row[key] for key in names) + " |" for row in rows]
    return "\n".join(lines)


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    return head + BEGIN + "\n" + build_table() + "\n\n" + END + rest.split(END)[1]


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text("utf-8")), encoding="utf-8")
