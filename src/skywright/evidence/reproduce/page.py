"""The page of a paper's claims: one HTML file that opens offline, with a figure a claim."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from skywright.evidence.reproduce.figures import ClaimFigure, draw_claim
from skywright.reports.figures.style import WIDTH, house_style, render_svg
from skywright.reports.page import render_page, write_page


class CriterionRow(NamedTuple):
    """A test as it is written on the page."""

    name: str
    value: str
    limit: str
    reading: str
    state: str  # met, failed, or nothing


class ClaimRow(NamedTuple):
    """A claim as it is written on the page."""

    name: str
    where: str
    statement: str
    paper: str
    value: str
    verdict: str
    explanation: str
    tests: Sequence[CriterionRow]
    figure: ClaimFigure | None


class Heading(NamedTuple):
    """What the page says about the paper and how it was made."""

    short: str
    title: str
    reference: str
    summary: str
    command: str
    flights: str
    notes: Sequence[str]


Parts = Sequence[tuple[Heading, Sequence[ClaimRow]]]
"""One heading with its claims a paper."""


def write_claims_page(path: Path, parts: Parts, versions: Mapping[str, str]) -> None:
    """Write claims.html. Raises InputError when it cannot be written."""
    write_page(path, render_claims_page(parts, versions))


def render_claims_page(parts: Parts, versions: Mapping[str, str]) -> str:
    """Return the page; everything that it shows is inside it."""
    with house_style():
        papers = [{**h._asdict(), "claims": [_fill(row) for row in rows]} for h, rows in parts]
    return render_page("claims.html.j2", papers=papers, versions=versions)


def _fill(row: ClaimRow) -> dict[str, object]:
    if row.figure is None:
        return {**row._asdict(), "figure": "", "caption": "", "width": 100}
    data, width = _embed(row.figure)
    return {**row._asdict(), "figure": data, "caption": row.figure.caption, "width": width}


def _embed(data: ClaimFigure) -> tuple[str, int]:
    """A figure as a data: URI, and its share of the page in per cent."""
    figure = draw_claim(data)
    text = base64.b64encode(render_svg(figure)).decode("ascii")
    width = round(100.0 * float(figure.get_size_inches()[0]) / WIDTH)
    return f"data:image/svg+xml;base64,{text}", width
