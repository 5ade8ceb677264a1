"""Every picture of README and docs that shows a run: `python -m skywright.evidence.pictures`.

The missions are flown and the figures are those of their reports, so a picture never shows what
the code no longer does.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

import click

from skywright.analysis.compare.compare import MISSION, compare_robots
from skywright.analysis.compare.figures import draw_pair, draw_reach, draw_reaction
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.errors import SkywrightError
from skywright.models.capability import compute_capability
from skywright.reports.capability import write_capability_figure
from skywright.reports.figures.style import house_style, write_png
from skywright.reports.progress import Progress, announce_compilation
from skywright.reports.report import list_figures
from skywright.run.run import RunResult, run_mission

PICTURES: dict[str, tuple[str, str]] = {
    "weld-scan.png": ("pipe-weld-scan", "hero"),
    "contact-series.png": ("pipe-weld-scan", "contact_series"),
    "flight-path.png": ("pipe-weld-scan", "flight_path"),
}
"""File -> mission and the figure of its report."""

ROBOTS = {"capability-othex.png": "othex"}
"""File -> robot whose capability it shows."""

PAIR = ("bimanual", "bimanual-longreach")
"""Robots whose comparison is shown."""

COMPARED = ("compare-pair.png", "compare-reach.png", "compare-reaction.png")


def write_pictures(folder: Path, say: Callable[[str], None] = print) -> list[Path]:
    """Fly the missions and write all pictures into `folder`; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    announce_compilation()
    with tempfile.TemporaryDirectory() as scratch:
        runs: dict[str, RunResult] = {}
        for name, (mission, figure) in PICTURES.items():
            if mission not in runs:
                description = load_description(mission)
                out = Path(scratch) / mission
                runs[mission] = run_mission(description, out=out, observers=[Progress()])
            figures = list_figures(runs[mission].description.mission.kind)
            written.append(write_png(figures[figure], runs[mission], folder / name))
            say(str(written[-1]))
    pair = compare_robots(*PAIR, fly=False)
    pipe = load_description(MISSION).world.pipe
    assert pipe is not None
    with house_style():
        drawn = (draw_pair(pair, pipe), draw_reach(pair), draw_reaction(pair))
        for name, drawing in zip(COMPARED, drawn, strict=True):
            drawing.savefig(folder / name, dpi=110, metadata={"Software": None})
            written.append(folder / name)
            say(str(written[-1]))
    for name, robot in ROBOTS.items():
        spec, _ = load_robot(robot)
        written.append(write_capability_figure(compute_capability(spec), folder / name))
        say(str(written[-1]))
    return written


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("docs/images"), help="Folder.")
def main(out: Path) -> None:
    """Make the pictures of README and docs."""
    try:
        write_pictures(out)
    except (SkywrightError, OSError) as error:
        raise SystemExit(f"pictures: {error}") from None


if __name__ == "__main__":
    main()
