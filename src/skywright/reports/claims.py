"""The page of a paper's claims: one HTML file that opens offline, with a figure a claim."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import jinja2

from skywright.errors import InputError
from skywright.reports.figures.claims import ClaimFigure, draw_claim
from skywright.reports.figures.style import WIDTH, house_style, render_svg


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
    text = render_claims_page(parts, versions)
    partial = path.with_name(path.name + ".partial")
    try:  # under another name first: a full disk leaves an earlier page whole
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None


def render_claims_page(parts: Parts, versions: Mapping[str, str]) -> str:
    """Return the page; everything that it shows is inside it."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("skywright.reports"), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    with house_style():
        papers = [{**h._asdict(), "claims": [_fill(row) for row in rows]} for h, rows in parts]
    return environment.get_template("claims.html.j2").render(papers=papers, versions=versions)


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
