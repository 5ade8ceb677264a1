"""Output of a comparison: a self-contained HTML page, and tables on the terminal."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path

from rich.text import Text

from skywright.analysis.compare import figures
from skywright.analysis.compare.compare import MISSION
from skywright.analysis.compare.comparison import Comparison
from skywright.description.loader import load_description
from skywright.description.world.spec import Pipe
from skywright.reports.figures.style import house_style
from skywright.reports.page import build_picture, render_page, write_page
from skywright.reports.terminal import new_console, new_table
from skywright.run.versions import collect_versions

STYLES = {"holds": "green", "partly": "yellow", "does not hold": "red"}
VERDICTS = {"holds": "good", "does not hold": "bad", "partly": "open"}


def _count(verdicts: Sequence[str]) -> str:
    """Count the verdicts as text."""
    plural = {"holds": "hold", "does not hold": "do not hold", "does not apply": "do not apply"}
    found = Counter(verdicts).most_common()
    return ", ".join(f"{n} {plural.get(v, v) if n != 1 else v}" for v, n in found)


def tell_step(text: str) -> None:
    """Print the current measurement to stderr."""
    print(f"  {text}", file=sys.stderr, flush=True)


def write_compare_page(c: Comparison, path: Path) -> None:
    """Write compare.html, a self-contained page. Raises InputError if it cannot be written."""
    pipe = load_description(MISSION, sets=list(c.fixed)).world.pipe
    assert pipe is not None
    write_page(path, render_compare_page(c, pipe, collect_versions()))


def render_compare_page(c: Comparison, pipe: Pipe, versions: Mapping[str, str]) -> str:
    """Return the HTML of the page."""
    with house_style():
        pictures = [
            build_picture(
                "At the pipe", figures.draw_pair(c, pipe),
                "Both robots from the side with a hand at the underside of the pipe (grey disc). "
                "Light blue: propellers; dark: booms and landing gear; coloured: the left arm and "
                "the bodies that carry it.",
            ),
            build_picture(
                "Approach", figures.draw_clearance(c),
                "Smallest distance of propellers and landing gear to the pipe along the "
                    "planned path of the mission sensor-install.",
            ),
            build_picture(
                "Workspace of a hand", figures.draw_reach(c),
                "Cross-section of the pipe, the robot facing to the right. Green: a posture and a "
                "position of the platform exist in which a hand is at the point and all distances "
                "are kept (platform 0.1 m, arms and link 0.02 m). Red: every posture brings some "
                "part too close to the pipe. White: the point is too close to the pipe for a hand "
                "that does not touch. The rim of the pipe shows the same for touching it. From the "
                "other side the picture is mirrored; the percentages count both sides.",
            ),
            build_picture(
                "Effect of a hand force on the platform", figures.draw_reaction(c),
                "Torque about the platform's centre for each newton on the left hand (N m/N), over "
                "the direction of the force, with one colour scale. Every arm transmits the whole "
                "force. A passive joint transmits no torque about its own axis: about pitch only "
                "the lever between joint and centre remains (below). About roll the lever is "
                "longer.",
            ),
            build_picture(
                "Rotation of the passive link by a hand force", figures.draw_recoil(c),
                "Angle by which the link turns until its weight balances 2 N on the left hand, "
                "over the direction of the force; the hand moves with it.",
            ),
            build_picture(
                "Collision at 0.5 m/s", figures.draw_collisions(c),
                "Largest torque and force of arms or link on the platform (1 kHz), and "
                    "the tilt afterwards, in the mission impact. Labels name the impacting "
                    "part.",
            ),
            build_picture(
                "Accuracy in wind", figures.draw_accuracy(c),
                "Hover with the arms in working posture in gusty wind (Dryden). Each dot "
                    "is a flight.",
            ),
        ]  # fmt: skip
    return render_page(
        "compare.html.j2",
        c=c,
        zip=zip,
        names=[s.name for s in c.sides],
        descriptions=[s.robot.description for s in c.sides],
        groups=[(name, list(rows)) for name, rows in groupby(c.rows, key=lambda r: r.group)],
        pictures=[p for p in pictures if p],
        style=VERDICTS,
        verdicts=_count([s.verdict for s in c.statements]),
        versions=versions,
    )


def print_comparison(c: Comparison, page: Path) -> None:
    """Print both tables and the path of the page."""
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
        console.print(note)
    table = new_table("Suarez 2020, table 3", "about", "statement", "")
    for s in c.statements:
        table.add_row(s.about, s.text, Text(s.verdict, STYLES.get(s.verdict, "")))
    console.print(table)
    console.print(str(page))
