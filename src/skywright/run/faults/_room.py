"""Finds free space for an emergency landing, allowing for an error of the position estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skywright.models.geometry import ClearanceQuery, compute_clearance
from skywright.vehicle.rest_to_rest import duration

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor

Array = NDArray[np.float64]

MARGIN, WAY_MARGIN = 0.08, 0.1  # m, clearance on the way down and aside
SINK = 0.35  # m/s, of an emergency landing
FAR, ANGLES, RISES = (0.3, 0.6, 0.9, 1.3, 1.8, 2.4), 12, (0.0, 0.3, 0.6)  # m, -, m: candidates
PACE = 0.4, 0.8  # m/s, m/s^2, of the sideways motion
WAYS = [np.array(w) / np.linalg.norm(w) for w in product((-1.0, 0.0, 1.0), repeat=3) if np.any(w)]
LOOK_M = 0.1  # m between samples of a path
SIGMAS, DRIFTS_S, DRIFT_M = 3.0, 0.2, 1.0  # of the drift without localisation: s, m at most


def list_places(s: Supervisor, row: Any, first: float = 0.0) -> list[Array]:
    """Return possible positions of the robot, relative to its estimate: (3,) m each, first zero.

    If the estimate jumped, the position before the jump is possible too. Without localisation the
    estimate drifts until landing, with the square of the time, from the standard deviation that the
    filter reports. The descent begins after `first` (s).
    """
    v, out = s.senses, [np.zeros(3)]
    if float(np.linalg.norm(v.doubt)) > MARGIN:
        out.append(np.array(v.doubt))
    age = v.fix_age
    if age > DRIFTS_S:
        last = first + (float(row["p_WB"][2]) - s.ground_height) / SINK
        drift = SIGMAS * float(v.vehicle.pose_std) * (1.0 + last / age) ** 2
        size = min(drift, DRIFT_M) if math.isfinite(drift) else DRIFT_M
        out += [size * np.array(to) for to in ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0))]
    return out


def find_open(s: Supervisor, row: Any, usual: Array, far: float) -> Array:
    """Return the direction (3,) in which a robot without contact moves away from near objects.

    The one of WAYS, or the `usual` one, with the largest distance after `far` (m). Directions in
    which the distance does not decrease are preferred.
    """
    query = s.surroundings() if s.surroundings is not None else None
    if query is None:
        return usual
    here = np.array(row["p_WB"])

    first = _measure(s, query, here, row)

    def measure(way: Array) -> tuple[bool, float]:
        gaps = [_measure(s, query, p, row) for p in _walk([here, here + far * way])]
        return min(gaps) > first - 0.01, gaps[-1]

    return max([usual, *WAYS], key=measure)


def find_room(s: Supervisor, row: Any) -> list[Array]:
    """Return the way-points, the first of them here, to a position with free space below.

    This is the nearest position from which the path down is free, reached straight or after a
    climb, on a path that does not reduce the clearance. If there is none, the one with the largest
    distance.
    """
    query = s.surroundings() if s.surroundings is not None else None
    here = np.array(row["p_WB"])
    if query is None:
        return [here]
    best, most = [here], _measure_way(s, query, [here], row)
    for way in _list_ways(here) if most <= MARGIN else ():
        gap = _measure_way(s, query, way, row, most)
        if gap > most:
            best, most = way, gap
        if gap > MARGIN:
            break
    return best


def _measure_way(
    s: Supervisor, query: ClearanceQuery, way: list[Array], row: Any, least: float = -math.inf
) -> float:
    """Return the smallest distance (m) on a path and down from its end, over all `list_places`.

    A path that begins close to an object may stay as close. The search stops at a distance below
    `least`.
    """
    gap = math.inf
    legs = [float(np.linalg.norm(b - a)) for a, b in pairwise(way)]
    for d in list_places(s, row, sum(duration(leg, *PACE) for leg in legs)):
        keeps = min((_measure(s, query, p + d, row) for p in _walk(way)), default=math.inf)
        if keeps < min(_measure(s, query, way[0] + d, row), WAY_MARGIN) - 0.01:
            gap = min(gap, keeps)
        gap = min(gap, _measure_down(s, query, way[-1] + d, row))
        if gap <= least:
            break
    return gap


def _list_ways(here: Array) -> Iterator[list[Array]]:
    for rise in RISES:
        above = here + [0.0, 0.0, rise]
        for far in FAR:
            for angle in np.arange(ANGLES) * 2.0 * math.pi / ANGLES:
                there = above + far * np.array([math.cos(angle), math.sin(angle), 0.0])
                yield [here, above, there] if rise else [here, there]


def _walk(way: list[Array]) -> Iterator[Array]:
    for a, b in pairwise(way):
        n = max(math.ceil(float(np.linalg.norm(b - a)) / LOOK_M), 1)
        for i in range(1, n + 1):
            yield a + i / n * (b - a)


def _measure_down(s: Supervisor, query: ClearanceQuery, p: Array, row: Any) -> float:
    """Return the smallest distance (m) to anything but the ground on the way down from p."""
    arc = s.uav.arc
    low = s.ground_height if arc is None else arc.top
    way = [(p * [1.0, 1.0, 0.0] + [0.0, 0.0, z], row) for z in np.arange(low + 0.05, p[2], LOOK_M)]
    if arc is not None:  # then backward, as the link is laid down
        back, heights = arc.compute_path(lean := np.linspace(0.0, arc.lean, 6))
        ahead = row["R_WB"][:, 0] / np.hypot(*row["R_WB"][:2, 0]) * [1.0, 1.0, 0.0]
        for b, z, share in zip(back, heights, lean / arc.lean, strict=True):
            lying = row.copy()
            lying["q"][arc.swing] = share * arc.landed
            way.append((p * [1.0, 1.0, 0.0] + b * ahead + [0.0, 0.0, z], lying))
    return min((_measure(s, query, place, posed) for place, posed in way), default=math.inf)


def _measure(s: Supervisor, query: ClearanceQuery, p: Array, row: Any) -> float:
    n = s.vehicle.n_joints
    return float(compute_clearance(query, p, row["R_WB"], np.array(row["q"][:n])).distance)


def hold_stuck(v: Senses, q: Array) -> Array:
    """Return joints q, with those that do not follow at their estimated angles."""
    q = np.array(q)
    for j in v.stuck:
        q[j] = v.estimate["q"][j]
    return q
