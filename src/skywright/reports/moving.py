"""3-D pictures of a run: a still, and an animation of a scan beside its map."""

import io
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from skywright.inspection.weld import WeldResult
from skywright.reports.figures.style import house_style, new_figure
from skywright.reports.render import Camera
from skywright.reports.still import place_camera, render_run
from skywright.reports.weld_map import draw_weld_map
from skywright.run.result import RunResult

SIZE = (8.0, 3.6)  # in
DPI = 100
BEFORE = 4.0  # s, shown duration of the approach
MILLISECONDS = 120
"""Duration of one picture; the last one is shown twenty times as long."""


def write_still(
    result: RunResult, t: float, camera: Camera, path: Path, size: tuple[int, int] = (640, 440)
) -> Path:
    """Write the robot at time `t` (s) as a picture of `size` (pixels) in the format of `path`."""
    Image.fromarray(render_run(result, *size, t=t, camera=camera)).save(path, quality=85)
    return path


def draw_scan_frame(result: RunResult, t: float, *, finished: bool = False) -> Figure:
    """Draw the robot at time `t` (s) beside the map so far; `finished`: with the estimated line.

    Raises ValueError for a run without a weld map.
    """
    weld = result.details
    if not isinstance(weld, WeldResult):
        raise ValueError("a run without a weld map")
    lines = weld.lines if finished else ()
    result = result._replace(details=weld._replace(lines=lines))
    seen = weld.t <= t
    until = weld._replace(
        s=np.where(seen, weld.s, np.nan),
        c=np.where(seen, weld.c, np.nan),
        contact=weld.contact & seen,
        crossings=tuple(x for x in weld.crossings if x.t <= t),
        lines=lines,
    )
    width, height = SIZE
    figure = new_figure(width, height)
    ax = figure.add_axes((0.0, 0.0, 0.5, 1.0))
    pixels = (int(0.5 * width * DPI), int(height * DPI))
    middle = np.searchsorted(result.samples["t"], 0.5 * (weld.t[0] + weld.t[-1]))
    camera = place_camera(result, result.samples[middle])
    ax.imshow(render_run(result, *pixels, t=t, camera=camera), interpolation="none", aspect="auto")
    ax.set_axis_off()
    chart = figure.add_axes((0.6, 0.14, 0.38, 0.74))
    truth = result.description.world.list_welds() if finished else ()
    draw_weld_map(chart, until, truth, colorbar=False)
    legend = chart.get_legend()
    if legend is not None:
        legend.remove()
    on = np.isfinite(weld.s + weld.c) & weld.contact
    s, c = 1e3 * weld.s[on], 1e3 * weld.c[on]
    chart.set(xlim=(s.min() - 10, s.max() + 10), ylim=(c.min() - 10, c.max() + 10))
    title = "weld: estimated (red), true (dashed)" if finished else "path of the probe"
    chart.set_title(title, fontsize=9, color="#222222")
    chart.grid(False)
    return figure


def write_moving_scan(result: RunResult, path: Path, frames: int = 44) -> Path:
    """Write the scan of a run as an animated WebP of `frames` pictures. Raises ValueError without
    one."""
    weld = result.details
    if not isinstance(weld, WeldResult):
        raise ValueError("a run without a weld map")
    start, end = float(weld.t[0]) - BEFORE, float(weld.t[-1])
    pictures = []
    with house_style():
        for t in np.linspace(start, end, frames):
            buffer = io.BytesIO()
            figure = draw_scan_frame(result, float(t), finished=t == end)
            figure.savefig(buffer, format="png", dpi=DPI)
            pictures.append(Image.open(buffer).convert("RGB"))
    shown = [MILLISECONDS] * (frames - 1) + [20 * MILLISECONDS]
    pictures[0].save(
        path, save_all=True, append_images=pictures[1:], duration=shown, loop=0, quality=80
    )
    return path
