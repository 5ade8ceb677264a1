"""Output of an identification: a self-contained HTML page, and a table on the terminal."""

from pathlib import Path

import numpy as np

from skywright.analysis.identify import figures
from skywright.analysis.identify.fit import CONFIDENCE
from skywright.analysis.identify.identify import Identification
from skywright.reports.figures.style import house_style
from skywright.reports.page import build_picture, render_page, write_page
from skywright.reports.terminal import new_console, new_table


def write_identify_page(found: Identification, overrides: str, path: Path) -> None:
    """Write identify.html, a self-contained page."""
    p, estimates = found.fit.prediction, [e for e in found.fit.estimates if e.identified]
    r2 = p.r_squared(p.predicted)
    with house_style():
        pictures = [
            build_picture(
                "Angular acceleration, measured and predicted",
                figures.draw_series(p, slice(3, 6), "about", "rad/s²"),
                "A window around a held-out part (shaded), which the fit did not use. Dotted: "
                    "prediction of the robot file.",
            ),
            build_picture(
                "Predicted over measured, held-out parts", figures.draw_scatter(p),
                "Angular acceleration about the three body axes; on the line both agree.",
            ),
            build_picture(
                "Specific force, measured and predicted",
                figures.draw_series(p, slice(0, 3), "along", "m/s²"),
                "Specific force at the origin of the body.",
            ),
        ]  # fmt: skip
        if estimates:
            pictures.append(
                build_picture(
                    "Deviation of the robot from its file", figures.draw_intervals(estimates),
                    f"Bars are {CONFIDENCE:.0%} confidence intervals. A bar that excludes "
                        "zero shows a significant deviation.",
                )
            )  # fmt: skip
    poses = [
        f"pose {i + 1}: " + ", ".join(
            f"{name} {angle:.1f}°" for name, angle in zip(found.joints, np.degrees(q), strict=True)
        )
        for i, q in enumerate(found.poses)
        if found.joints
    ]  # fmt: skip
    write_page(path, render_page(
        "identify.html.j2", found=found, estimates=estimates, lags=found.list_lags(), poses=poses,
        r_squared=r2, r_squared_nominal=p.r_squared(p.nominal), confidence=CONFIDENCE,
        overrides=overrides, pictures=pictures, axes=figures.NAMES,
    ))  # fmt: skip


def print_identification(found: Identification, page: Path, robot_file: Path) -> None:
    """Print the results."""
    console = new_console()
    table = new_table(
        f"{found.robot.name} from {', '.join(found.logs)}", "parameter", "robot file", "identified",
        "+-", "unit", right=("robot file", "identified", "+-"),
    )  # fmt: skip
    for e in found.fit.estimates:
        if e.identified:
            p = e.parameter
            table.add_row(
                p.name, f"{p.nominal:.4g}", f"{e.value:.4g}", f"{e.half_width:.2g}", p.unit
            )
    console.print(table)
    for lag in found.list_lags():
        console.print(
            f"{lag.name}: lag {1e3 * lag.lag:.1f} +- {1e3 * lag.half_lag:.1f} ms, gain "
            f"{lag.gain:.3f} +- {lag.half_gain:.3f}"
        )
    r2 = found.fit.prediction.r_squared(found.fit.prediction.predicted)[3:]
    each = ", ".join(f"{r:.4f}" for r in r2)
    console.print(f"angular acceleration predicted with R² {each} (x, y, z) on held-out parts")
    for line in found.list_unknown():
        console.print(f"not identified: {line}")
    for note in found.notes:
        console.print(f"note: {note}")
    console.print(f"page: {page}")
    console.print(f"robot file: {robot_file}")
