"""Figure of a sweep over the rotors' tilt (Sanchez-Cuevas et al. 2020, figures 4 and 5)."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from skywright.models.sweep import TiltSweep

BLUE, ORANGE, GREEN, RED, GREY = "#1f5fa8", "#d9731a", "#2c8a4b", "#b3261e", "#8a8f98"


def write_sweep_figure(sweep: TiltSweep, path: Path | str) -> Path:
    """Write the figure as PNG or SVG (by the suffix) and return its path."""
    figure = Figure(figsize=(13.0, 8.6), dpi=110)
    FigureCanvasAgg(figure)
    (force, lean), (power, payload) = figure.subplots(2, 2)
    tilt = np.degrees(sweep.tilts)
    sides = (("+x", RED, "-"), ("+y", BLUE, "-"), ("-x", RED, "--"), ("-y", BLUE, "--"))
    for i, (name, colour, line) in enumerate(sides):
        force.plot(tilt, sweep.lateral_force[:, i], color=colour, ls=line, lw=2, label=name)
    force.plot(tilt, sweep.least_force, color=GREY, ls=":", lw=2, label="weakest direction")
    lean.plot(tilt, np.degrees(sweep.hover_tilt[:, 0]), color=BLUE, lw=2, label="roll")
    lean.plot(tilt, np.degrees(sweep.hover_tilt[:, 1]), color=RED, lw=2, label="pitch")
    power.plot(tilt, sweep.hover_power, color=GREEN, lw=2)
    payload.plot(tilt, sweep.payload, color=ORANGE, lw=2)
    _finish(force, sweep, "Lateral force at level attitude", "largest force (N)")
    _finish(lean, sweep, "Tilt of the body that hover allows", "largest tilt (deg)")
    _finish(power, sweep, "Electrical power in hover", "power (W), avionics included")
    _finish(payload, sweep, "Payload at the centre", "mass (kg)")
    figure.suptitle(
        f"{sweep.robot}: tilt of the rotors, {sweep.mass:.2f} kg, "
        f"up to {sweep.thrust_fraction:.0%} of the thrust",
        x=0.06, ha="left", fontsize=14, fontweight="bold",
    )  # fmt: skip
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.97))
    out = Path(path)
    figure.savefig(out)
    return out


def _finish(axes: Axes, sweep: TiltSweep, title: str, y: str) -> None:
    own = math.degrees(sweep.own)
    axes.axvline(own, color=GREY, lw=1.2, ls=":")
    axes.text(own, 0.02, f" this robot, {own:g} deg", rotation=90, fontsize=8, color=GREY,
              ha="right", va="bottom", transform=axes.get_xaxis_transform())  # fmt: skip
    axes.set_title(title, fontsize=11, fontweight="bold")
    axes.set_xlabel("tilt of the rotors: largest of alpha and beta (deg)", fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.set_xlim(0.0, math.degrees(sweep.tilts[-1]))
    axes.set_ylim(bottom=0.0)
    axes.grid(color="#eeeeee")
    axes.tick_params(labelsize=8)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, frameon=False)
