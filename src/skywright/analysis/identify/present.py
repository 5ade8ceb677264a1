"""An identification for people: a page, a robot file, a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skywright.analysis.identify.fit import CONFIDENCE
from skywright.analysis.identify.identify import Identification
from skywright.analysis.identify.report import (
    IdentifyPage,
    LagRow,
    ParameterRow,
    write_identify_page,
)
from skywright.reports.terminal import new_console, new_table


def write_page(found: Identification, overrides: str, path: Path) -> None:
    """Write identify.html."""
    fit, p = found.fit, found.fit.prediction
    rows = [
        ParameterRow(
            e.parameter.name, e.parameter.meaning, e.parameter.unit, e.parameter.nominal, e.value,
            e.half_width,
            abs(e.parameter.nominal) if abs(e.parameter.nominal) > 0.2 * e.parameter.scale
            and "com_" not in e.parameter.name and not _is_product(e.parameter.name)
            else e.parameter.scale,
        )
        for e in fit.estimates
        if e.identified
    ]  # fmt: skip
    lags = [lag for lag in [found.rotor_lag, *found.servos] if lag is not None and lag.identified]
    poses = [
        f"pose {i + 1}: " + ", ".join(
            f"{name} {angle:.1f}°" for name, angle in zip(found.joints, np.degrees(q), strict=True)
        )
        for i, q in enumerate(found.poses)
        if found.joints
    ]  # fmt: skip
    page = IdentifyPage(
        robot=found.robot.name,
        logs=found.logs,
        mass=fit.mass,
        samples=fit.samples,
        confidence=CONFIDENCE,
        poses=poses,
        parameters=rows,
        lags=[
            LagRow(x.name, x.unit, x.gain, x.half_gain, x.lag, x.half_lag, x.offset, x.r_squared)
            for x in lags
        ],
        unknown=found.list_unknown(),
        notes=found.notes,
        overrides=overrides,
        t=p.t,
        held_out=p.held_out,
        measured=p.measured,
        predicted=p.predicted,
        nominal=p.nominal,
        r_squared=p.r_squared(p.predicted),
        r_squared_nominal=p.r_squared(p.nominal),
    )
    write_identify_page(page, path)


def _is_product(name: str) -> bool:
    return name.endswith(("_xy_kgm2", "_xz_kgm2", "_yz_kgm2"))


def print_identification(found: Identification, page: Path, robot_file: Path) -> None:
    """Print what was found."""
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
    for lag in [found.rotor_lag, *found.servos]:
        if lag is not None and lag.identified:
            console.print(
                f"{lag.name}: lag {1e3 * lag.lag:.1f} +- {1e3 * lag.half_lag:.1f} ms, gain "
                f"{lag.gain:.3f} +- {lag.half_gain:.3f}"
            )
    r2 = found.fit.prediction.r_squared(found.fit.prediction.predicted)[3:]
    each = ", ".join(f"{r:.4f}" for r in r2)
    console.print(f"angular acceleration predicted with R² {each} (x, y, z) on held-out parts")
    for line in found.list_unknown():
        console.print(f"not identified: {line}", markup=False)
    for note in found.notes:
        console.print(f"note: {note}", markup=False)
    console.print(f"page: {page}", markup=False)
    console.print(f"robot file: {robot_file}", markup=False)
