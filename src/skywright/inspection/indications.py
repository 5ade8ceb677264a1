"""Find and classify indications of an eddy-current flaw scan, where the display leaves its null.

The same finder processes a file as one block or a live stream as many blocks. It works in % of full
screen height of a set-up display (notch_setup.py), on which the lift-off is horizontal and notches
point upwards. A running median removes slow changes along the path (temperature, texture). If the
probe stays over a weld, the weld may fill the median's window; sound metal beside the weld would
then look like a crack. The subtracted value is therefore limited to within half the threshold of
the level of sound metal, which is the median over a path SOUND times as long.

Cracks and changes of permeability have the same phase on the display because both act through the
surface impedance. Phase does not separate them, but width does: a crack appears about as wide as
the coil, a weld appears wider. An indication that is neither is ambiguous, and so is a crack beside
or in a weld.
"""

import math
from collections.abc import Iterable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skywright.core.arrays import Array
from skywright.description.world.surface import find_middle, flatten, wrap
from skywright.errors import InputError
from skywright.recordings.period import compute_period

Nature = Literal["crack", "weld", "ambiguous"]
COIL_WIDTH = 0.00344
"""m, width at half height of a crack's signal, for the coil for which the lengths below are valid
(outer radius 2.5 mm, models/crack_signal.py). NARROW, WIDE and BESIDE are proportional to the width
of the coil. LINK and WINDOW grow with it but do not shrink, because small coils are not closer
together."""
LINK = 0.0035
"""m; samples above the threshold within this distance form one indication (the width of a coil)."""
NARROW = 0.0055
"""m; a narrower indication is a crack (the coil's width plus its path over the crack)."""
WIDE = 0.0075
"""m; a wider indication is a weld or a change of the metal."""
WINDOW = 0.04
"""m of path, window of the running median: more than twice the path over a crack along it."""
SOUND = 10.0
"""Path over which most of the scanned metal is sound, in multiples of WINDOW."""
LAG = 0.5
"""s, interval over which the distance that the probe moves is measured."""
BESIDE = 0.004
"""m; a crack with an end within this distance of a weld is ambiguous."""


class Indication(NamedTuple):
    """One place where the display leaves its null."""

    s: float  # m, along the axis
    c: float  # m, around it
    height: float  # % FSH, signed: positive upwards, as the notch
    length: float  # m, at the threshold
    width: float  # m, at half height, perpendicular to the length
    angle: float  # rad, direction of the length, from circumferential towards +s
    nature: Nature
    u95: float  # m, of its position
    t: float  # s, of the highest sample
    samples: int


