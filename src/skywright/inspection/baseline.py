"""Check that the calibration's contact point is on the scan's base metal, and correct it if not.

If the approach touches down on the weld, the calibration uses weld metal as base metal. The rest of
the pipe then deviates from the lift-off curve, and the result is the negative of the weld. The scan
shows the error: the base metal is the majority of the readings, over an area wider than any weld.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from skywright.core.arrays import Array, Mask
from skywright.inspection.calibration import (
    Calibration,
    ComplexArray,
    compute_components,
    compute_local,
)

MAJORITY = 0.5
"""Least share of the contact samples that must agree to be identified as base metal."""
WIDEST_WELD = 0.03
"""m; an area of equal readings in contact that is wider than this is not a weld."""
OFFSET = 0.5
"""Uncorrected offset of the contact point, as a share of the weld threshold. Texture alone causes
as much."""
MIN_SAMPLES = 20
DRIFT_LENGTH = 0.08
"""m of path, window of the running median that gives the texture's drift; several times the width
of a crossing."""


class Baseline(NamedTuple):
    """A calibration centred on the scan's base metal.

    `sound` is False if the base metal could not be identified.
    """

    calibration: Calibration
    sound: bool
    note: str | None


def estimate_mode(x: Array) -> float:
    """Return the median of the shortest interval that contains half of x (n,).

    Outliers on one side do not change it.

    Rousseeuw and Leroy, Robust Regression and Outlier Detection (1987), ch. 4 (the shorth).
    """
    x = np.sort(x)
    half = max(x.size // 2, 1)
    start = int(np.argmin(x[half - 1 :] - x[: x.size - half + 1]))
    return float(np.median(x[start : start + half]))


def compute_width(s: Array, c: Array) -> float:
    """Return the width (m) of a set of points on the unrolled surface across its longest direction.

    `s` and `c` (n,) are in m. The width is the distance between the 5 % and 95 % quantiles.
    """
    d = np.stack([s - np.mean(s), c - np.mean(c)], axis=1)
    across = d @ np.linalg.eigh(d.T @ d)[1][:, 0]
    return float(np.diff(np.quantile(across, [0.05, 0.95]))[0])


def centre_calibration(w: ComplexArray, s: Array, c: Array, cal: Calibration) -> Baseline:
    """Move the calibration's contact point to the base metal of a scan, if the two differ.

    `w` (n,) is the signal of the samples in contact, `s` and `c` (n,) m are their positions. If the
    difference exceeds the weld threshold, the majority of the samples is base metal if its area is
    wider than a weld, or if a known weld axis shows that the contact point was on the weld. If the
    weld axis shows that the majority is on the weld, the calibration is returned unchanged. Without
    a majority, or if its area is no wider than a weld and the weld axis is unknown, the result is
    not `sound`.
    """
    if w.size < MIN_SAMPLES:
        return Baseline(cal, True, None)
    local, across = compute_local(w, cal)
    mode = estimate_mode(across)
    alike = np.abs(across - mode) < cal.weld_threshold
    if abs(mode) <= OFFSET * cal.weld_threshold:
        return Baseline(cal, True, None)
    share = float(np.mean(alike))
    shift = complex(np.median(local.real[alike]), np.median(local.imag[alike]))
    centred = cal._replace(contact=cal.contact + shift * cal.lift_off_axis)
    what = (
        f"{share:.0%} of the contact samples differ by {abs(mode):.2g} units from the calibration's"
    )
    if abs(mode) > cal.weld_threshold:
        wide = compute_width(s[alike], c[alike]) > WIDEST_WELD
        on_weld = None  # whether the majority is on the weld; None: unknown
        if cal.weld_axis is not None:
            on_weld = float(compute_components(np.array([centred.contact]), cal)[1][0]) > 0
        if share >= MAJORITY and not wide and on_weld:
            return Baseline(
                cal, True, f"{what} contact point, on the weld's side: the path follows the weld"
            )
        if share < MAJORITY or (not wide and on_weld is None):
            why = (
                "no majority can be identified as base metal"
                if share < MAJORITY
                else (
                    "within a strip no wider than a weld, so base metal and weld cannot be "
                    "distinguished"
                )
            )
            return Baseline(
                cal, False, f"{what} contact point, {why}: calibrate away from the weld; no line"
            )
    return Baseline(
        centred,
        True,
        f"{what} contact point (calibrated on the weld, or drift): these samples are taken "
        "as base metal",
    )


def remove_drift(s: Array, c: Array, weld: Array, contact: Mask, threshold: float) -> Array:
    """Subtract the slow drift of the base metal's texture from the weld signal (n,).

    The drift is the running median over DRIFT_LENGTH of path, which a crossing of about 12 mm
    hardly changes. It is limited to 1.5 thresholds, because it would otherwise remove a weld that
    the path follows.
    """
    index = np.flatnonzero(contact & np.isfinite(weld))
    if index.size < 50:
        return weld
    path = float(np.nansum(np.hypot(np.diff(s[index]), np.diff(c[index]))))
    size = min(int(DRIFT_LENGTH * index.size / max(path, DRIFT_LENGTH)), index.size) | 1
    drift = median_filter(weld[index], size=max(size, 3), mode="nearest")
    out = weld.copy()
    out[index] -= np.clip(drift, -1.5 * threshold, 1.5 * threshold)
    return out
