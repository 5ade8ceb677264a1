"""Write the table in docs/reference/metrics.md from the report's list of metrics.

python docs/generate_metrics.py     (a test holds the page equal to it)
"""

from __future__ import annotations

from pathlib import Path

from skywright.run.names import list_all_measures

PAGE = Path(__file__).parent / "reference" / "metrics.md"
BEGIN, END = "<!-- metrics -->\n", "<!-- end of metrics -->\n"


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    rows = [
        f"| `{name}` | {unit} | {meaning} |"
        for name, (unit, meaning) in list_all_measures().items()
    ]
    table = "\n".join(["| name | unit | meaning |", "|---|---|---|", *rows])
    return head + BEGIN + "\n" + table + "\n\n" + END + tail


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
