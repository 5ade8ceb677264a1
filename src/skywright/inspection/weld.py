"""Find welds in a simulated or measured scan: contact, weld signal, crossings, lines."""

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.description.world.surface import (
    Cylinder,
    find_middle,
    roll_points,
    unroll_points,
    wrap,
)
from skywright.errors import InputError
from skywright.inspection.baseline import MAJORITY, centre_calibration, remove_drift
from skywright.inspection.calibration import (
    Calibration,
    compute_components,
    estimate_weld_axis,
    is_lifted,
    robust_std,
    to_complex,
)
from skywright.inspection.crossings import (
    WIDE,
    Crossing,
    assign,
    find_normal,
    measure_contrasts,
    separate_lines,
    tell_faint,
)
from skywright.inspection.spikes import reject_spikes
from skywright.inspection.weld_line import HALF_WIDTH, LAG_PRIOR, WeldLine

MERGE_DISTANCE = 0.004
"""m; two flagged stretches closer than this, and within MERGE_TIME, are one crossing."""
MERGE_TIME = 2.0
"""s; largest time between two such stretches, and between samples of one stretch."""
MIN_LENGTH = 0.0015
"""m; a flagged stretch shorter than this is noise, because the coil averages over 3.5 mm."""
SIGNIFICANCE = 5.0
"""Least height of a crossing above the base metal, in standard deviations of the texture."""
FILLED = 0.5
"""Least share of samples on the weld among a crossing's samples in contact."""
LONG_LENGTH = 0.035
"""m; a longer stretch runs along the weld and is divided into pieces of about this length."""


class WeldResult(NamedTuple):
    """A processed scan; arrays are (n,), one value per sample, NaN if the sample is invalid."""

    t: Array  # s
    s: Array  # m, along the axis
    c: Array  # m, around the axis
    gap: Array  # m, measured distance from tip to surface
    lift_off: Array  # instrument units
    weld: Array  # instrument units
    contact: Mask
    on_weld: Mask
    contact_fraction: float
    crossings: tuple[Crossing, ...]
    lines: tuple[WeldLine, ...]  # the line with most crossings first
    calibration: Calibration  # includes the weld axis that was used
    surface: Cylinder
    notes: tuple[str, ...]
    level: float  # instrument units, least peak of a crossing
    contrasts: tuple[float, ...]  # median peak over `level`, by line; all crossings if no line

    @property
    def line(self) -> WeldLine | None:
        """The line with most crossings, None if there is none."""
        return self.lines[0] if self.lines else None

    def list_crossings(self, line: int) -> list[Crossing]:
        """Return the crossings of the line with the index `line`."""
        return [x for x in self.crossings if x.line == line]


def detect_contact(ec: NDArray[Any], calibration: Calibration) -> tuple[Array, Array, Mask]:
    """Return (n,) lift_off, weld and contact; contact: |lift_off| < threshold (Tognon 2018)."""
    lift_off, weld = compute_components(ec, calibration)
    return lift_off, weld, np.abs(lift_off) < calibration.lift_off_threshold


def _runs(flag: Mask, t: Array, s: Array, c: Array) -> list[tuple[int, int]]:
    """Return the stretches [start, stop) of set flags; a gap in the recording ends a stretch."""
    jump = np.zeros(flag.size + 1, bool)
    jump[1:-1] = (np.diff(t) > MERGE_TIME) | (np.hypot(np.diff(s), np.diff(c)) > 0.01)
    runs = []
    edge = np.flatnonzero(np.diff(np.concatenate([[False], flag, [False]]).astype(np.int8)))
    for start, stop in zip(edge[::2].tolist(), edge[1::2].tolist(), strict=True):
        cuts = [start, *(start + 1 + np.flatnonzero(jump[start + 1 : stop])).tolist(), stop]
        runs += list(pairwise(cuts))
    return runs


def _merge_runs(runs: list[tuple[int, int]], t: Array, s: Array, c: Array) -> list[tuple[int, int]]:
    merged: list[tuple[int, int]] = []
    for start, stop in runs:
        if merged:
            first, last = merged[-1][0], merged[-1][1]
            # means of a few samples, because one measured position is too noisy to compare
            a, b = slice(max(first, last - 5), last), slice(start, min(stop, start + 5))
            apart = math.hypot(
                float(np.mean(s[a])) - float(np.mean(s[b])),
                float(np.mean(c[a])) - float(np.mean(c[b])),
            )
            if apart < MERGE_DISTANCE and t[start] - t[last - 1] < MERGE_TIME:
                merged[-1] = (merged[-1][0], stop)
                continue
        merged.append((start, stop))
    return merged


