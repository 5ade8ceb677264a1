"""Judge the welds that a scan found against those that its path met, with truth.

What is expected follows the request: the pattern that was asked for, as it lies on the true pipe,
and the true welds. A pipe without a weld, or a pattern beside it, expects nothing; then anything
that is found is a false alarm.
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.surface import (
    Cylinder,
    WeldCurve,
    build_weld_curve,
    roll_points,
    unroll_points,
)
from skywright.inspection.crossings import CLEAR
from skywright.inspection.weld import WeldResult
from skywright.inspection.weld_line import compute_line_error
from skywright.missions.scan.carried_weld import carry_weld
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.task import Scan
from skywright.run.flight import Flown
from skywright.run.kind import Measures

NEAR = 0.015
"""m: within this a crossing that was found is the weld's, or the crossing that was expected."""
APART = 0.02
"""m: crossings of one weld that tell a line stand further apart."""

WELD_MEASURES: Measures = {
    "weld.contact_fraction": ("", "share of the scan in contact, as the instrument says"),
    "weld.crossings": ("", "crossings of the path with a weld that were found"),
    "weld.expected": (
        "", "crossings that the pattern asked for makes with welds, 10 mm from side to side"
    ),
    "weld.missed": ("", "expected crossings with nothing found within 15 mm"),
    "weld.lines": ("", "lines that were found"),
    "weld.lines_missed": ("", "welds with two expected crossings 20 mm apart that have no line"),
    "weld.false_alarms": (
        "", "crossings further than 15 mm from any weld, and lines that are no weld's own"
    ),
    "weld.line_error_mm": (
        "mm", "largest distance of a line from its weld, from its first to its last crossing"
    ),
    "weld.offset_error_mm": (
        "mm", "distance of a line from its weld, at the middle of its crossings; the worst"
    ),
    "weld.angle_error_deg": ("deg", "angle between a line and its weld there; the worst"),
    "weld.offset_std_mm": ("mm", "uncertainty of a line's offset that the fit states; the worst"),
    "weld.angle_std_deg": ("deg", "uncertainty of a line's angle that the fit states; the worst"),
}  # fmt: skip
"""Metrics of `judge_welds`."""
ERRORS = ("weld.line_error_mm", "weld.offset_error_mm", "weld.angle_error_deg")
"""Metrics of lines: without a line to be found they say nothing."""


class Expected(NamedTuple):
    """What the pattern meets of one weld."""

    curve: WeldCurve  # on the true pipe
    crossings: Array  # (n, 2) s, c m on the true pipe
    shows_line: bool


def find_expected(curve: WeldCurve, s: Array, c: Array) -> Expected:
    """Return where a path, (n,) `s` and `c` (m) on the true pipe, clearly crosses a weld."""
    d = curve.measure_distance(s, c)
    clear = np.flatnonzero(np.abs(d) > CLEAR)
    change = np.flatnonzero(np.diff(np.sign(d[clear])))
    at = [
        a + int(np.argmin(np.abs(d[a:b])))
        for a, b in zip(clear[change], clear[change + 1], strict=True)
        if np.min(np.abs(d[a:b])) < CLEAR  # the far side of the pipe changes sign, too
    ]
    places = np.column_stack([s[at], c[at]])
    far = max((math.dist(a, b) for a in places for b in places), default=0.0)
    return Expected(curve, places, far > APART)


def judge_welds(
    run: Flown[Scan, ScanWay], weld: WeldResult, path: tuple[Array, Array]
) -> dict[str, float]:
    """Judge what was found; `path` is the pattern (n,) s, c (m) as it lies on the true pipe."""
    world, true = run.setup.true.world, run.setup.true.cylinder
    assert true is not None
    welds = world.list_welds()
    expected = [find_expected(build_weld_curve(w, true.radius), *path) for w in welds]
    told = [x for x in weld.crossings if x.line >= 0 or not weld.lines]
    s, c, _ = unroll_points(true, np.array([x.p_W for x in told]).reshape(-1, 3))
    places = np.column_stack([s, c])
    out = {
        "weld.contact_fraction": weld.contact_fraction,
        "weld.crossings": float(len(told)),
        "weld.expected": float(sum(len(e.crossings) for e in expected)),
        "weld.missed": float(sum(
            _find_distance(true, places, x) > NEAR for e in expected for x in e.crossings
        )),
        "weld.lines": float(len(weld.lines)),
    }  # fmt: skip
    owners, errors = [], []
    for k in range(len(weld.lines)):
        far = [_find_line_distance(weld, k, true, e.curve) for e in expected]
        owners.append(int(np.argmin(far)) if far and min(far) < APART else -1)
        if owners[-1] >= 0:
            errors.append((min(far), *_find_line_errors(run, weld, k, owners[-1])))
    off = sum(
        min((abs(float(e.curve.measure_distance(*x))) for e in expected), default=math.inf) > NEAR
        for x in places
    )
    found = {i for i in owners if i >= 0}
    out["weld.lines_missed"] = float(
        sum(e.shows_line and i not in found for i, e in enumerate(expected))
    )
    out["weld.false_alarms"] = float(off + len(owners) - len(found))
    if errors:
        far, offset, angle = np.max(np.abs(errors), axis=0).tolist()
        out["weld.line_error_mm"], out["weld.offset_error_mm"] = 1e3 * far, 1e3 * offset
        out["weld.angle_error_deg"] = math.degrees(angle)
    if weld.lines:
        out["weld.offset_std_mm"] = 1e3 * max(x.std_offset for x in weld.lines)
        out["weld.angle_std_deg"] = math.degrees(max(x.std_angle for x in weld.lines))
    return out


def list_waived(metrics: dict[str, float]) -> dict[str, str]:
    """Return the requirements that say nothing where no line was to be found, and why."""
    if metrics.get("weld.lines_missed") or "weld.lines" not in metrics or metrics["weld.lines"]:
        return {}
    return dict.fromkeys(ERRORS, "the pattern crosses no weld twice, so there is no line to find")


def _find_distance(cylinder: Cylinder, places: Array, x: Array) -> float:
    """Return the distance (m) over the surface of the nearest of `places` (n, 2) from `x`."""
    if not len(places):
        return math.inf
    around = cylinder.radius * np.angle(np.exp(1j * (places[:, 1] - x[1]) / cylinder.radius))
    return float(np.min(np.hypot(places[:, 0] - x[0], around)))


def _find_line_distance(weld: WeldResult, k: int, true: Cylinder, curve: WeldCurve) -> float:
    """Return the largest distance (m) of a line from a weld, between its outermost crossings."""
    line = weld.lines[k]
    at = np.array([[x.s - line.s, x.c - line.c] for x in weld.list_crossings(k)] or [[0.0, 0.0]])
    ways = at @ [math.sin(line.angle), math.cos(line.angle)]
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
