"""Criteria of the oracle for a weld scan, on the true pipe:

- the requested pattern was passed within 6 mm, with a gap below 1 mm and a tilt below 10 deg, over
  98 % of its length. Its position may differ by the map's error along the axis and about it,
  because a touch does not reveal them;
- the tip tracked it (4 mm rms); the gap did not exceed 1 mm for 0.05 s, nor was it without force so
  long; nothing else was touched;
- every clear crossing of the true path with a true weld (from 10 mm on one side to 10 mm on the
  other) was reported within 15 mm, each by one, at most 5 mm beside it; reported crossings are
  within 15 mm of a weld; a pass that stays on a weld for 35 mm was reported;
- every weld with two clear crossings 2 cm apart has one line, within 5 mm of it between its
  outermost crossings; no line is reported elsewhere.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skywright.description.loader import Description

Array = NDArray[np.float64]

GAP_M, TILT_RAD, AWAY_S = 1e-3, math.radians(10.0), 0.05
NEAR_M, COVERED, TRACKED_M = 6e-3, 0.98, 4e-3
SIDE_M, REPORTED_M, APART_M, LINE_M, ALONG_M = 0.010, 0.015, 0.02, 5e-3, 0.035
TOUCH_N = 0.0


class Tube:
    """The true pipe: y along its axis, phi = 0 on its -x side, growing towards +z."""

    def __init__(self, pipe: Any) -> None:
        a, b = math.radians(pipe.yaw_deg), math.radians(pipe.inclination_deg)
        turn = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
        lift = np.array([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]])
        self.axes, self.radius = turn @ lift, 0.5 * pipe.diameter_m
        self.middle, self.half = np.array([pipe.x_m, pipe.y_m, pipe.z_m]), 0.5 * pipe.length_m

    def unroll(self, p_W: Any) -> Array:
        """Return the unrolled coordinates (s, phi) (n, 2) of points (n, 3)."""
        local = (np.atleast_2d(np.asarray(p_W, float)) - self.middle) @ self.axes
        return np.column_stack([local[:, 1], np.arctan2(local[:, 2], -local[:, 0])])

    def embed(self, at: Array) -> Array:
        """Return the points (n, 3) of (s, phi) (n, 2) on a pipe along y."""
        r, phi = self.radius, at[:, 1]
        return np.column_stack([-r * np.cos(phi), at[:, 0], r * np.sin(phi)])


class Seam:
    """One true weld: an oblique plane's cut, or a line along the axis."""

    def __init__(self, weld: dict[str, Any], tube: Tube) -> None:
        self.tube, angle, around = tube, weld["angle_deg"], math.radians(weld["around_deg"])
        self.along, self.half = angle == 90.0, weld["half_width_m"]
        phi = np.linspace(-math.pi, math.pi, 40001)
        if self.along:
            self.phi0 = around + weld["offset_m"] / tube.radius
            s = np.linspace(-tube.half, tube.half, 40001)
            self.line = np.column_stack([s, np.full(len(s), self.phi0)])
        else:
            self.offset, self.slope, self.around = (
                weld["offset_m"], tube.radius * math.tan(math.radians(angle)), around
            )  # fmt: skip
            self.line = np.column_stack([self._place(phi), phi])
            self.line = self.line[np.abs(self.line[:, 0]) <= tube.half]
        self.tree = cKDTree(tube.embed(self.line))

    def _place(self, phi: Array) -> Array:
        return np.asarray(self.offset + self.slope * np.sin(phi - self.around))

    def measure(self, at: Array) -> Array:
        """Return signed distances (n,) m."""
        far = self.tree.query(self.tube.embed(at))[0]
        if self.along:
            off = at[:, 1] - self.phi0
            return np.asarray(far * np.sign(np.arctan2(np.sin(off), np.cos(off))))
        return np.asarray(far * np.sign(at[:, 0] - self._place(at[:, 1])))

    def find_crossings(self, at: Array, broken: NDArray[np.bool_]) -> list[int]:
        """Return the samples of a path `at` (n, 2) with a clear crossing; `broken` (n,): the path
        restarts."""
        d, out, last = self.measure(at), list[int](), None
        for i in range(len(at)):
            if broken[i]:
                last = None
            if abs(d[i]) < SIDE_M:
                continue
            if last is not None and np.sign(d[i]) != np.sign(d[last]):
                nearest = last + int(np.argmin(np.abs(d[last : i + 1])))
                if abs(d[nearest]) < SIDE_M:  # the sign also changes at the far side of the pipe
                    out.append(nearest)
            last = i
        return out

    def find_along(self, at: Array, broken: NDArray[np.bool_]) -> list[Array]:
        """Return the parts of a path, as points (n, 3), that stay on the weld for ALONG_M."""
        on = np.concatenate([[False], (np.abs(self.measure(at)) < self.half) & ~broken, [False]])
        edges = np.flatnonzero(np.diff(on.astype(int)))
        crossed = self.find_crossings(at, broken)
        pieces = []
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            way = self.tube.embed(at[a:b])
            length = float(np.linalg.norm(way[-1] - way[0]))
            if length > ALONG_M and not any(a <= k < b for k in crossed):
                pieces.append(way)
        return pieces