def _locate(
    t: Array,
    s: Array,
    c: Array,
    weld: Array,
    noise: float,
    surface: Cylinder,
    normal: tuple[float, float] | None = None,
) -> Crossing | None:
    """Return the crossing at the centroid of one stretch, None if the stretch is too short.

    The centroid is that of the signal above half the peak, weighted by path length, not by time.
    It is taken along the direction of motion, or along the weld's `normal` (s, c) if given. With a
    normal, a path that wanders during an oblique crossing does not shift the centroid.
    """
    count = t.size
    peak = float(np.quantile(weld, 0.95)) if count > 20 else float(np.max(weld))
    middle_s, middle_c = float(np.mean(s)), float(np.mean(c))
    d = np.stack([s - middle_s, c - middle_c], axis=1)
    duration = float(t[-1] - t[0])
    if count < 3 or duration <= 0:
        return None
    # velocity by regression, because differences of measured positions are mostly noise
    tau = t - t.mean()
    v = tau @ d / float(tau @ tau)
    direction = np.linalg.eigh(d.T @ d)[1][:, -1] if normal is None else np.array(normal)
    direction = direction * (1.0 if direction @ v >= 0 else -1.0)
    x = d @ direction
    length = float(np.ptp(x)) if count < 20 else float(np.diff(np.quantile(x, [0.02, 0.98]))[0])
    if length < MIN_LENGTH:
        return None
    order = np.argsort(x, kind="stable")
    xs = x[order]
    share = np.gradient(xs) if count > 2 else np.ones(count)
    share = np.maximum(share, 0.0)
    height = np.maximum(weld[order] - 0.5 * peak, 0.0) * share
    total = float(height.sum())
    if not total > 0:
        height, total = np.ones(count), float(count)
    centre = float(height @ xs) / total
    # position across the motion, and time, from the samples near the centroid
    near = np.abs(x - centre) <= max(0.15 * length, float(np.sort(np.abs(x - centre))[2]))
    across = d @ np.array([-direction[1], direction[0]])
    offset = float(np.mean(across[near]))
    s_c = middle_s + centre * direction[0] - offset * direction[1]
    c_c = middle_c + centre * direction[1] + offset * direction[0]
    # a slope of the noise over the stretch moves the centroid; the position noise does too
    position_noise = robust_std(x - float(direction @ v) * tau)
    slope = 0.25 * length * noise / max(peak, 1e-12)
    std = math.sqrt(slope**2 + min(2 * position_noise, 0.02) ** 2 / count + (5e-5) ** 2)
    p = roll_points(surface, s_c, c_c)[0][0]
    return Crossing(
        t=float(np.mean(t[near])),
        s=float(s_c),
        c=float(c_c),
        p_W=(float(p[0]), float(p[1]), float(p[2])),
        peak=peak,
        v_s=float(v[0]),
        v_c=float(v[1]),
        std=std,
        samples=count,
        width=length,
    )


