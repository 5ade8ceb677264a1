"""The picture of one run in one glance: the robot at work, and the weld map that comes out."""

from matplotlib.figure import Figure

from skywright.inspection.weld import WeldResult
from skywright.reports.figures.style import new_figure
from skywright.reports.still import render_run
from skywright.reports.weld_map import draw_weld_map
from skywright.run.run import RunResult

DPI = 125


def draw_hero(result: RunResult) -> Figure | None:
    """Still of the robot beside the weld map; None for a run without one."""
    weld = result.details
    if not isinstance(weld, WeldResult):
        return None
    width, height = 12.0, 5.4
    figure = new_figure(width, height)
    still = 5.9
    picture = render_run(result, int(still * DPI), int((height - 0.5) * DPI))
    ax = figure.add_axes((0.0, 0.0, still / width, (height - 0.5) / height))
    ax.imshow(picture, interpolation="none", aspect="auto")
    ax.set_axis_off()
    chart = figure.add_axes((0.55, 0.185, 0.415, 0.72), anchor="N")
    draw_weld_map(chart, weld, result.description.world.list_welds())
    chart.grid(False)
    for x, text in (
        (0.015, "The robot slides an eddy-current probe over a pipe ..."),
        (0.525, "... and detects this weld (the pipe's surface, unrolled)"),
    ):
        figure.text(x, 0.955, text, fontsize=11.5, fontweight="bold", va="center")
    return figure