def build_request(task: Any, tube_radius: float) -> Array:
    """Return the requested pattern, (n, 2) s and phi, in steps of a millimetre."""
    sides = {"side": 0.0, "top": 90.0, "underside": -90.0}
    middle = math.radians(sides.get(task.side, task.centre_angle_deg))
    arc, half = math.radians(task.arc_deg), 0.5 * task.pass_length_m
    low, high = task.centre_s_m - half, task.centre_s_m + half
    if task.pattern == "line":
        corners = [(low, middle), (high, middle)]
    elif task.pattern == "spiral":
        corners = [
            (low + (high - low) * i / task.passes, middle + (0.5 - i % 2) * arc)
            for i in range(task.passes + 1)
        ]
    else:
        corners = []
        for i in range(task.passes):
            phi = middle + (arc * (0.5 - i / (task.passes - 1)) if task.passes > 1 else 0.0)
            ends = (low, high) if i % 2 == 0 else (high, low)
            corners += [(ends[0], phi), (ends[1], phi)]
    out = []
    for a, b in zip(np.array(corners)[:-1], np.array(corners)[1:], strict=True):
        n = max(2, math.ceil(math.hypot(b[0] - a[0], tube_radius * (b[1] - a[1])) / 1e-3))
        out.append(a + np.linspace(0.0, 1.0, n)[:, None] * (b - a))
    return np.concatenate(out)


def place_request(asked: Array, good: cKDTree, tube: Tube, plant: Any) -> Array:
    """Return the request shifted, by at most the map's error, to where most of it was passed."""

    def miss(shift: Array) -> float:
        far = good.query(tube.embed(asked[::4] + shift), distance_upper_bound=0.05)[0]
        return float(np.mean(np.minimum(far, 0.05)))

    room = np.array([plant.map_error_m, math.radians(plant.map_error_deg)])
    room[1] += plant.map_error_m / tube.radius
    best, step = np.zeros(2), room / 4.0
    tries = [best + [i * step[0], j * step[1]] for i in range(-4, 5) for j in range(-4, 5)]
    best = min(tries, key=miss)
    for _ in range(6):
        step = step / 2.0
        near = [best + [i * step[0], j * step[1]] for i in (-1, 0, 1) for j in (-1, 0, 1)]
        best = min(near, key=miss)
    return asked + best


