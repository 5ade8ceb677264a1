"""Is the calibration's contact point the scan's base metal? Checked and corrected on the scan.

An approach that touches down on the weld takes weld metal for base metal: all the rest of the
pipe then stands off the lift-off curve, and what is found is the weld's negative. The scan itself
tells: base metal is what the probe reads over most of an area that is wider than any weld.
"""

import math
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
"""Least share of the contact samples that must read alike to be called base metal."""
WIDEST_WELD = 0.03
"""m; contact that reads alike over an area wider than this is no weld."""
OFFSET = 0.5
"""Share of the weld threshold by which the contact point may be off: the texture does as much."""
MIN_SAMPLES = 20
DRIFT_LENGTH = 0.08
"""m of path over which the texture's drift is taken; several crossings' widths."""


class Baseline(NamedTuple):
    """A calibration centred on the scan's base metal; `sound` False: that could not be told."""

    calibration: Calibration
    sound: bool
    note: str | None


def estimate_mode(x: Array) -> float:
    """Median of the shortest interval that holds half of x (n,): outliers on one side do nothing.

    Rousseeuw and Leroy, Robust Regression and Outlier Detection (1987), ch. 4 (the shorth).
    """
    x = np.sort(x)
    half = max(x.size // 2, 1)
    start = int(np.argmin(x[half - 1 :] - x[: x.size - half + 1]))
    return float(np.median(x[start : start + half]))


def compute_width(s: Array, c: Array) -> float:
    """Width (m) of a set of places on the unrolled surface, across its longest direction."""
    d = np.stack([s - np.mean(s), c - np.mean(c)], axis=1)
    across = d @ np.linalg.eigh(d.T @ d)[1][:, 0]
    return float(np.diff(np.quantile(across, [0.05, 0.95]))[0])


def centre_calibration(w: ComplexArray, s: Array, c: Array, cal: Calibration) -> Baseline:
    """Move the calibration's contact point to the base metal of a scan, where the two differ.

    `w` (n,) the signal of the samples in contact, `s`, `c` (n,) m where they were taken. The
    majority is base metal where it covers more than a weld could, or where a known weld axis says
    that the contact point was on the weld; otherwise the result is not `sound`.
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
        on_weld = None  # on which side of the contact point the majority lies, where that is known
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


def unwrap(c: Array, contact: Mask, radius: float) -> Array:
    """Return `c` (n,) m counted on past half a turn, so that no scan is cut at the far side."""
    if not np.any(contact):
        return c
    middle = float(np.angle(np.mean(np.exp(1j * c[contact] / radius)))) * radius
    turn = 2.0 * math.pi * radius
    return np.asarray(c - turn * np.round((c - middle) / turn))


def remove_drift(s: Array, c: Array, weld: Array, contact: Mask, threshold: float) -> Array:
    """Subtract the slow drift of the base metal's texture from the weld signal (n,).

    A running median over DRIFT_LENGTH of path, which a crossing of about 12 mm hardly moves;
    limited to 1.5 thresholds, so that a path along a weld keeps showing it.
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
