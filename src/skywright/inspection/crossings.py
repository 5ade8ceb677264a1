"""Crossings of a path with welds, and which of them lie on one line."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.inspection.weld_line import (
    INLIER,
    LAG_PRIOR,
    WIDEST,
    WeldLine,
    estimate_weld_line,
)

MOST_LINES = 10
WIDE = 0.016
"""m; a wider crossing is a wide weld, or several that the signal merges: a weld shows as wide as it
is, 10 mm mostly, and half of a coil's footprint on either side."""
SHOWN = 0.7
"""Least share of the path's passes over a further line that must be crossings of it."""
LEAST_SLANT = math.sin(math.radians(3.0))
"""Of a path across a line: below, a distance along the line's normal tells nothing of the path."""
FAINT = 2.0
"""Times the detection threshold, below which crossings of a weld can be missed: of 80 crossings of
constructed scans 66 are found at 1.6 times, 75 at 1.9, 79 at 2.1 and 80 from 2.3 times on."""
CLEAR = 0.01
"""m from a line's middle: beyond a weld's half-width and the coil."""


class Crossing(NamedTuple):
    """One stretch of the path on the weld."""

    t: float  # s, of its middle
    s: float  # m
    c: float  # m
    p_W: tuple[float, float, float]  # m, on the surface
    peak: float  # instrument units, above the base metal
    v_s: float  # m/s, mean velocity while crossing
    v_c: float
    std: float  # m, of the position along the motion (across the weld)
    samples: int
    line: int = -1  # index of its line; -1: it lies off all of them
    one_sided: bool = False  # entered and left on one side, or cut off by the end of the contact
    width: float = 0.0  # m, of the stretch along the motion, or across the weld once that is known


def _columns(crossings: list[Crossing], *names: str) -> tuple[Array, ...]:
    return tuple(np.array([getattr(x, name) for x in crossings], float) for name in names)


def separate_lines(
    points: list[Crossing],
    radius: float,
    s: Array,
    c: Array,
    contact: Mask,
    lag_std: float = LAG_PRIOR,
) -> list[WeldLine]:
    """Return the lines that the points lie on, that of most points first.

    Every two points make a line. Two alone, and all beyond the first line, are a weld only where
    the path, (n,) `s` and `c` (m) with `contact`, shows it: most of the places at which the path
    crosses the line are points near it, also of another line (welds may cross).
    """
    lines: list[WeldLine] = []
    left = points
    while len(left) > 1 and len(lines) < MOST_LINES:
        columns = _columns(left, "s", "c", "v_s", "v_c", "std")
        line = estimate_weld_line(*columns, radius=radius, lag_std=lag_std)
        if line is None:
            break
        shown = sum(is_near(x, line) for x in points)
        if (not lines and len(line.inliers) > 2) or shown >= SHOWN * count_passes(
            line, s, c, contact
        ):
            lines.append(line)
        left = [x for i, x in enumerate(left) if i not in line.inliers]
    return lines


def count_passes(line: WeldLine, s: Array, c: Array, contact: Mask) -> int:
    """Return how often a path in contact crosses a line, from CLEAR on one side to the other."""
    d = line.measure_distance(s, c)
    d = d[contact & (np.abs(d) > CLEAR)]
    return int(np.count_nonzero(np.diff(np.sign(d))))


def is_near(x: Crossing, line: WeldLine) -> bool:
    """Whether a crossing lies on a line, as well as its place is known."""
    off = _measure_off(x, line)
    return off < min(max(INLIER, 2.0 * x.std), WIDEST)


def find_owner(x: Crossing, lines: list[WeldLine]) -> int:
    """Return the index of the nearest line."""
    return int(np.argmin([_measure_off(x, a) for a in lines]))


def _measure_off(x: Crossing, line: WeldLine) -> float:
    """Distance (m) of a crossing from a line, from where it was but for the line's lag."""
    lag = line.lag
    return abs(float(line.measure_distance(x.s - lag * x.v_s, x.c - lag * x.v_c)))


def find_normal(x: Crossing, lines: list[WeldLine]) -> tuple[float, float] | None:
    """Return the normal (s, c) of the line that a crossing lies on and its path crosses."""
    if not lines:
        return None
    line = lines[find_owner(x, lines)]
    normal = (math.cos(line.angle), -math.sin(line.angle))
    across = abs(x.v_s * normal[0] + x.v_c * normal[1])
    crosses = across > LEAST_SLANT * math.hypot(x.v_s, x.v_c)
    near = _measure_off(x, line) < WIDEST
    return normal if near and crosses else None


def assign(x: Crossing, lines: list[WeldLine]) -> Crossing:
    """Return the crossing with the index of its line; -1 where it lies off all of them."""
    k = find_owner(x, lines)
    return x._replace(line=k if is_near(x, lines[k]) else -1)


def measure_contrasts(crossings: Sequence[Crossing], lines: int, level: float) -> list[float]:
    """Return the contrast of each of `lines` welds: its signal over the detection threshold.

    The signal is the median of its crossings' peaks; `level` (instrument units) is the least peak
    that counts as a crossing. Without a line, all crossings are one weld.
    """
    groups = [[x.peak for x in crossings if x.line == k] for k in range(lines)]
    groups = groups or [[x.peak for x in crossings]]
    return [float(np.median(peaks)) / level for peaks in groups if peaks]


def tell_faint(contrasts: Sequence[float], level: float) -> list[str]:
    """Return a note for each weld whose signal is near the detection threshold."""
    return [
        f"the signal of {'the weld' if len(contrasts) == 1 else f'weld {k}'} is "
        f"{x * level:.2g} units, {x:.1f} times the detection threshold of {level:.2g} units: "
        f"below {FAINT:g} times, crossings can be missed"
        for k, x in enumerate(contrasts, 1)
        if x < FAINT
    ]