def _is_crossed(x: Array, before: bool, after: bool) -> bool:
    """Whether a stretch leads from one side of the weld to the other.

    `x` (n,) m is the position along the weld's normal, or along the stretch. `before` and `after`:
    whether base metal was measured next to the start and the end. A path that turns or ends on the
    weld measures one flank only, and the middle of its stretch is not the middle of the weld.
    """
    count = min(max(x.size // 20, 3), x.size)
    net = abs(float(np.mean(x[-count:])) - float(np.mean(x[:count])))
    reach = float(np.diff(np.quantile(x, [0.02, 0.98]))[0])
    return before and after and net > 0.5 * reach


def find_crossings(
    t: Array,
    s: Array,
    c: Array,
    weld: Array,
    on_weld: Mask,
    noise: float,
    surface: Cylinder,
    base: Mask,
    lines: list[WeldLine],
) -> tuple[list[Crossing], list[Crossing]]:
    """Return (crossings, points for the lines) of a scan.

    `base` (n,) flags contact on base metal. Each stretch is located along the path. If it lies on a
    line of `lines` and crosses it, it is located again along the normal of that line. Crossings and
    points are the same, unless the path runs along the weld: such a stretch is one crossing but
    several points. The standard deviation of these points, and of one-sided stretches, is at
    least HALF_WIDTH.
    """
    crossings: list[Crossing] = []
    points: list[Crossing] = []

    def is_base(index: slice, at: int) -> bool:
        close = np.abs(t[index] - t[at]) < MERGE_TIME
        close &= np.hypot(s[index] - s[at], c[index] - c[at]) < 0.01
        return bool(np.any(base[index] & close))

    for start, stop in _merge_runs(_runs(on_weld, t, s, c), t, s, c):
        span = slice(start, stop)
        stretch = (t[span], s[span], c[span], weld[span], noise, surface)
        found = _locate(*stretch)
        # a stretch merged from scattered samples is interference: on a weld all samples are high
        filled = np.sum(on_weld[span]) >= FILLED * np.sum(on_weld[span] | base[span])
        if found is None or not filled:
            continue
        normal = find_normal(found, lines)
        if normal is not None:
            found = _locate(*stretch, normal) or found
        d = np.stack([s[span], c[span]], axis=1)
        d -= d.mean(axis=0)
        x = d @ (np.linalg.eigh(d.T @ d)[1][:, -1] if normal is None else np.array(normal))
        # a few samples, because the probe may chatter at the edge of the weld
        before = is_base(slice(max(start - 5, 0), start), start)
        after = is_base(slice(stop, stop + 5), stop - 1)
        if not _is_crossed(x, before, after):
            half = 0.5 * float(np.diff(np.quantile(x, [0.02, 0.98]))[0])
            found = found._replace(one_sided=True, std=max(HALF_WIDTH, half))
        crossings.append(found)
        path = np.hypot(s[span] - s[start], c[span] - c[start])
        reach = float(path.max())
        if reach <= LONG_LENGTH:
            points.append(found)
            continue
        pieces = min(math.ceil(reach / LONG_LENGTH), 50)
        for index in np.array_split(np.arange(start, stop), pieces):
            piece = _locate(t[index], s[index], c[index], weld[index], noise, surface)
            if piece is not None:
                # pieces of a path along one flank share the sign of their error
                shared = math.sqrt(pieces) if found.one_sided else 1.0
                points.append(piece._replace(std=HALF_WIDTH * shared, one_sided=found.one_sided))
    return crossings, points


def process_scan(
    t: Array,
    ec: NDArray[Any],
    p_WT: Array,
    surface: Cylinder,
    calibration: Calibration,
    *,
    exclude: tuple[float, float] | None = None,
    lag_std: float = LAG_PRIOR,
) -> WeldResult:
    """Find contact, crossings and the weld lines of a scan.

    Parameters: `t` (n,) s, increasing; `ec` (n, 2) or complex (n,), instrument units; `p_WT`
    (n, 3) m, measured tip in W; `surface` as built or fitted; `exclude` a time span (s) that is not
    searched for welds (the calibration); `lag_std` (s) the standard deviation of the lag between
    signal and position. Samples with NaN are left out.
    If the calibration has no weld axis, the axis is estimated from this scan. A calibration taken
    on the weld is moved to this scan's base metal; if that is impossible, no line is reported.
    Raises InputError if the arrays do not fit together or times decrease.
    """
    t = np.asarray(t, float).ravel()
    w = to_complex(ec)
    p = np.asarray(p_WT, float)
    if not (t.size == w.size == len(p)) or p.shape != (t.size, 3):
        raise InputError(
            f"scan: {t.size} times, {w.size} signals and positions of shape {p.shape}; valid: "
            "(n,), (n, 2) and (n, 3)"
        )
    valid = np.isfinite(t) & np.isfinite(w) & np.all(np.isfinite(p), axis=1)
    if np.any(np.diff(t[valid]) < 0):
        raise InputError("scan: times go backwards; sort the samples by time")
    notes: list[str] = []
    spikes = np.zeros(t.size, bool)
    lifted = is_lifted(w[valid], calibration)
    spikes[valid], note = reject_spikes(t[valid], w[valid], p[valid], lifted)
    valid &= ~spikes
    notes += [note] if note else []
    s, c, gap = unroll_points(surface, p)
    # along the path, because with noise c jumps at every sample on the cut of the unrolled pipe
    c[valid] = np.unwrap(c[valid], period=2.0 * math.pi * surface.radius)

    searched = valid.copy()
    if exclude is not None:
        searched &= ~((t >= exclude[0]) & (t <= exclude[1]))
    contact = detect_contact(w, calibration)[2] & valid
    first = contact & searched
    baseline = centre_calibration(w[first], s[first], c[first], calibration)
    calibration = baseline.calibration
    if baseline.note is not None:
        notes.append(baseline.note)
        contact = detect_contact(w, calibration)[2] & valid
    sound = baseline.sound
    axis_known = calibration.weld_axis is not None
    if not axis_known:
        axis = estimate_weld_axis(w[contact], calibration)
        if axis is not None:
            calibration = calibration._replace(weld_axis=axis)
    lift_off, weld, contact = detect_contact(w, calibration)
    contact &= valid
    on_weld = contact & searched & (weld > calibration.weld_threshold)
    share = float(on_weld.sum()) / max(int((contact & searched).sum()), 1)
    if sound and not axis_known and share > MAJORITY:
        sound = False
        notes.append(
            f"{share:.0%} of the contact samples read as weld: base metal must be the majority for "
            "a line; calibrate away from the weld"
        )
    weld = remove_drift(s, c, weld, contact & searched, calibration.weld_threshold)
    on_weld = contact & searched & (weld > calibration.weld_threshold) & sound

    # the texture of the steel moves the signal in the same direction as the weld, but less: a
    # crossing must exceed the texture of this scan's base metal
    quiet = contact & (np.abs(weld) < calibration.weld_threshold)
    noise = robust_std(weld[quiet])
    base = float(np.median(weld[quiet])) if quiet.any() else 0.0
    index = np.flatnonzero(valid)
    off_weld = contact & searched & ~on_weld
    data = (t[index], s[index], c[index], weld[index] - base, on_weld[index], noise, surface)
    path = (s[index], c[index], contact[index] & searched[index])
    least = SIGNIFICANCE * noise
    near = find_middle(c[contact & searched], surface.radius)
    lines: list[WeldLine] = []
    for _ in range(3):  # a line's normal refines its crossings, and these refine the line
        found, points = find_crossings(*data, off_weld[index], lines)
        crossings, points = (
            [x._replace(c=float(wrap(x.c, surface.radius, near))) for x in part if x.peak >= least]
            for part in (found, points)
        )
        lines = separate_lines(points, surface.radius, *path, lag_std)
        if not lines:
            break
    if len(found) > len(crossings):
        notes.append(
            f"{len(found) - len(crossings)} segments above the weld threshold are within "
            f"the texture of the base metal ({SIGNIFICANCE:g} x {noise:.2g} units): "
            "excluded"
        )
    wide = [x.width for x in crossings if x.width > WIDE and not x.one_sided and lines]
    if wide:
        notes.append(
            f"{len(wide)} of {len(crossings)} crossings are wider than {WIDE * 1e3:g} mm (up to "
            f"{max(wide) * 1e3:.0f} mm): a wide weld, or welds too close together to be resolved"
        )
    one_sided = sum(x.one_sided for x in crossings)
    if one_sided:
        notes.append(
            f"{one_sided} of {len(crossings)} crossings turn back or end on the weld: "
            "their positions are uncertain by its width"
        )
    if lines:
        crossings = sorted((assign(x, lines) for x in crossings), key=lambda x: x.t)
        off = sum(x.line < 0 for x in crossings)
        if len(lines) > 1:
            notes.append(f"{len(lines)} welds: the crossings lie on {len(lines)} lines")
        if sum(len(x.inliers) == 2 for x in lines) > 1:
            notes.append(
                "two passes over several welds are ambiguous: lines along or across the "
                "axis were chosen"
            )
        if off:
            notes.append(f"{off} of {len(crossings)} crossings lie off the line: they have none")
    elif len(crossings) == 1:
        notes.append("one crossing only: the line is not determined")
    elif crossings:
        notes.append("the crossings are too close together to determine the line")
    level = max(calibration.weld_threshold - base, least)
    contrasts = measure_contrasts(crossings, len(lines), level)
    notes += tell_faint(contrasts, level)
    return WeldResult(
        t=t, s=s, c=wrap(c, surface.radius, near), gap=gap, lift_off=lift_off, weld=weld,
        contact=contact, on_weld=on_weld,
        contact_fraction=float(np.mean(contact[valid])) if valid.any() else 0.0,
        crossings=tuple(crossings), lines=tuple(lines), calibration=calibration, surface=surface,
        notes=tuple(notes), level=level, contrasts=tuple(contrasts),
    )  # fmt: skip