class FlawFinder:
    """Collects a scan of one or more coils, block by block, and finds its indications."""

    def __init__(
        self, *, threshold: float = 15.0, window_m: float | None = None,
        coil_width_m: float = COIL_WIDTH, track_std: float = 0.001, radius_m: float = math.inf,
    ) -> None:  # fmt: skip
        """Set `threshold` (% FSH) and `window_m` (m of path), the window of the running median.

        `coil_width_m` is the coil's width at half height and `track_std` (m) the standard deviation
        of a position. `window_m` is by default WINDOW, scaled up for a coil wider than COIL_WIDTH.
        `radius_m` is that of the pipe (a turn apart, places are the same), infinite for a plane.
        Raises InputError if one of them is not above 0.
        """
        if window_m is None:
            window_m = WINDOW * max(coil_width_m / COIL_WIDTH, 1.0)
        for name, value in (("threshold", threshold), ("window_m", window_m),
                            ("coil_width_m", coil_width_m), ("track_std", track_std)):  # fmt: skip
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"flaw scan: {name} {value}; valid: above 0")
        if not radius_m > 0:
            raise InputError(f"flaw scan: radius_m {radius_m}; valid: above 0, inf for a plane")
        self.threshold, self.window_m = threshold, window_m
        self.coil_width_m, self.track_std = coil_width_m, track_std
        self.radius_m = radius_m
        self.scale = coil_width_m / COIL_WIDTH
        self._blocks: list[tuple[Array, NDArray[np.complex128], Array, Array]] = []

    def add(
        self, t: Iterable[float], display: NDArray[np.complex128], s: Array, c: Array
    ) -> int:  # fmt: skip
        """Add a block: `display` (n, k) in % FSH of k coils at `s`, `c` (n, k) m and `t` (n,) s.

        NaN marks invalid samples (no contact). Returns the number of samples of the block that
        exceed the threshold before slow changes are removed; a live display would sound its alarm
        for them. Raises InputError if the shapes of the arrays do not match.
        """
        times = np.asarray(list(t), float)
        z = np.atleast_2d(np.asarray(display, np.complex128))
        if not z.shape == np.shape(s) == np.shape(c) or len(times) != len(z):
            raise InputError(
                f"flaw scan: {len(times)} times, signals {z.shape}, places {np.shape(s)} and "
                f"{np.shape(c)}; valid: (n,) and three times (n, k)"
            )
        if self._blocks and self._blocks[0][1].shape[1] != z.shape[1]:
            raise InputError(
                f"flaw scan: a block of {z.shape[1]} coils after one of "
                f"{self._blocks[0][1].shape[1]}; valid: the same number"
            )
        self._blocks.append((times, z, np.asarray(s, float), np.asarray(c, float)))
        return int(np.count_nonzero(np.abs(z.imag) > self.threshold))

    def compute_heights(self) -> tuple[Array, Array, Array, Array]:
        """Return t (n,) s, vertical parts (n, k) % FSH without slow changes, s and c (n, k) m."""
        if not self._blocks:
            none = np.zeros((0, 1))
            return np.zeros(0), none, none, none
        t, z, s, c = (np.concatenate(x) for x in zip(*self._blocks, strict=True))
        up = np.full(z.shape, np.nan)
        for k in range(z.shape[1]):
            ok = np.flatnonzero(np.isfinite(z[:, k]) & np.isfinite(s[:, k]) & np.isfinite(c[:, k]))
            if ok.size < 3:
                continue
            mean = _measure_step(t[ok], s[ok, k], c[ok, k], self.radius_m)
            size = ok.size if mean <= 0 else min(round(self.window_m / mean), ok.size)
            values, half = z[ok, k].imag, 0.5 * self.threshold
            slow = median_filter(values, size=max(size, 3) | 1, mode="nearest")
            sound = _measure_sound(values, round(SOUND * size))
            up[ok, k] = values - np.clip(slow, sound - half, sound + half)
        return t, up, s, c

    def find(self) -> list[Indication]:
        """Return the indications in all blocks, the highest first."""
        t, up, s, c = self.compute_heights()
        row, coil = np.nonzero(np.abs(np.nan_to_num(up)) > self.threshold)
        if not row.size:
            return []
        height, place = up[row, coil], np.column_stack([s[row, coil], c[row, coil]])
        points = _roll(place, self.radius_m)
        labels = np.zeros(row.size, int)
        for sign in (1.0, -1.0):  # a weld's flank is not part of a crack
            mine = np.flatnonzero(np.sign(height) == sign)
            labels[mine] = _link(points[mine], LINK * max(self.scale, 1.0)) + (
                0 if sign > 0 else row.size
            )
        parts = [np.flatnonzero(labels == k) for k in np.unique(labels)]
        found = [self._describe(t[row[mine]], height[mine], place[mine]) for mine in parts]
        welds = [points[m] for x, m in zip(found, parts, strict=True) if x.nature == "weld"]
        weld, out = cKDTree(np.concatenate(welds)) if welds else None, []
        for x in found:
            if weld is not None and x.nature == "crack":
                reach = BESIDE * self.scale + 0.5 * x.length
                if weld.query(_roll(np.array([[x.s, x.c]]), self.radius_m)[0])[0] < reach:
                    x = x._replace(nature="ambiguous")
            out.append(x)
        return sorted(out, key=lambda x: -abs(x.height))

    def _describe(self, t: Array, height: Array, place: Array) -> Indication:
        place = _join(place, self.radius_m)
        weight = np.abs(height)
        peak = int(np.argmax(weight))
        middle = weight @ place / weight.sum()
        d = place - middle
        spread = (d * weight[:, None]).T @ d / weight.sum()
        values, axes = np.linalg.eigh(spread)
        along, across = d @ axes[:, 1], d @ axes[:, 0]
        high = weight >= 0.5 * weight[peak]
        # at half height; a coil shows no indication narrower than itself
        width = max(float(np.ptp(across[high])), 0.0)
        length = float(np.ptp(along))
        if len(height) < 3 or values[1] <= 0:
            width, length = 0.0, 0.0
        nature: Nature = "ambiguous"
        if height[peak] > 0 and width <= NARROW * self.scale:
            nature = "crack"
        elif width >= WIDE * self.scale:
            nature = "weld"
        angle = math.atan2(float(axes[0, 1]), float(axes[1, 1]))
        angle -= math.pi * round(angle / math.pi)
        u95 = 2 * math.hypot(self.track_std, 0.25 * self.coil_width_m)
        return Indication(
            float(middle[0]), float(middle[1]), float(height[peak]), length, width, angle, nature,
            u95, float(t[peak]), len(height),
        )  # fmt: skip


def _measure_step(t: Array, s: Array, c: Array, radius: float) -> float:
    """Return the distance (m) from sample to sample along the path.

    It is measured over LAG, because between neighbours it is mostly the tracker's noise.
    """
    dt = compute_period(t)
    lag = min(max(round(LAG / dt), 1) if dt > 0 else 1, t.size - 1)
    around = wrap(c[lag:] - c[:-lag], radius)
    return float(np.median(np.hypot(s[lag:] - s[:-lag], around))) / lag


def _measure_sound(values: Array, size: int) -> Array:
    """Return the running median (n,) of `values` (n,) over windows of `size` samples."""
    n = len(values)
    if size >= n:
        return np.full(n, np.median(values))
    step = max(size // 100, 1)  # the level changes slowly
    coarse = median_filter(values[::step], size=max(size // step, 3) | 1, mode="nearest")
    return np.interp(np.arange(n), np.arange(0, n, step), coarse)


def _roll(place: Array, radius: float) -> Array:
    """Return points (n, 3) m in space of places (n, 2) m, which a pipe's cut does not separate."""
    return np.column_stack([place[:, 0], *flatten(place[:, 1], radius)])


def _join(place: Array, radius: float) -> Array:
    """Return the places (n, 2) m of one indication without the pipe's cut, the first unchanged."""
    c = wrap(place[:, 1], radius, find_middle(place[:, 1], radius))
    return np.column_stack([place[:, 0], c + (place[0, 1] - c[0])])


def _link(points: Array, reach: float) -> NDArray[np.intp]:
    """Label (n,) points (n, 3) m; points connected by steps up to `reach` (m) share a label."""
    n = len(points)
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)
