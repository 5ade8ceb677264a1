"""Compute the weld map of a scan file, as `skywright weld DATA.csv` does, without the picture."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.description.world.surface import roll_points, unroll_points
from skywright.errors import InputError
from skywright.inspection.calibration import (
    Calibration,
    build_calibration,
    check_calibration,
    load_calibration,
    to_complex,
)
from skywright.inspection.recorded_scan import is_recording, load_recorded_scan
from skywright.inspection.scan_file import Scan, load_scan
from skywright.inspection.spikes import check_interference, find_spikes
from skywright.inspection.surface_fit import (
    SurfaceFit,
    fit_cylinder,
    load_surface,
)
from skywright.inspection.weld import WeldResult, detect_contact, process_scan
from skywright.inspection.weld_line import LAG_PRIOR
from skywright.models.hover import read_numbers
from skywright.recordings.text_table import parse_span

LEAST_SEARCHED = 0.1
"""Least share of the contact samples that must lie outside a given calibration span."""

FILE_LAG = 0.1
"""s, standard deviation of the lag between signal and position in a file, caused by the clocks and
filters of two devices. For a run, `weld_line.LAG_PRIOR` is used."""


class WeldReport(NamedTuple):
    """A processed file."""

    name: str
    scan: Scan
    result: WeldResult
    fit: SurfaceFit
    calibration_span: tuple[float, float] | None  # s
    tilt: Array | None  # (n,) rad, from the inward normal to the probe
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the object that `skywright weld --json` prints (plain numbers, no NaN).

        `angle_deg` is measured from the circumferential direction. It is positive if the line
        advances along the printed axis while it turns right-handed about that axis.
        """
        found, surface = describe_welds(self.result), self.result.surface
        fit = self.fit
        return {
            "contact_fraction": round(self.result.contact_fraction, 6),
            **found,
            "line": found["lines"][0] if found["lines"] else None,
            "surface": {
                "axis_point_m": _round(surface.p_WP, 6),
                "axis": _round(surface.R_WP[:, 1], 8),
                "radius_m": round(surface.radius, 6),
                "std": {
                    "radius_m": round(fit.std_radius, 7),
                    "axis_point_m": round(fit.std_axis_point, 7),
                    "axis_deg": round(math.degrees(fit.std_axis), 5),
                },
            },
            "thresholds": {
                "lift_off": self.result.calibration.lift_off_threshold,
                "weld": self.result.calibration.weld_threshold,
                "detection": round(self.result.level, 4),
            },
            "contrasts": [None if math.isnan(x) else round(x, 3) for x in self.result.contrasts],
            "notes": list(self.notes),
        }


def describe_welds(result: WeldResult) -> dict[str, Any]:
    """Return lines and crossings as plain numbers, in W.

    `points_m` of a line are five points on it from its first to its last crossing. The standard
    deviations apply at `point_m`: across the line, and of its direction.
    """
    surface, lines = result.surface, []
    for k, line in enumerate(result.lines):
        mine = result.list_crossings(k)
        at = np.array([[x.s, x.c] for x in mine] or [[line.s, line.c]])
        ways = line.find_ways(at[:, 0], at[:, 1])
        points = roll_points(surface, *line.follow(np.linspace(ways.min(), ways.max(), 5)))[0]
        lines.append({
            "point_m": _round(roll_points(surface, line.s, line.c)[0][0], 6),
            "points_m": [_round(p, 6) for p in points],
            "angle_deg": round(math.degrees(line.angle), 4),
            "std_offset_m": round(line.std_offset, 7),
            "std_angle_deg": round(math.degrees(line.std_angle), 5),
            "lag_s": round(line.lag, 4),
            "std_lag_s": round(line.std_lag, 4),
            "lean": round(line.lean, 5),
            "crossings": len(mine),
        })  # fmt: skip
    return {
        "lines": lines,
        "crossings": [
            {
                "t_s": round(x.t, 4),
                "p_m": _round(np.array(x.p_W), 6),
                "line": x.line if x.line >= 0 else None,
            }
            for x in result.crossings
        ],
    }  # fmt: skip


def _tell_lag(result: WeldResult, lag_std: float) -> list[str]:
    """Return notes on a lag between signal and position: its value, or that it is unknown."""
    if not result.lines or lag_std <= LAG_PRIOR:
        return []
    line = result.lines[0]
    if line.std_lag > 0.5 * lag_std:
        speed = float(np.median([math.hypot(x.v_s, x.v_c) for x in result.list_crossings(0)]))
        return [
            "passes in one direction do not show a lag between signal and position: the line's "
            f"deviation has {lag_std:g} s of it, {1e3 * lag_std * speed:.1f} mm along the passes; "
            "scan in both directions"
        ]
    if abs(line.lag) < max(3.0 * line.std_lag, 0.02):
        return []
    late, early = ("signal", "position") if line.lag > 0.0 else ("position", "signal")
    return [
        f"the {late} is {abs(line.lag):.2f} s behind the {early}, as passes in opposite directions "
        "show: taken into account"
    ]


