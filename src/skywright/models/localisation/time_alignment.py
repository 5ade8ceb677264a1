"""Delay between two clocks, estimated from the speeds that both sensors measure.

Speed is the same in every frame, so it can be compared before the frames are aligned. The peak of
the normalised correlation of the two speeds gives the delay to a fraction of a sample;
`calibration.calibrate` refines it together with the frame.
"""

from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from skywright.core.arrays import Array, Mask
from skywright.errors import InputError
from skywright.models.localisation.trajectory import (
    Trajectory,
    compute_velocity,
    find_covered,
    find_gap_limit,
    remove_spikes,
)
from skywright.models.peaks import find_vertex

GRID = 0.05
"""s, step of the grid of speeds."""
WINDOW = 0.5
"""s, window of a mean speed."""
MAX_LAG = 5.0
"""s, largest offset between clocks that show the same time."""
LEAST_OVERLAP = 8.0
"""s, least common duration."""
LEAST_PEAK = 0.5
"""Least correlation of a valid result."""
SURE_PEAK = 0.8
"""Least correlation of a result without a note. Simulated flights give 0.95 and more at the true
offset."""
MARGIN = 0.05
"""Correlations that differ by less are similar."""


class TimeAlignment(NamedTuple):
    """t_second = t_first + offset, and the agreement of the speeds."""

    offset: float  # s
    peak: float  # normalised correlation at the offset
    lags: Array  # (n,) s
    correlation: Array  # (n,)
    common_clock: bool  # the search was limited to offsets near zero
    note: str


def _sample_speed(traj: Trajectory) -> tuple[Array, Array, float]:
    """Return speeds on a grid (0 if unknown), whether they are known, and the grid's first time."""
    traj = remove_spikes(traj)
    gap = find_gap_limit(traj.t, 1.0)
    t, v = compute_velocity(traj, WINDOW, gap)
    start = float(traj.t[0])
    count = int((traj.t[-1] - start) / GRID) + 1
    grid = start + GRID * np.arange(count, dtype=np.float64)
    if len(t) < 2:
        return np.zeros_like(grid), np.zeros_like(grid), start
    known = find_covered(t, grid, gap)
    speed = np.interp(grid, t, np.linalg.norm(v, axis=1))
    return np.where(known, speed, 0.0), known.astype(np.float64), start


def correlate_speeds(first: Trajectory, second: Trajectory) -> tuple[Array, Array, Array]:
    """Return offsets (n,) s, the normalised correlation of the speeds there, and the overlap (n,)
    s.

    At each offset only samples with both speeds known count (masked correlation by FFT).
    """
    a, ma, ta = _sample_speed(first)
    b, mb, tb = _sample_speed(second)
    size = len(a) + len(b) - 1
    fast = next_fast_len(size, real=True)

    def correlate(x: Array, y: Array) -> Array:
        """sum over k of x[k] y[k + l], for l = -(len(a) - 1) .. len(b) - 1"""
        full = irfft(np.conj(rfft(x, fast)) * rfft(y, fast), fast)
        return np.concatenate([full[fast - (len(a) - 1) :], full[: len(b)]])

    n = np.maximum(correlate(ma, mb), 1e-9)
    sa, sb = correlate(a, mb), correlate(ma, b)
    ab = correlate(a, b) - sa * sb / n
    va = correlate(a * a, mb) - sa * sa / n
    vb = correlate(ma, b * b) - sb * sb / n
    tiny = 1e-6 * n  # (1 mm/s)^2: lower speeds count as standstill
    good = (va > tiny) & (vb > tiny)
    corr = np.where(good, ab / np.sqrt(np.where(good, va * vb, 1.0)), 0.0)
    lags = np.arange(-(len(a) - 1), len(b), dtype=np.float64) * GRID + (tb - ta)
    return lags, np.clip(corr, -1.0, 1.0), GRID * n


