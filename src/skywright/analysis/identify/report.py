"""The page of an identification: one HTML file that opens offline."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.analysis.identify import figures
from skywright.reports.figures.style import house_style
from skywright.reports.page import build_picture, render_page

Array = NDArray[np.float64]


class ParameterRow(NamedTuple):
    """One line of the table of parameters."""

    name: str
    meaning: str
    unit: str
    nominal: float
    value: float
    half_width: float
    scale: float  # to which a deviation is compared


class LagRow(NamedTuple):
    """One line of the table of responses."""

    name: str
    unit: str
    gain: float
    half_gain: float
    lag_s: float
    half_lag_s: float
    offset: float
    r_squared: float


class IdentifyPage(NamedTuple):
    """Everything that the page tells. Arrays: k samples; specific force, angular acceleration."""

    robot: str
    logs: Sequence[str]
    mass: float
    samples: int
    confidence: float
    poses: Sequence[str]
    parameters: Sequence[ParameterRow]
    lags: Sequence[LagRow]
    unknown: Sequence[str]
    notes: Sequence[str]
    overrides: str
    t: Array  # (k,) s
    held_out: NDArray[np.bool_]
    measured: Array  # (k, 6)
    predicted: Array
    nominal: Array
    r_squared: Array  # (6,)
    r_squared_nominal: Array


def write_identify_page(page: IdentifyPage, path: Path) -> None:
    """Write the page; everything that it shows is inside it."""
    p = page
    with house_style():
        pictures = [
            build_picture(
                "Angular acceleration, measured and predicted",
                figures.draw_series(
                    p.t, p.held_out, p.measured[:, 3:], p.predicted[:, 3:], p.nominal[:, 3:],
                    p.r_squared[3:], "about", "rad/s²",
                ),
                "A window around a part that the fit did not see. The dotted line is what the "
                "robot file would have predicted.",
            ),
            build_picture(
                "Predicted over measured, held-out parts",
                figures.draw_scatter(
                    p.measured[p.held_out, 3:], p.predicted[p.held_out, 3:], p.r_squared[3:]
                ),
                "Angular acceleration about the three axes of the body; on the line both agree.",
            ),
            build_picture(
                "Specific force, measured and predicted",
                figures.draw_series(
                    p.t, p.held_out, p.measured[:, :3], p.predicted[:, :3], p.nominal[:, :3],
                    p.r_squared[:3], "along", "m/s²",
                ),
                "What an accelerometer at the origin of the body feels.",
            ),
        ]  # fmt: skip
        if p.parameters:
            rows = list(p.parameters)
            pictures.append(
                build_picture(
                    "How far the robot is from its file",
                    figures.draw_intervals(
                        [r.name for r in rows],
                        np.array([r.value for r in rows]),
                        np.array([r.half_width for r in rows]),
                        np.array([r.nominal for r in rows]),
                        np.array([r.scale for r in rows]),
                    ),
                    f"Bars are {p.confidence:.0%} confidence intervals; where a bar does not "
                    "reach zero, the robot differs from its file.",
                )
            )
    text = render_page(
        "identify.html.j2", page=p, pictures=[x for x in pictures if x], axes=("x", "y", "z")
    )
    path.write_text(text, encoding="utf-8")