def _round(x: Array, digits: int) -> list[float]:
    return [round(float(v), digits) for v in x]


def find_approach(scan: Scan) -> tuple[float, float]:
    """Return the time span (s) of the first approach, air to contact, from the signal alone.

    Raises InputError if the file does not start with an approach from air.
    """
    w = to_complex(scan.ec)
    sound = ~find_spikes(w)
    t, w = scan.t[sound], w[sound]
    scale = float(np.max(np.abs(w)))
    far = np.abs(w - np.median(w[: max(5, w.size // 200)])) / (scale or 1.0)
    reach = float(np.quantile(far, 0.9))
    touched = np.flatnonzero(far > 0.85 * reach)
    # contact lasts, a spike does not
    for index in touched:
        if np.mean(far[index : index + 20] > 0.8 * reach) > 0.9:
            touch = float(t[index])
            if index >= 10 and reach > 0:
                return max(float(t[0]), touch - 10.0), touch + 1.0
            break
    raise InputError(
        "no approach from air to contact found at the start of the file; give --calibrate T0:T1 or "
        "a calibration file"
    )


def _calibrate(
    scan: Scan,
    span: tuple[float, float],
    gap: Array | None,
    lift_off_threshold: float | None,
    weld_threshold: float | None,
) -> Calibration:
    inside = (scan.t >= span[0]) & (scan.t <= span[1])
    if not inside.any():
        raise InputError(
            f"calibration: no samples in {span[0]:g}:{span[1]:g} s; the file spans "
            f"{scan.t[0]:g}:{scan.t[-1]:g} s"
        )
    cal = build_calibration(
        scan.ec[inside],
        gap=None if gap is None else gap[inside],
        lift_off_threshold=lift_off_threshold,
        weld_threshold=weld_threshold,
    )
    w = to_complex(scan.ec)
    whole = float(np.quantile(np.abs(w - cal.contact)[~find_spikes(w)], 0.99))
    if whole > 3 * cal.excursion:
        raise InputError(
            f"calibration: the signal changes by {cal.excursion:.3g} units in "
            f"{span[0]:g}:{span[1]:g} "
            f"s but by {whole:.3g} in the file: the span contains no full approach from air"
        )
    return cal


def _check_span(scan: Scan, span: tuple[float, float], contact: Mask, given: bool) -> str | None:
    """Return a note if most contact samples are in the calibration span, which is not searched.

    Raises InputError if the span is `given` and less than LEAST_SEARCHED of them are outside.
    """
    total = int(contact.sum())
    inside = int((contact & (scan.t >= span[0]) & (scan.t <= span[1])).sum())
    if 2 * inside <= total:
        return None
    what = (
        f"{span[0]:g}:{span[1]:g} s contains {inside} of the file's {total} samples in "
        "contact; the calibration span is not searched for welds"
    )
    if given and total - inside < LEAST_SEARCHED * total:
        raise InputError(
            f"--calibrate {what}; valid: one approach from air to contact, such as the first "
            f"seconds (the file spans {scan.t[0]:g}:{scan.t[-1]:g} s)"
        )
    return f"calibration: {what}"


def _drop_jumps(scan: Scan) -> Scan:
    """Drop the rows in which the tracker's position jumps and returns, with a note."""
    jumps = find_spikes(scan.p_WT)
    if not jumps.any():
        return scan
    return Scan(
        scan.t[~jumps],
        scan.ec[~jumps],
        scan.p_WT[~jumps],
        None if scan.axis_W is None else scan.axis_W[~jumps],
        (
            *scan.notes,
            f"{np.count_nonzero(jumps)} rows dropped in which the position jumps and returns, the "
            f"first at {scan.t[jumps][0]:.2f} s",
        ),
    )


def process_file(
    path: Path,
    calibrate: str | None = None,
    calibration_file: Path | None = None,
    lift_off_threshold: float | None = None,
    weld_threshold: float | None = None,
    surface_file: Path | None = None,
    columns: str | None = None,
) -> WeldReport:
    """Process a scan file: calibrate, find the surface, contact, crossings and the weld lines.

    `path` may also be a run's directory or recording. Without `calibrate` and `calibration_file`
    the calibration uses the touch before the scan of a run, or the first approach in a file, with
    a note. `columns` gives the file's names and units: "t=Time[ms],x=X[mm],re=Real".
    Raises InputError, in one line, if the input is invalid.
    """
    path = Path(path)
    for name, value in (("lift-off", lift_off_threshold), ("weld", weld_threshold)):
        number = np.ones(()) if value is None else read_numbers(value)
        if number is None or number.shape or not 0.0 < number < math.inf:
            raise InputError(f"{name} threshold {value!r}; valid: a number above 0")
    if columns is not None and not isinstance(columns, str):
        raise InputError(f"columns: {columns!r}; valid: a text such as t=Time[ms],x=X[mm]")
    if calibrate is not None and calibration_file is not None:
        raise InputError("give either calibrate (T0:T1) or a calibration file, not both")
    span = parse_span(calibrate, "of the file", "0:6.5") if calibrate is not None else None
    if is_recording(path):
        if columns:
            raise InputError("--columns is for a text file; a run's columns are known")
        scan, touched = load_recorded_scan(path)
        span = touched if span is None and calibration_file is None else span
    else:
        scan = load_scan(path, columns)
    check_interference(path, scan.t, to_complex(scan.ec))
    scan = _drop_jumps(scan)
    notes = list(scan.notes)
    if calibration_file is not None:
        cal = load_calibration(Path(calibration_file))
        cal = cal._replace(
            lift_off_threshold=lift_off_threshold or cal.lift_off_threshold,
            weld_threshold=weld_threshold or cal.weld_threshold,
        )
        cal = check_calibration(cal, str(calibration_file))
    else:
        if span is None:
            span = find_approach(scan)
            notes.append(f"calibrated on the approach found at {span[0]:.2f}:{span[1]:.2f} s")
        cal = _calibrate(scan, span, None, lift_off_threshold, weld_threshold)

    contact = detect_contact(scan.ec, cal)[2]
    if surface_file is not None:
        fit = load_surface(Path(surface_file), scan.p_WT[contact])
        if span is not None:
            gap = unroll_points(fit.cylinder, scan.p_WT)[2]
            cal = _calibrate(scan, span, gap, lift_off_threshold, weld_threshold)
            contact = detect_contact(scan.ec, cal)[2]
    elif not contact.any():
        raise InputError(
            f"{path}: no sample is in contact (lift-off below {cal.lift_off_threshold:.3g} units), "
            "so there is no surface to fit; check the calibration or give --surface FILE"
        )
    else:
        fit = fit_cylinder(scan.p_WT[contact])
        if fit.std_radius > 0.1 * fit.cylinder.radius:
            notes.append(
                f"the fitted radius is uncertain: {fit.cylinder.radius:.3f} m +- "
                f"{fit.std_radius:.3f} m; give --surface FILE if the pipe is known"
            )
    if cal.lift_off_threshold >= cal.excursion:
        notes.append(
            f"the lift-off threshold of {cal.lift_off_threshold:.3g} units is not below the signal "
            f"in air, {cal.excursion:.3g} units: air counts as contact"
        )
    if contact.any():
        off = float(np.median(np.abs(unroll_points(fit.cylinder, scan.p_WT[contact])[2])))
        if off > max(0.02, 0.1 * fit.cylinder.radius):
            raise InputError(
                f"{surface_file or path}: the contact points lie {off * 1e3:.3g} mm from the "
                "surface; check its unit and frame against the positions"
            )
        if off > 0.003:
            notes.append(f"the contact points lie {off * 1e3:.2g} mm from the surface")
    else:
        notes.append("no sample is in contact")

    if span is not None:
        doubt = _check_span(scan, span, contact, calibrate is not None)
        if doubt is not None:
            notes.append(doubt)
    lag_std = LAG_PRIOR if is_recording(path) else FILE_LAG
    result = process_scan(
        scan.t, scan.ec, scan.p_WT, fit.cylinder, cal, exclude=span, lag_std=lag_std
    )
    notes += [*result.notes, *_tell_lag(result, lag_std)]
    tilt = None
    if scan.axis_W is not None:
        local = (scan.p_WT - fit.cylinder.p_WP) @ fit.cylinder.R_WP
        local[:, 1] = 0.0
        with np.errstate(invalid="ignore", divide="ignore"):
            normal = local / np.linalg.norm(local, axis=1, keepdims=True) @ fit.cylinder.R_WP.T
            tilt = np.arccos(np.clip(-np.einsum("ij,ij->i", normal, scan.axis_W), -1.0, 1.0))
        seen = tilt[result.contact & np.isfinite(tilt)]
        if seen.size:
            median, worst = np.degrees([np.median(seen), np.max(seen)])
            notes.append(f"tilt in contact: median {median:.1f} deg, worst {worst:.1f} deg")
    return WeldReport(path.name, scan, result, fit, span, tilt, tuple(notes))
