"""Common functions of all pages: embedded pictures, templates, writing."""

import base64
import html
import os
import re
import shlex
import sys
from contextlib import suppress
from datetime import UTC, datetime
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple, overload
from urllib.parse import quote

import jinja2
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from skywright.errors import InputError
from skywright.reports.figures.interactive import PLAIN, build_plot
from skywright.reports.figures.style import WIDTH, render_svg


class Picture(NamedTuple):
    """A figure of a page."""

    title: str
    data: str  # data: URI
    caption: str
    width: float  # share of the page
    plot: str = ""  # panels over time for templates/plots.js


@overload
def build_picture(
    title: str, figure: Figure, caption: str, group: str = "", clock: str = PLAIN
) -> Picture: ...
@overload
def build_picture(
    title: str, figure: None, caption: str, group: str = "", clock: str = PLAIN
) -> None: ...
@overload
def build_picture(
    title: str, figure: Figure | None, caption: str, group: str = "", clock: str = PLAIN
) -> Picture | None: ...
def build_picture(
    title: str, figure: Figure | None, caption: str, group: str = "", clock: str = PLAIN
) -> Picture | None:
    """Return a figure as a picture of a page; None without a figure.

    The page can zoom a figure whose panels are all over time (in s), together with those of the
    same `group`, such as one flight; in print, the picture is used. `clock` is the time that the
    label "time (s)" stands for.
    """
    if figure is None:
        return None
    data = base64.b64encode(render_svg(figure)).decode("ascii")
    width = float(figure.get_size_inches()[0]) / WIDTH
    plot = build_plot(figure, group, clock)
    return Picture(title, f"data:image/svg+xml;base64,{data}", caption, width, plot)


def render_page(template: str, **values: object) -> str:
    """Fill `reports/templates/<template>`; a missing value is an error.

    Every heading gets an id; an empty <nav> becomes the table of contents. `written` defaults to
    the current time, `command` to the command that runs.
    """
    values = {"written": write_time(datetime.now(UTC)), "command": tell_command(), **values}
    page = add_contents(_load_template(template).render(values))
    if '<script type="application/json"' not in page:
        return page
    style, licence, library, ours = (
        (files("skywright.reports") / name).read_text(encoding="utf-8")
        for name in ("vendor/uPlot.min.css", "vendor/uPlot.LICENSE", "vendor/uPlot.iife.min.js",
                     "templates/plots.js")
    )  # fmt: skip
    code = (
        f"<style>{style}</style>\n<!-- uPlot: {licence}-->\n<script>{library}</script>\n"
        f"<script>\n{ours}</script>\n"
    )
    return page.replace("</body>", f"{code}</body>")


def tell_command() -> str:
    """Return the command that this process runs, as typed: of `skywright`, or of a Python script.

    Other programs, such as notebooks, give "".
    """
    program = Path(sys.argv[0])
    name = program.parent.name if program.name == "__main__.py" else program.stem
    if name == "skywright":
        return shlex.join(["skywright", *sys.argv[1:]])
    is_script = program.suffix == ".py" and name == program.stem
    is_script = is_script and not name.endswith(("_launcher", "_worker"))  # notebooks, Ray
    return shlex.join(["python", *sys.argv]) if is_script else ""


def write_time(t: datetime) -> str:
    """Format date and time (UTC) to the second."""
    return t.astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def break_key(name: str) -> Markup:
    """Return a dotted key with line breaks allowed after its dots and underscores."""
    return Markup(re.sub(r"([._/])", r"\1<wbr>", str(escape(name))))


def link_file(file: Path, page: Path) -> str:
    """Return the link from a page to a file, relative to the page; "" if the file is missing."""
    if not file.is_file():
        return ""
    return quote(Path(os.path.relpath(file.resolve(), page.resolve().parent)).as_posix())


def add_contents(page: str) -> str:
    """Give headings ids, and list them in the empty <nav>."""
    items: list[str] = []
    names: list[str] = []

    def mark(found: re.Match[str]) -> str:
        level, given, inner = found.groups()
        text = re.sub(r"<[^>]*>", "", inner).strip()
        base = re.sub(r"[^a-z0-9]+", "-", html.unescape(text).lower()).strip("-")
        again = f"-{names.count(base) + 1}" if base in names else ""
        names.append(base)
        name = given or base + again
        items.append(f'<li class="level{level}"><a href="#{name}">{text}</a></li>')
        return f'<h{level} id="{name}">{inner}</h{level}>'

    page = re.sub(r'<h([23])(?: id="([^"]*)")?>(.*?)</h\1>', mark, page, flags=re.DOTALL)
    nav = "\n".join(items)
    return page.replace("<nav></nav>", f'<nav aria-label="Contents"><ul>\n{nav}</ul></nav>', 1)


def write_page(path: Path, text: str) -> None:
    """Write a page atomically. Raises InputError if it cannot be written."""
    partial = path.with_name(path.name + ".partial")
    try:  # a temporary file first: a full disk leaves an earlier page intact
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
    environment.filters["key"] = break_key
    return environment.get_template(name)