def judge_scan(d: Description[Any], told: dict[str, Any], s: Any) -> list[str]:
    """Return what a weld scan did not do or report of its request."""
    task, tube, missing = d.mission.task, Tube(d.true_world.pipe), list[str]()
    spans = [(p["start_s"], p["end_s"]) for p in told["phases"] if p["name"] == "scan"]
    scan = np.any([(s["t"] >= a) & (s["t"] <= b) for a, b in spans], axis=0)
    if not np.any(scan):
        return ["there was no scan"]
    s_all, s = s, s[scan]
    at, gap = tube.unroll(s["p_WT"]), s["gap_max"]
    good = (gap < GAP_M) & (s["tilt"] < TILT_RAD)
    if not np.any(good):
        return ["never in contact"]
    tree = cKDTree(tube.embed(at[good]))
    asked = place_request(build_request(task, tube.radius), tree, tube, d.plant)
    share = float(np.mean(tree.query(tube.embed(asked))[0] < NEAR_M))
    if share < COVERED:
        missing.append(f"{share:.3f} of the request covered")
    off = cKDTree(tube.embed(asked)).query(tube.embed(at))[0]
    rms = float(np.sqrt(np.mean(off**2)))
    if rms > TRACKED_M:
        missing.append(f"tip {1e3 * rms:.1f} mm rms off the request")
    away = gap >= GAP_M
    dt = float(np.median(np.diff(s["t"])))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], away.astype(int), [0]])))
    longest = dt * float(np.max(edges[1::2] - edges[::2], initial=0))
    gusty = d.world.wind.kind in ("dryden", "fan")
    if longest > (AWAY_S if gusty else 0.0):
        missing.append(f"gap above 1 mm for {longest:.2f} s")
    if float(np.max(s["off_s"])) > AWAY_S:
        missing.append(f"without force for {float(np.max(s['off_s'])):.2f} s")
    if float(np.max(s["tilt"])) >= TILT_RAD:
        missing.append(f"tilt {math.degrees(float(np.max(s['tilt']))):.1f} deg")
    if np.any(s_all["f_collision"] > TOUCH_N):
        missing.append("touched something else")
    return missing + judge_welds(d, told, tube, at, np.diff(s["t"], prepend=s["t"][0]) > 0.1)


def judge_welds(
    d: Description[Any], told: dict[str, Any], tube: Tube, at: Array, broken: NDArray[np.bool_]
) -> list[str]:
    """Return the missed welds and crossings, and reported ones that do not exist."""
    world = d.true_world.model_dump()
    tables = [w for w in (world["weld"], *world.get("welds", {}).values()) if w and w["present"]]
    seams, missing = [Seam(w, tube) for w in tables], list[str]()
    found = told.get("result") or {"lines": [], "crossings": []}
    places = np.array([x["p_m"] for x in found["crossings"]]).reshape(-1, 3)
    reported = tube.embed(tube.unroll(places))
    lines = [tube.unroll(line["points_m"]) for line in found["lines"]]
    taken, spots = set[int](), list[Array]()
    for k, seam in enumerate(seams):
        crossed = at[seam.find_crossings(at, broken)].reshape(-1, 2)
        mine_spots = tube.embed(crossed)
        spots += list(mine_spots)
        for piece in seam.find_along(at, broken):
            if not len(reported) or cKDTree(reported).query(piece)[0].min() > REPORTED_M:
                missing.append(f"a pass along weld {k + 1} was not told")
        mine = [
            i for i, line in enumerate(lines) if float(np.max(np.abs(seam.measure(line)))) < LINE_M
        ]
        taken |= set(mine)
        width = max(
            (float(np.linalg.norm(a - b)) for a in mine_spots for b in mine_spots), default=0.0
        )
        if width > APART_M and len(mine) != 1:
            near = min((float(np.max(np.abs(seam.measure(x)))) for x in lines), default=math.nan)
            missing.append(f"{len(mine)} lines for weld {k + 1} (nearest {1e3 * near:.1f} mm off)")
    apart = list[Array]()
    for spot in spots:  # signals of crossing welds merge
        if all(float(np.linalg.norm(spot - x)) > REPORTED_M for x in apart):
            apart.append(spot)
    spots = apart
    free = list(reported)  # each reports one crossing: the nearest pairs first
    pairs = sorted(
        (float(np.linalg.norm(a - b)), i, j)
        for i, a in enumerate(spots)
        for j, b in enumerate(free)
    )
    used: tuple[set[int], set[int]] = (set(), set())
    for far, i, j in pairs:
        if far < REPORTED_M and i not in used[0] and j not in used[1]:
            used[0].add(i)
            used[1].add(j)
            here = tube.unroll(places[j : j + 1])
            if min(abs(float(w.measure(here)[0])) for w in seams) > LINE_M:
                missing.append("a crossing was told beside its weld")
    missing += ["a crossing was not told"] * (len(spots) - len(used[0]))
    missing += [f"line {i + 1} is no weld" for i in range(len(lines)) if i not in taken]
    for x in tube.unroll(places) if len(places) else ():
        if min((abs(float(w.measure(x[None])[0])) for w in seams), default=1.0) > REPORTED_M:
            missing.append("a crossing was told where there is no weld")
    return missing
