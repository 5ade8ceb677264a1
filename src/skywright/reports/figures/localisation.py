"""Figure of the localisation in flight: error of the estimate, and outages of the total station."""

import numpy as np
from matplotlib.figure import Figure

from skywright.recordings.columns import has_columns
from skywright.reports.figures.style import BLUE, draw_line, draw_panels
from skywright.run.metrics import OUTAGE
from skywright.run.result import RunResult

SHADE = "#f6e3d5"
CAPTION = (
    "Localisation error",
    "Estimated minus true position. Lines: two standard deviations, as stated by the "
    "filter. Shaded: no line of sight from the total station to the prism; only the "
    "tracking camera, which drifts, measures the motion.",
)


def draw_localisation(result: RunResult) -> Figure | None:
    """Draw the position error per axis; None with motion capture."""
    s = result.samples
    if result.description.world.tracks_markers:
        return None
    if not has_columns(s, "pose_std") or not np.any(s["pose_std"] > 0.0):
        return None
    flying = s["rotor_thrust"].sum(axis=1) > 0.5
    part = s[flying]
    if len(part) < 2:
        return None
    t = part["t"]
    old = not has_columns(s, "p_std")
    std = 1e3 * (part["pose_std"][:, None] * np.ones(3) if old else part["p_std"])
    error = 1e3 * (part["est_p_WB"] - part["p_WB"])
    away = np.concatenate([[0], (part["fix_age"] > OUTAGE).astype(int), [0]])
    starts, stops = np.flatnonzero(np.diff(away) > 0), np.flatnonzero(np.diff(away) < 0) - 1
    figure, axes = draw_panels(
        5.2, result.phases, t,
        *((f"Error of the estimated position along {name}", "error (mm)") for name in "xyz"),
    )  # fmt: skip
    for i, ax in enumerate(axes):
        for a, b in zip(starts, stops, strict=True):
            ax.axvspan(t[a] - OUTAGE, t[b], color=SHADE, lw=0)
        draw_line(ax, t, error[:, i], color=BLUE, label="error")
        for sign in (2.0, -2.0):
            draw_line(
                ax, t, sign * std[:, i], color="#8a8a8a", lw=0.8,
                label=f"{sign:+g} standard deviations",
            )  # fmt: skip
    return figure
