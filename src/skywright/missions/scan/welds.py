"""Evaluation of a scan's welds against the true welds on its path.

The expected welds follow from the request: the requested pattern on the true pipe, and the true
welds. Without a weld on the pipe, or with a pattern beside it, nothing is expected, and any
reported weld is a false alarm.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from skywright.core.arrays import Array
from skywright.description.world.surface import (
    Cylinder,
    WeldCurve,
    build_weld_curve,
    roll_points,
    unroll_points,
)
from skywright.inspection.crossings import CLEAR
from skywright.inspection.weld import LONG_LENGTH, WeldResult
from skywright.inspection.weld_line import compute_line_error
from skywright.missions.scan.carried_weld import carry_weld
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.resolution import is_faint, is_merged
from skywright.missions.scan.task import Scan
from skywright.run.flight import Flown
from skywright.run.kind import Measures

NEAR = 0.015
"""m: a crossing within this distance belongs to the weld, or to the expected crossing."""
MERGED = 0.015
"""m: two welds that are crossed this close to each other may have one common peak."""
APART = 0.02
"""m: least distance of two crossings of one weld that define a line."""

WELD_MEASURES: Measures = {
    "weld.contact_fraction": ("", "fraction of the scan in contact, from the instrument's signal"),
    "weld.crossings": ("", "number of detected weld crossings"),
    "weld.expected": (
        "",
        "number of crossings expected from the requested pattern: it crosses a weld with "
        "10 mm on both sides, or runs along a weld for 35 mm",
    ),
    "weld.missed": (
        "",
        "number of expected crossings without a detected crossing within 15 mm; each detected "
        "crossing counts once",
    ),
    "weld.crossing_error_mm": (
        "mm",
        "largest distance of a detected expected crossing from its weld",
    ),
    "weld.contrast": (
        "",
        "signal of a detected weld (median of its crossings) over the detection threshold; weakest "
        "weld; below 2, crossings can be missed",
    ),
    "weld.lines": ("", "number of detected weld lines"),
    "weld.lines_missed": (
        "",
        "number of welds without a line, of those with two expected crossings at least 20 mm apart "
        "that the probe can resolve",
    ),
    "weld.unresolved": (
        "",
        "number of welds without a line that the probe cannot resolve: closer to another weld "
        "than both half-widths and the coil's 3.5 mm, or with a signal below the threshold and "
        "twice the texture's deviation",
    ),
    "weld.false_alarms": (
        "",
        "number of detected crossings more than 15 mm from any weld, plus detected lines "
        "that match no weld",
    ),
    "weld.line_error_mm": (
        "mm",
        "largest distance of a detected line from its weld, between its first and last crossing",
    ),
    "weld.offset_error_mm": (
        "mm",
        "distance of a detected line from its weld at the centre of its crossings; worst line",
    ),
    "weld.angle_error_deg": (
        "deg",
        "angle between a detected line and its weld at the centre of its crossings; worst line",
    ),
    "weld.offset_std_mm": (
        "mm",
        "standard deviation of a line's offset, as stated by the fit; worst line",
    ),
    "weld.angle_std_deg": (
        "deg",
        "standard deviation of a line's angle on the believed surface, as stated by the fit; "
        "worst line",
    ),
}
"""Metrics of `judge_welds`."""
ERRORS = ("weld.line_error_mm", "weld.offset_error_mm", "weld.angle_error_deg")
"""Metrics of lines, which are meaningless if no line is expected."""


class Expected(NamedTuple):
    """Expected crossings of one weld."""

    curve: WeldCurve  # on the true pipe
    crossings: Array  # (n, 2) s, c m on the true pipe
    along: list[Array]  # (k, 2) s, c m each: pieces of the path that run along it
    shows_line: bool


def find_expected(curve: WeldCurve, s: Array, c: Array, half_width: float = 0.0) -> Expected:
    """Return where a path, (n,) `s` and `c` (m) on the true pipe, crosses a weld."""
    d = np.abs(curve.measure_distance(s, c))
    side = np.sign(curve.measure_distance(s, c))
    clear = np.flatnonzero(d > CLEAR)
    change = np.flatnonzero(np.diff(side[clear]))
    at = [
        a + int(np.argmin(d[a:b]))
        for a, b in zip(clear[change], clear[change + 1], strict=True)
        if np.min(d[a:b]) < CLEAR  # the sign also changes at the far side of the pipe
    ]
    path, places = np.column_stack([s, c]), np.column_stack([s[at], c[at]])
    far = max((math.dist(a, b) for a in places for b in places), default=0.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], d < half_width, [False]]).astype(int)))
    along = [
        path[a:b]
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if np.sum(np.hypot(*np.diff(path[a:b], axis=0).T)) > LONG_LENGTH
        and not any(a <= k < b for k in at)
    ]
    return Expected(curve, places, along, far > APART)


def judge_welds(
    run: Flown[Scan, ScanWay], weld: WeldResult, path: tuple[Array, Array]
) -> dict[str, float]:
    """Evaluate the reported welds; `path` is the pattern (n,) s, c (m) on the true pipe."""
    world, true = run.setup.true.world, run.setup.true.cylinder
    assert true is not None
    welds = world.list_welds()
    expected = [
        find_expected(build_weld_curve(w, true.radius), *path, w.half_width_m) for w in welds
    ]
    s, c, _ = unroll_points(true, np.array([x.p_W for x in weld.crossings]).reshape(-1, 3))
    places = np.column_stack([s, c])
    owners, errors = [], []
    for k in range(len(weld.lines)):
        off = [_find_line_distance(weld, k, true, e.curve) for e in expected]
        owners.append(int(np.argmin(off)) if off and min(off) < APART else -1)
        if owners[-1] >= 0:
            errors.append((min(off), *_find_line_errors(run, weld, k, owners[-1])))
    found = {i for i in owners if i >= 0}
    lacking = {i for i, e in enumerate(expected) if e.shows_line and i not in found}
    faint = {i for i in lacking if world.pipe and is_faint(world.pipe, welds[i], weld)}
    merged = {
        i for i in lacking
        if is_merged(i, welds, [e.crossings for e in expected], true.radius)
    }  # fmt: skip
    shown = [e for i, e in enumerate(expected) if i not in faint | merged]
    due = _list_due(true, [x for e in shown for x in (*e.crossings, *e.along)])
    away = [_find_distances(true, places, x) for x in due]
    out = {
        "weld.contact_fraction": weld.contact_fraction,
        "weld.crossings": float(len(places)),
        "weld.expected": float(len(away)),
        "weld.missed": float(len(away) - _count_matches(away)),
        "weld.lines": float(len(weld.lines)),
        "weld.lines_missed": float(len(lacking - faint - merged)),
        "weld.unresolved": float(len(faint | merged)),
    }
    contrasts = [x for x in weld.contrasts if not math.isnan(x)]
    if contrasts:
        out["weld.contrast"] = min(contrasts)
    far = np.array([np.abs(e.curve.measure_distance(s, c)) for e in expected])
    far = far.reshape(len(expected), len(s))
    nearest = np.min(far, axis=0, initial=math.inf)
    clear = [x for e in expected for x in e.crossings]
    beside = [
        d for d, x in zip(nearest, places, strict=True)
        if np.min(_find_distances(true, np.array(clear).reshape(-1, 2), x), initial=1.0) < NEAR
    ]  # fmt: skip
    if beside:
        out["weld.crossing_error_mm"] = 1e3 * float(np.max(beside))
    out["weld.false_alarms"] = float(np.sum(nearest > NEAR) + len(owners) - len(found))
    if errors:
        worst, offset, angle = np.max(np.abs(errors), axis=0).tolist()
        out["weld.line_error_mm"], out["weld.offset_error_mm"] = 1e3 * worst, 1e3 * offset
        out["weld.angle_error_deg"] = math.degrees(angle)
    if weld.lines:
        out["weld.offset_std_mm"] = 1e3 * max(x.std_offset for x in weld.lines)
        out["weld.angle_std_deg"] = math.degrees(max(x.std_angle for x in weld.lines))
    return out


def list_waived(metrics: dict[str, float]) -> dict[str, str]:
    """Return the requirements that do not apply if no weld is expected, and the reason."""
    unclear = ("weld.missed", "weld.false_alarms", "weld.unresolved")
    if "weld.lines" not in metrics or any(metrics[name] for name in unclear):
        return {}
    out = dict[str, str]()
    if not metrics["weld.lines"] and not metrics["weld.lines_missed"]:
        out |= dict.fromkeys(ERRORS, "the pattern crosses no weld at two places 20 mm apart")
    if "weld.crossing_error_mm" not in metrics:
        out["weld.crossing_error_mm"] = "the pattern crosses no weld from side to side"
    return out


def _list_due(cylinder: Cylinder, expected: list[Array]) -> list[Array]:
    """Return the expected crossings, merging those within MERGED: where welds meet."""
    due = list[Array]()
    for x in expected:
        ends = np.concatenate([np.atleast_2d(y)[[0, -1]] for y in due] or [np.zeros((0, 2))])
        if np.min(_find_distances(cylinder, ends, x), initial=1.0) > MERGED:
            due.append(x)
    return due


def _find_distances(cylinder: Cylinder, places: Array, x: Array) -> Array:
    """Return distances (n,) m over the surface of `places` (n, 2) from a point, or from a path."""
    apart = places[:, None, :] - np.atleast_2d(x)[None]
    around = cylinder.radius * np.angle(np.exp(1j * apart[..., 1] / cylinder.radius))
    return np.asarray(np.min(np.hypot(apart[..., 0], around), axis=1))


def _count_matches(away: list[Array]) -> int:
    """Return the number of expected crossings with a reported one within NEAR, each used once."""
    if not away or not len(away[0]):
        return 0
    cost = np.minimum(np.array(away), 1.0) + (np.array(away) > NEAR)
    rows, columns = linear_sum_assignment(cost)
    return int(np.count_nonzero(cost[rows, columns] <= NEAR))


def _find_line_distance(weld: WeldResult, k: int, true: Cylinder, curve: WeldCurve) -> float:
    """Return the largest distance (m) of a line from a weld, between its outermost crossings."""
    line = weld.lines[k]
    at = np.array([[x.s, x.c] for x in weld.list_crossings(k)] or [[line.s, line.c]])
    ways = line.find_ways(at[:, 0], at[:, 1])
    p, _ = roll_points(weld.surface, *line.follow(np.linspace(ways.min(), ways.max(), 21)))
    s, c, _ = unroll_points(true, p)
    return float(np.max(np.abs(curve.measure_distance(s, c))))


def _find_line_errors(
    run: Flown[Scan, ScanWay], weld: WeldResult, k: int, owner: int
) -> tuple[float, float]:
    """Return a line's (offset, angle) errors (m, rad) at the middle of its crossings."""
    line, world = weld.lines[k], run.setup.true.world
    carried = carry_weld(world, world.list_welds()[owner], weld.surface, np.array([line.s, line.c]))
    return compute_line_error(line, carried, weld.surface.radius)