def estimate_offset(first: Trajectory, second: Trajectory) -> TimeAlignment:
    """Return the offset between two clocks from the measured speeds.

    The search covers all offsets. If the unshifted recordings overlap, the clocks are taken as
    common, provided that an offset within MAX_LAG has a correlation similar to the highest one. A
    result with a low correlation, or one of several similar ones, has a note. Raises InputError if
    the recordings have nothing in common: no overlap in time and no common motion.
    """
    a, b = first, second
    shared = min(a.t[-1], b.t[-1]) - max(a.t[0], b.t[0])
    shorter = min(a.duration, b.duration)
    if shorter < LEAST_OVERLAP:
        brief = a if a.duration <= b.duration else b
        raise InputError(
            f"{brief.name}: {brief.duration:.1f} s of data; at least {LEAST_OVERLAP:g} s are "
            "needed to align clocks (--time-offset gives the offset by hand)"
        )
    lags, corr, overlap = correlate_speeds(a, b)
    enough = overlap >= max(LEAST_OVERLAP, 0.3 * shorter)
    near = enough & (np.abs(lags) <= MAX_LAG)
    common = bool(shared >= 0.5 * shorter)
    best = _find_peak(lags, corr, enough) if enough.any() else (0.0, -1.0)
    close = _find_peak(lags, corr, near) if common and near.any() else (0.0, -1.0)
    unique = best[1] >= SURE_PEAK and _is_unique(lags, corr, enough, best[0])
    if close[1] >= SURE_PEAK and close[1] >= _find_similar(best[1]):
        note = ""
        if not unique:
            note = (
                f"the speeds of {a.name} and {b.name} agree at several offsets of the clocks; "
                f"{close[0]:+.3f} s is taken; --time-offset sets it"
            )
        return TimeAlignment(*close, lags[near], corr[near], True, note)
    if unique:
        note = f"the clocks differ by {best[0]:+.3f} s, determined from the common motion"
        return TimeAlignment(*best, lags[enough], corr[enough], False, note)
    if close[1] >= LEAST_PEAK:
        note = (
            f"the delay between the clocks of {a.name} and {b.name} is doubtful: the correlation "
            f"of the speeds is {close[1]:.2f} at {close[0]:+.3f} s, which is taken, and at most "
            f"{max(best[1], close[1]):.2f} at any offset; --time-offset sets it"
        )
        return TimeAlignment(*close, lags[near], corr[near], True, note)
    if common:
        note = (
            f"the speeds of {a.name} and {b.name} do not determine the delay between the "
            f"clocks (correlation {float(np.max(corr[near], initial=0.0)):.2f}): it is "
            "taken as zero; --time-offset sets it"
        )
        return TimeAlignment(0.0, 0.0, lags[near], corr[near], True, note)
    raise InputError(
        f"{a.name} and {b.name} do not overlap in time ({_span(a)} and {_span(b)}), and no "
        "common motion determines the offset of their clocks; give it with --time-offset"
    )


def _span(traj: Trajectory) -> str:
    return f"{traj.t[0]:.2f} to {traj.t[-1]:.2f} s"


def _find_peak(lags: Array, corr: Array, allowed: Mask) -> tuple[float, float]:
    """Return offset and height of the highest peak, by a parabola through three samples."""
    k = int(np.argmax(np.where(allowed, corr, -2.0)))
    return float(lags[k]) + GRID * find_vertex(corr, k), float(corr[k])


def _is_unique(lags: Array, corr: Array, allowed: Mask, lag: float) -> bool:
    """Whether no other offset, further than 3 s away, has a similar correlation."""
    peak = float(np.max(corr[allowed]))
    away = allowed & (np.abs(lags - lag) > 3.0)
    return float(np.max(corr[away], initial=-1.0)) < _find_similar(peak)


def _find_similar(peak: float) -> float:
    """Return the least correlation that is similar to that of a peak."""
    return peak - max(MARGIN, 1.0 - peak)
