"""Write the table in docs/reference/metrics.md from the report's list of metrics.

python docs/generate_metrics.py     (a test holds the page equal to it)
"""

from __future__ import annotations

from pathlib import Path

from skywright.core.find import list_kinds
from skywright.run.kind import load_kind
from skywright.run.names import COMMON, list_all_measures
from skywright.run.where import find_where

PAGE = Path(__file__).parent / "reference" / "metrics.md"
BEGIN, END = "<!-- metrics -->\n", "<!-- end of metrics -->\n"


def describe_where(name: str) -> str:
    """Return the phases in which a metric is measured, by kind where kinds differ."""
    kinds: dict[str, list[str]] = {}
    for kind_name in list_kinds("kind"):
        kind = load_kind(kind_name)
        text = find_where(name, kind.where).text
        if text and (name in COMMON or name in kind.measures):
            kinds.setdefault(text, []).append(kind_name)
    if len(kinds) == 1:
        return next(iter(kinds))
    by_kind = [(names, text) for text, names in kinds.items() if text != find_where(name, {}).text]
    return "; ".join(f"{', '.join(names)}: {text}" for names, text in by_kind)


def build_page(text: str) -> str:
    """Return the page with its table made anew."""
    head, rest = text.split(BEGIN)
    tail = rest.split(END)[1]
    rows = [
        f"| `{name}` | {unit} | {meaning} | {describe_where(name)} |"
        for name, (unit, meaning) in list_all_measures().items()
    ]
    table = "\n".join(["| name | unit | meaning | measured in |", "|---|---|---|---|", *rows])
    return head + BEGIN + "\n" + table + "\n\n" + END + tail


if __name__ == "__main__":
    PAGE.write_text(build_page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
