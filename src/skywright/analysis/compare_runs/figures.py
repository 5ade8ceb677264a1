"""Figure of the main series of two runs."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from skywright.analysis.compare_runs.overlay import Series
from skywright.reports.figures.style import BLUE, ORANGE, WIDTH, draw_line, new_figure, stack_panels


def draw_overlay(series: Sequence[Series], names: tuple[str, str]) -> Figure:
    """Draw one panel per quantity, the first run blue and the second orange and dashed."""
    figure = new_figure(WIDTH, 1.0 + 1.75 * len(series))
    strip, axes = stack_panels(figure, len(series))
    strip.set_axis_off()
    for ax, one in zip(axes, series, strict=True):
        ax.set(title=one.title, ylabel=one.label)
        draw_line(ax, *one.a, color=BLUE, label=f"A: {names[0]}")
        draw_line(ax, *one.b, color=ORANGE, label=f"B: {names[1]}", ls=(0, (4, 1.5)))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="upper right", ncols=2)
    return figure
