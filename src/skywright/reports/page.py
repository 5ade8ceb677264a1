"""What every page shares: pictures inside it, one way to fill its template, one to write it."""

import base64
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, overload

import jinja2
from matplotlib.figure import Figure

from skywright.errors import InputError
from skywright.reports.figures.style import WIDTH, render_svg


class Picture(NamedTuple):
    """A figure of a page."""

    title: str
    data: str  # data: URI
    caption: str
    width: float  # share of the page


@overload
def build_picture(title: str, figure: Figure, caption: str) -> Picture: ...
@overload
def build_picture(title: str, figure: None, caption: str) -> None: ...
@overload
def build_picture(title: str, figure: Figure | None, caption: str) -> Picture | None: ...
def build_picture(title: str, figure: Figure | None, caption: str) -> Picture | None:
    """Return a figure as a picture of a page, or None where there is none."""
    if figure is None:
        return None
    data = base64.b64encode(render_svg(figure)).decode("ascii")
    width = float(figure.get_size_inches()[0]) / WIDTH
    return Picture(title, f"data:image/svg+xml;base64,{data}", caption, width)


def render_page(template: str, **values: object) -> str:
    """Fill `reports/templates/<template>`; a value that it lacks is an error."""
    return _load_template(template).render(values)


def write_page(path: Path, text: str) -> None:
    """Write a page whole or not at all. Raises InputError when it cannot be written."""
    partial = path.with_name(path.name + ".partial")
    try:  # under another name first: a full disk leaves an earlier page whole
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink()
        if isinstance(error, OSError):
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
        raise


@lru_cache
def _load_template(name: str) -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("skywright.reports"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(name)
