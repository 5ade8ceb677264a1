"""The page of a comparison: one HTML file that opens offline."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path

import jinja2
from matplotlib.figure import Figure

from skywright.errors import InputError
from skywright.evaluation.comparison import Comparison
from skywright.reports.figures import compare as figures
from skywright.reports.figures.style import WIDTH, house_style, render_svg
from skywright.reports.report import Picture
from skywright.worlds.spec import Pipe

VERDICTS = {"holds": "good", "does not hold": "bad", "partly": "open"}


def write_compare_page(path: Path, c: Comparison, pipe: Pipe, versions: Mapping[str, str]) -> None:
    """Write the page. Raises InputError when it cannot be written."""
    try:
        path.write_text(render_compare_page(c, pipe, versions), encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None


def render_compare_page(c: Comparison, pipe: Pipe, versions: Mapping[str, str]) -> str:
    """Return the page; everything that it shows is inside it."""
    with house_style():
        pictures = [
            _picture(
                "At the pipe", figures.draw_pair(c, pipe),
                "Both robots from the side with a hand at the underside of the pipe (grey disc). "
                "Blue lines are propellers.",
            ),
            _picture(
                "On the way there", figures.draw_clearance(c),
                "Least distance of propellers and landing gear to the pipe along the planned way "
                "of the mission sensor-install, flown or not.",
            ),
            _picture(
                "Where a hand can be", figures.draw_reach(c),
                "Cross-section of the pipe, the robot facing to the right. Green: some posture "
                "and place of the platform brings a hand there with all distances kept (platform "
                "0.1 m, arms and link 0.02 m); red: none does. Dots: the same for touching the "
                "surface. From the other side the picture is mirrored; the percentages count both.",
            ),
            _picture(
                "What a force on a hand does to the platform", figures.draw_reaction(c),
                "Torque about the platform's centre for each newton on the left hand (N m/N), over "
                "the direction of the force, one colour scale. The force itself arrives whole, "
                "with every arm. A passive joint lets no torque about its own axis through: "
                "below, what is left about pitch is the lever between joint and centre. About roll "
                "the longer lever counts.",
            ),
            _picture(
                "How far a force turns the passive link", figures.draw_recoil(c),
                "Angle by which the link turns until its weight balances 2 N on the left hand, "
                "over the direction of the force; the hand moves with it.",
            ),
            _picture(
                "Collision with a hand at 0.5 m/s", figures.draw_collisions(c),
                "Largest torque and force of arms or link on the platform (1 kHz), and how far it "
                "tilts afterwards; mission impact.",
            ),
            _picture(
                "Accuracy in wind", figures.draw_accuracy(c),
                "Hovering with the arms at work in gusty wind (Dryden); each dot is a flight.",
            ),
        ]  # fmt: skip
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("skywright.reports"), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    return environment.get_template("compare.html.j2").render(
        c=c,
        zip=zip,
        names=[s.name for s in c.sides],
        descriptions=[s.robot.description for s in c.sides],
        groups=[(name, list(rows)) for name, rows in groupby(c.rows, key=lambda r: r.group)],
        pictures=[p for p in pictures if p],
        style=VERDICTS,
        versions=versions,
    )


def _picture(title: str, figure: Figure | None, caption: str) -> Picture | None:
    if figure is None:
        return None
    data = base64.b64encode(render_svg(figure)).decode("ascii")
    width = float(figure.get_size_inches()[0]) / WIDTH
    return Picture(title, f"data:image/svg+xml;base64,{data}", caption, width)
