"""Passes over the parts of a sector that a search missed."""

from __future__ import annotations

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.missions.crack_scan.cover import Cover, list_gaps

LEAST_HOLE = 0.0005
"""m; smaller holes at the edge of the covered area are ignored."""
SIGMAS = 2.33
"""Lateral standard deviations of a pass to each side that its swath must allow."""


def build_passes(
    cover: Cover, swath: float, pitch: float, lateral_std: float, ahead: float = 0.0
) -> Array:
    """Return the corners (n, 2) s, c m of axial passes over the missed parts, two per pass.

    Adjacent missed parts share a pass if they fit into the `swath` (m) less the lateral error of
    the pass; wider parts have passes `pitch` (m) apart, as in the first scan. A pass extends beyond
    the ends of a part by its lag behind the path, and by the distance `ahead` (m) of its last coil
    from the tip along it.
    """
    beyond_ends = np.array([SIGMAS * lateral_std + ahead, 0.0])
    room = max(swath - 2.0 * SIGMAS * lateral_std, 0.25 * swath)
    gaps = [g for g in list_gaps(cover) if g.hole_m > LEAST_HOLE]
    gaps.sort(key=lambda g: -(g.start[1] + g.end[1]))
    groups: list[tuple[Array, Array]] = []  # least and largest (s, c)
    for gap in gaps:
        low, high = np.array(gap.start) - beyond_ends, np.array(gap.end) + beyond_ends
        if groups:
            both = np.minimum(groups[-1][0], low), np.maximum(groups[-1][1], high)
            if both[1][1] - both[0][1] <= room:
                groups[-1] = both
                continue
        groups.append((low, high))
    rows: list[list[float]] = []
    for low, high in groups:
        beyond = float(high[1] - low[1]) - room
        count = 1 if beyond <= 0 else 1 + math.ceil(beyond / min(pitch, room) - 1e-9)
        middle, reach = 0.5 * float(low[1] + high[1]), 0.5 * max(beyond, 0.0)
        ends = float(low[0]), float(high[0])
        for c in np.linspace(middle + reach, middle - reach, count).tolist():
            a, b = ends if len(rows) % 4 == 0 else ends[::-1]
            rows += [[a, c], [b, c]]
    return np.array(rows).reshape(-1, 2)
