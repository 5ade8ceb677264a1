"""Output of a comparison of two runs: a self-contained HTML page, and a table on the terminal."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from skywright.analysis.compare_runs.figures import draw_overlay
from skywright.analysis.compare_runs.overlay import Metric, Overlay
from skywright.description.dump import write_literal
from skywright.reports.figures.style import house_style
from skywright.reports.page import build_picture, link_file, render_page, write_page
from skywright.reports.terminal import new_console, new_table


def write_overlay_page(found: Overlay, path: Path) -> None:
    """Write the self-contained page; it links to the runs' reports that exist."""
    names = found.a.directory.name, found.b.directory.name
    reports = [link_file(run.directory / "report.html", path) for run in (found.a, found.b)]
    with house_style():
        picture = found.series and build_picture(
            "Over time", draw_overlay(found.series, names),
            "Both runs over the time since their start. Solid: A. Dashed: B.",
        )  # fmt: skip
    write_page(path, render_page(
        "compare_runs.html.j2", found=found, names=names, reports=reports,
        picture=picture or None, number=format_number, setting=format_setting,
    ))  # fmt: skip


def print_overlay(found: Overlay, page: Path) -> None:
    """Print the metrics and the settings that differ."""
    console = new_console()
    table = new_table(
        f"A: {found.a.directory} ({found.a.outcome}); B: {found.b.directory} ({found.b.outcome})",
        "metric", "A", "B", "B - A", "required", right=("A", "B", "B - A"),
    )  # fmt: skip
    for m in found.metrics:
        table.add_row(m.name, *map(format_number, (m.a, m.b, m.difference)), _tell(m))
    console.print(table)
    for key, a, b in found.settings:
        values = f"{key}: {format_setting(a)} | {format_setting(b)}"
        console.print(values, markup=False, highlight=False)
    console.print(f"page: {page}")


def format_number(x: float) -> str:
    """Format with four digits; a dash for a missing value."""
    return f"{x:.4g}" if math.isfinite(x) else "–"


def format_setting(value: Any) -> str:
    """Format the value of a key as TOML; None is "not set"."""
    return "not set" if value is None else write_literal(value)


def _tell(m: Metric) -> str:
    failed = [run for run, passed in zip("AB", m.passed, strict=True) if passed is False]
    return f"{m.requirement} (failed: {' and '.join(failed)})" if failed else m.requirement
