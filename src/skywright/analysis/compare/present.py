"""A comparison on the terminal and on its page."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.text import Text

from skywright.analysis.compare.compare import MISSION
from skywright.analysis.compare.comparison import Comparison
from skywright.analysis.compare.report import write_compare_page
from skywright.description.loader import load_description
from skywright.reports.terminal import new_console, new_table
from skywright.run.run import collect_versions

STYLES = {"holds": "green", "partly": "yellow", "does not hold": "red"}


def tell_step(text: str) -> None:
    """Say on stderr what is being measured."""
    print(f"  {text}", file=sys.stderr, flush=True)


def write_page(c: Comparison, path: Path) -> None:
    """Write compare.html."""
    pipe = load_description(MISSION, sets=list(c.fixed)).world.pipe
    assert pipe is not None
    write_compare_page(path, c, pipe, collect_versions())


def print_comparison(c: Comparison, page: Path) -> None:
    """Print both tables and the page's place."""
    console = new_console()
    names = [s.name for s in c.sides]
    table = new_table("", "", names[0], names[1], "unit", right=(names[0], names[1]))
    group = ""
    for r in c.rows:
        if r.group != group:
            group = r.group
            table.add_row(Text(group, "bold"), "", "", "")
        cells = [Text(r.write(i), "green" if r.winner == i else "") for i in (0, 1)]
        table.add_row(f"  {r.title}", *cells, r.unit)
    console.print(table)
    notes = {
        f"{name}: {note}": None
        for r in c.rows for name, note in zip(names, r.notes, strict=True) if note
    }  # fmt: skip
    for note in notes:
        console.print(note, markup=False)
    table = new_table("Suarez 2020, table 3", "about", "statement", "")
    for s in c.statements:
        table.add_row(s.about, s.text, Text(s.verdict, STYLES.get(s.verdict, "")))
    console.print(table)
    console.print(str(page), markup=False)
