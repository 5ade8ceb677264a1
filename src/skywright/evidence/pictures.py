"""Pictures of runs in README and docs: `python -m skywright.evidence.pictures`.

The missions are flown and the figures are those of their reports, so the pictures match the code.
"""

import math
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from skywright.analysis.compare.compare import MISSION, compare_robots
from skywright.analysis.compare.figures import draw_pair, draw_reach, draw_reaction
from skywright.analysis.locate.demo import write_demo
from skywright.analysis.locate.figures import draw_errors
from skywright.analysis.locate.locate import locate
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError, SkywrightError
from skywright.evidence.command import Command
from skywright.missions.skills.plan_flight import load_plan_description
from skywright.models.capability import compute_capability
from skywright.reports.capability import write_capability_figure
from skywright.reports.figures.style import house_style, write_png
from skywright.reports.moving import write_moving_scan, write_still
from skywright.reports.progress import Progress, announce_compilation
from skywright.reports.render import Camera
from skywright.reports.report import list_figures
from skywright.run.result import RunResult
from skywright.run.run import run_mission

PICTURES: dict[str, tuple[str, str]] = {
    "contact-series.png": ("pipe-weld-scan", "contact_series"),
    "flight-path.png": ("pipe-weld-scan", "flight_path"),
}
"""File -> mission and figure of its report."""

MOVING = {"weld-scan.webp": "pipe-weld-scan"}
"""File -> mission of the animated scan."""


class Shot(NamedTuple):
    """Time and camera of a still of a mission.

    `share` is the elapsed share (0 to 1) of the phase. The camera is at `distance` (m) in the
    direction `side` in W from the point that it looks at, `offset` (m, in W) from the robot's
    centre.
    """

    phase: str
    share: float = 0.5
    side: tuple[float, float, float] = (-0.8, -1.0, 0.3)
    distance: float = 3.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


SHOTS = {
    "arm-test-bench": Shot("hold 4 N", side=(-0.6, -1.0, 0.3), distance=2.2),
    "bar-insertion": Shot("insert", 0.9, offset=(0.1, 0.0, -0.1)),
    "bar-transport": Shot("transport", 0.55, (-0.3, -1.0, 0.3), 8.0, (0.3, 0.0, -0.2)),
    "bimanual-bench": Shot("hold box", distance=2.6, offset=(0.2, 0.0, -0.1)),
    "bridge-contact": Shot("hold 5 N", side=(-0.8, -1.0, -0.15), distance=3.6),
    "crack-scan": Shot("scan", 0.6, (-0.75, -0.75, 0.35), 3.0, (0.5, 0.0, 0.0)),
    "excitation": Shot("excite working", 0.3, distance=2.6),
    "flight-modes": Shot("hold angle", side=(-0.3, -1.0, 0.2), distance=2.8),
    "follow-plan": Shot("plan", 0.55, (-0.3, -1.0, 0.3), 8.0, (0.3, 0.0, -0.2)),
    "impact": Shot("impact", 0.1, (-0.6, -1.0, 0.2), 3.8, (0.2, 0.0, -0.45)),
    "pipe-weld-scan": Shot("scan", 0.98, (-0.75, -0.75, 0.35), 3.0, (0.5, 0.0, 0.0)),
    "sensor-install": Shot("force", 0.8, (-1.0, -0.7, 0.2), 3.8, (0.0, 0.0, -0.45)),
    "tool-install": Shot("install", 0.9, offset=(0.1, 0.0, 0.0)),
    "thickness-survey": Shot("free press to 3 N", 0.9, distance=3.0),
    "wall-contact": Shot("slide", distance=3.4),
    "waypoints": Shot("waypoint 2", distance=2.8, side=(-0.8, -1.0, 0.4)),
}
"""Mission -> its still, docs/images/missions/MISSION.webp."""

PLANNED = "bar-transport"
"""Mission whose plan file `follow-plan` flies; it must be flown before."""

ROBOTS = {"capability-othex.png": "othex"}
"""File -> robot of the capability figure."""

PAIR = ("bimanual", "bimanual-longreach")
"""Robots of the comparison figures."""

LOCATED = "locate-demo-errors.png"

COMPARED = ("compare-pair.png", "compare-reach.png", "compare-reaction.png")


def draw_run(mission: str, result: RunResult, folder: Path) -> Iterable[Path]:
    """Write the pictures of one run; yield their paths."""
    yield write_shot(SHOTS[mission], result, folder / "missions" / f"{mission}.webp")
    figures = list_figures(result.description.mission.kind)
    for name, (shown, figure) in PICTURES.items():
        if shown == mission:
            yield write_png(figures[figure], result, folder / name)
    for name, shown in MOVING.items():
        if shown == mission:
            yield write_moving_scan(result, folder / name)


def write_shot(shot: Shot, result: RunResult, path: Path) -> Path:
    """Write the still of a run. Raises InputError if its phase was not flown."""
    phase = next((p for p in result.phases if p.name == shot.phase), None)
    if phase is None:
        raise InputError(f"{path.name}: the run has no phase {shot.phase!r}")
    t = phase.start_s + shot.share * (phase.end_s - phase.start_s)
    row = result.samples[np.searchsorted(result.samples["t"], t)]
    look, side = np.array(row["p_WB"]) + shot.offset, np.array(shot.side)
    place = look + shot.distance * side / np.linalg.norm(side)
    return write_still(result, t, Camera(place, look, math.radians(30.0)), path)


def write_pictures(folder: Path, say: Callable[[str], None] = print) -> list[Path]:
    """Fly the missions and write all pictures into `folder`; return their paths."""
    (folder / "missions").mkdir(parents=True, exist_ok=True)
    written = []
    announce_compilation()
    with tempfile.TemporaryDirectory() as scratch:
        for mission in SHOTS:
            description = (
                load_plan_description(Path(scratch) / PLANNED / "plan.csv")
                if mission == "follow-plan"
                else load_description(mission)
            )
            out = Path(scratch) / mission
            result = run_mission(description, out=out, observers=[Progress()])
            for path in draw_run(mission, result, folder):
                written.append(path)
                say(str(path))
    pair = compare_robots(*PAIR, fly=False)
    pipe = load_description(MISSION).world.pipe
    assert pipe is not None
    with house_style():
        drawn = (draw_pair(pair, pipe), draw_reach(pair), draw_reaction(pair))
        for name, drawing in zip(COMPARED, drawn, strict=True):
            drawing.savefig(folder / name, dpi=110, metadata={"Software": None})
            written.append(folder / name)
            say(str(written[-1]))
    written.append(write_errors(folder / LOCATED))
    say(str(written[-1]))
    for name, robot in ROBOTS.items():
        spec, _ = load_robot(robot)
        written.append(write_capability_figure(compute_capability(spec), folder / name))
        say(str(written[-1]))
    return written


def write_errors(path: Path) -> Path:
    """Write the errors of the demonstration of `skywright locate`; return `path`."""
    with tempfile.TemporaryDirectory() as scratch, house_style():
        station, camera, truth = write_demo(Path(scratch))
        found = locate([str(station), str(camera)], reference=str(truth), compare="none")
        draw_errors(found).savefig(path, dpi=110, metadata={"Software": None})
    return path


@click.command("pictures", cls=Command)
@click.option("--out", type=click.Path(path_type=Path), default=Path("docs/images"), help="Folder.")
def main(out: Path) -> None:
    """Make the pictures of README and docs."""
    try:
        write_pictures(out)
    except (SkywrightError, OSError) as error:
        raise SystemExit(f"pictures: {error}") from None


if __name__ == "__main__":
    main()
