"""Time parametrisation of a path: the fastest motion within the limits, or of a given duration.

Corners become parabolas if these keep all margins (certified); otherwise the motion stops there.
Along the curve c(s) with known c' and c'', the limits on speeds and accelerations bound the path
speed and its change. A backward and a forward pass over a grid of s give the fastest motion
(time-optimal path parametrisation: Bobrow et al. 1985; the passes of Pham and Pham, T-RO 2018).
Tilt and rotors bound the platform's acceleration. s(t) may then be averaged over a time window. An
average over one period of the passive joint leaves no residual swing (an input shaper: Singer and
Seering 1990, here a box instead of impulses) and does not change the path. The swing of the passive
joint is simulated along the motion, and time is stretched until it stays within its limit.
"""

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.core.compiled import helper
from skywright.core.user_code import njit
from skywright.errors import InfeasibleError
from skywright.planning.motion.edges import is_edge_free
from skywright.planning.motion.space import Scratch, Space, build_scratch

ROW = 0.02  # s, between the rows of a timed path
GRID = 0.01  # spacing of the grid in path length, cost (6)
CHORDS = 16  # number of chords of a parabola
STRETCH = 1.05  # factor on time while the swing is too large


class TimeLimits(NamedTuple):
    """Limits of a motion."""

    speed: float = 1.0  # m/s, platform
    acceleration: float = 0.8  # m/s^2
    joint_rate: float = 0.8  # rad/s
    joint_acceleration: float = 1.5  # rad/s^2
    tilt: float = math.radians(20.0)  # of the platform
    thrust: float = math.inf  # N, sum of all rotors
    mass: float = 1.0  # kg, total
    gravity: float = 9.81  # m/s^2
    swing: float = math.radians(8.0)  # of the passive joint about its equilibrium
    smooth: float = 0.0  # s, over which the motion along the path is averaged


class Timed(NamedTuple):
    """A path with its times."""

    t: Array  # (m,) s, from 0, `ROW` apart; the last step may be shorter
    c: Array  # (m, n) coordinates
    cd: Array  # (m, n) a second
    cdd: Array  # (m, n)
    swing: float  # rad, largest of the simulated passive joint; 0 without one

    @property
    def duration(self) -> float:
        """Duration (s)."""
        return float(self.t[-1])


def compute_acceleration_limits(limits: TimeLimits) -> tuple[float, float]:
    """Return (horizontal, vertical) limits (m/s^2) within tilt, rotors and `acceleration`.

    The vertical part is fixed first (at most half the acceleration), so that the horizontal one can
    use tan(tilt) (g - a_z) and the thrust sqrt(a_x^2 + (g + a_z)^2) m. Raises InfeasibleError if
    the rotors cannot carry the weight.
    """
    spare = limits.thrust / limits.mass - limits.gravity
    if spare <= 0.0:
        raise InfeasibleError(
            f"the rotors produce at most {limits.thrust:.1f} N, robot and load weigh "
            f"{limits.mass * limits.gravity:.1f} N",
            "thrust",
        )
    vertical = min(0.5 * limits.acceleration, 0.5 * spare)
    by_tilt = math.tan(limits.tilt) * (limits.gravity - vertical)
    by_rotors = math.inf
    if math.isfinite(limits.thrust):
        total = limits.thrust / limits.mass
        by_rotors = math.sqrt(max(total**2 - (limits.gravity + vertical) ** 2, 0.0))
    flat = math.sqrt(max(limits.acceleration**2 - vertical**2, 0.0))
    return min(flat, by_tilt, by_rotors), vertical


class Curve(NamedTuple):
    """Samples of c(s) between which c'' is constant."""

    s: Array  # (k,)
    c: Array  # (k, n)
    d: Array  # (k, n) c'
    dd: Array  # (k - 1, n) c'' in each interval
    stop: Mask  # (k,) the motion stops here, at a sharp corner


@njit(cache=True, error_model="numpy")
def _are_chords_free(space: Space, scratch: Scratch, points: Array) -> bool:
    for i in range(points.shape[0] - 1):
        if not is_edge_free(space[0], points[i], points[i + 1], scratch[0]):
            return False
    return True


def build_curve(space: Space, rows: Array, blend: float = 0.4) -> Curve:
    """Round the corners of a path; `blend` is the largest half length of a parabola in cost (6).

    A parabola that violates a margin is halved up to six times; then the corner becomes a stop.
    """
    weight = space[0]["weight"][: rows.shape[1]]
    keep = [0]
    for i in range(1, len(rows)):
        if np.linalg.norm((rows[i] - rows[keep[-1]]) * weight) > 1e-6:
            keep.append(i)
    rows = rows[keep]
    if len(rows) < 2:
        return Curve(
            np.zeros(1), rows, np.zeros_like(rows), np.zeros((0, rows.shape[1])),
            np.ones(1, dtype=np.bool_),
        )  # fmt: skip
    edges = np.diff(rows, axis=0)
    lengths = np.linalg.norm(edges * weight, axis=1)
    units = edges / lengths[:, None]
    scratch = build_scratch(space)
    half = np.zeros(len(rows))
    for i in range(1, len(rows) - 1):
        b = min(blend, 0.45 * lengths[i - 1], 0.45 * lengths[i])
        for _ in range(7):
            if _are_chords_free(space, scratch, _parabola(rows[i], units[i - 1], units[i], b)):
                half[i] = b
                break
            b /= 2
    s, c, d, dd, stop = [0.0], [rows[0]], [units[0]], [], [True]

    def add(length: float, first: Array, last: Array, pieces: int) -> None:
        bend = (last - first) / length
        step = length / pieces
        for _ in range(pieces):
            c.append(c[-1] + step * d[-1] + 0.5 * step**2 * bend)
            d.append(d[-1] + step * bend)
            dd.append(bend)
            s.append(s[-1] + step)
            stop.append(False)

    for i in range(len(edges)):
        straight = lengths[i] - half[i] - half[i + 1]
        add(straight, units[i], units[i], max(math.ceil(straight / GRID), 2))
        if i + 1 < len(edges):
            if half[i + 1] > 0.0:
                pieces = max(math.ceil(2 * half[i + 1] / GRID), CHORDS)
                add(2 * half[i + 1], units[i], units[i + 1], pieces)
            else:
                stop[-1] = True
            d[-1] = units[i + 1]
    stop[-1] = True
    return Curve(np.array(s), np.array(c), np.array(d), np.array(dd), np.array(stop))


def _parabola(corner: Array, u: Array, v: Array, b: float) -> Array:
    t = np.linspace(0.0, 1.0, CHORDS + 1)[:, None]
    return (corner - b * u) * (1 - t) ** 2 + 2 * corner * t * (1 - t) + (corner + b * v) * t**2


@helper
def _change_limits(d: Array, dd: Array, x: float, most: Array) -> tuple[float, float]:
    """Return the smallest and largest s'' with |c'' x + c' s''| <= most, for x = s'^2."""
    low, high = -1e18, 1e18
    for j in range(d.shape[0]):
        a = dd[j] * x
        if abs(d[j]) < 1e-9:
            if abs(a) > most[j] * (1.0 + 1e-9):
                return 1.0, -1.0
            continue
        p, q = (-most[j] - a) / d[j], (most[j] - a) / d[j]
        low, high = max(low, min(p, q)), min(high, max(p, q))
    return low, high


@njit(cache=True, error_model="numpy")
def _fastest(s: Array, d: Array, dd: Array, stop: Mask, top: Array, most: Array) -> Array:
    """Return x = s'^2 (k,) of the fastest motion; `top` (k,) bounds x, `most` (n,) |acceleration|.

    An interval's limits hold at both of its ends, with its own c''.
    """
    k = s.shape[0]
    can = np.zeros(k)  # largest x from which the motion can still stop in time
    for i in range(k - 2, -1, -1):
        if stop[i]:
            continue
        step = s[i + 1] - s[i]
        low, high = 0.0, top[i]
        for trial in range(50):
            x = high if trial == 0 else 0.5 * (low + high)
            least, largest = _change_limits(d[i], dd[i], x, most)
            to = can[i + 1]
            # s'' brings x to at most `to` at the other end
            needed = (to - x) / (2.0 * step)
            fine = least <= largest and least <= needed
            if fine and x > to:
                a, b = _change_limits(d[i + 1], dd[i], to, most)
                fine = a <= needed <= b
            if fine:
                low = x
                if trial == 0:
                    break
            else:
                high = x
        can[i] = low
    x = np.zeros(k)
    for i in range(k - 1):
        step = s[i + 1] - s[i]
        _, largest = _change_limits(d[i], dd[i], x[i], most)
        x[i + 1] = min(can[i + 1], x[i] + 2.0 * step * max(largest, 0.0))
        for _ in range(60):  # limits at the other end, where c'' applies with the new speed
            a, b = _change_limits(d[i + 1], dd[i], x[i + 1], most)
            change = (x[i + 1] - x[i]) / (2.0 * step)
            if a <= b and change <= b + 1e-9:
                break
            x[i + 1] = 0.5 * (x[i + 1] + x[i]) if x[i + 1] > x[i] else x[i + 1] * 0.97
    return x


def assign_times(
    space: Space,
    rows: Array,
    limits: TimeLimits,
    *,
    duration: float | None = None,
    swing: Callable[[Array, Array, Array, Array], float] | None = None,
) -> Timed:
    """Time a path: as fast as the limits allow, or in `duration` s.

    `swing` returns the largest swing (rad) of a motion (t, c, cd, cdd); see `swing.build_swing`.
    A path without length has two rows at rest. Raises InfeasibleError if `duration` is shorter than
    the fastest motion.
    """
    curve = build_curve(space, rows)
    n, n_move = rows.shape[1], int(space[0]["n_move"])
    if len(curve.s) < 2:
        still, end = np.zeros((2, n)), ROW if duration is None else max(duration, ROW)
        return Timed(np.array([0.0, end]), rows[[0, 0]], still, still, 0.0)
    flat, vertical = compute_acceleration_limits(limits)
    most = np.full(n, limits.joint_acceleration)
    up = space[0]["map"][2, :n] != 0.0
    most[:n_move] = np.where(
        up[:n_move], vertical, flat / math.sqrt(max(n_move - int(up.sum()), 1))
    )
    speed = np.linalg.norm(curve.d[:, :n_move], axis=1)
    rate = np.max(np.abs(curve.d[:, n_move:]), axis=1, initial=0.0)
    with np.errstate(divide="ignore"):
        top = np.minimum(limits.speed / speed, limits.joint_rate / rate) ** 2
    bend = np.zeros((len(curve.s), n))
    bend[:-1] = np.abs(curve.dd)
    bend[1:] = np.maximum(bend[1:], np.abs(curve.dd))
    with np.errstate(divide="ignore"):
        top = np.minimum(top, np.min(np.where(bend > 0, most / bend, np.inf), axis=1))
    x = _fastest(curve.s, curve.d, curve.dd, curve.stop, top, most)
    v = np.sqrt(x)
    at = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(curve.s) / (v[:-1] + v[1:]))])
    stretches = int(curve.stop.sum()) - 1
    least = float(at[-1]) + stretches * limits.smooth
    factor = 1.0
    if duration is not None:
        if duration < least - 1e-9:
            raise InfeasibleError(
                f"the motion requires {least:.2f} s; requested: {duration:g} s", "duration"
            )
        factor = (duration - stretches * limits.smooth) / at[-1]
    for _ in range(200):
        timed = _sample(curve, x, at, factor, limits.smooth)
        # averaging raises the speed in bends that the fastest motion takes slowly
        over = limits.smooth > 0.0 and _exceeds(timed, limits, n_move, most)
        peak = 0.0 if swing is None or over else swing(timed.t, timed.c, timed.cd, timed.cdd)
        timed = timed._replace(swing=peak)
        if not over and peak <= limits.swing:
            return timed
        if duration is not None:
            what = (
                f"speeds or accelerations exceed their limits in {duration:g} s"
                if over
                else f"in {duration:g} s the passive joint swings by {math.degrees(peak):.1f} deg "
                f"> {math.degrees(limits.swing):.1f} deg"
            )
            raise InfeasibleError(what, "swing")
        factor *= STRETCH
    raise InfeasibleError("the passive joint swings too far at any speed", "swing")


def _exceeds(timed: Timed, limits: TimeLimits, n_move: int, most: Array) -> bool:
    """Return whether a speed exceeds its limit, or an acceleration exceeds `most` (n,)."""
    return bool(
        np.any(np.linalg.norm(timed.cd[:, :n_move], axis=1) > limits.speed * (1.0 + 1e-3))
        or np.any(np.abs(timed.cd[:, n_move:]) > limits.joint_rate * (1.0 + 1e-3))
        or np.any(np.abs(timed.cdd) > most * (1.0 + 1e-3))
    )


class _Stretch(NamedTuple):
    """s(t) between two stops: knots with s, s', s'' and the integral of s; t from 0."""

    t: Array  # (k,) s
    s: Array
    v: Array
    a: Array  # (k - 1,)
    area: Array  # (k,)

    def find(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Return s, s', s'' and the integral of s at times t (n,), at rest outside."""
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.a) - 1)
        end = self.t[-1]
        h = np.clip(t, 0.0, end) - self.t[i]
        inside = (t > 0.0) & (t < end)
        s = self.s[i] + h * (self.v[i] + 0.5 * h * self.a[i])
        area = self.area[i] + h * (self.s[i] + h * (self.v[i] / 2 + h * self.a[i] / 6))
        area += np.minimum(t, 0.0) * self.s[0] + np.maximum(t - end, 0.0) * self.s[-1]
        v = np.where(inside, self.v[i] + h * self.a[i], 0.0)
        return s, v, np.where(inside, self.a[i], 0.0), area


def _build_stretch(s: Array, x: Array, at: Array, factor: float) -> _Stretch:
    t, v = factor * (at - at[0]), np.sqrt(x) / factor
    a = (x[1:] - x[:-1]) / (2.0 * np.diff(s)) / factor**2
    h = np.diff(t)
    area = np.cumsum(h * (s[:-1] + h * (v[:-1] / 2 + h * a / 6)))
    return _Stretch(t, s, v, a, np.concatenate([[0.0], area]))


def _sample(curve: Curve, x: Array, at: Array, factor: float, smooth: float) -> Timed:
    """Return rows every `ROW` s of the motion x = s'^2, stretched by `factor`, then averaged."""
    stops = np.flatnonzero(curve.stop)
    stretches = [
        _build_stretch(curve.s[i : j + 1], x[i : j + 1], at[i : j + 1], factor)
        for i, j in itertools.pairwise(stops)
    ]
    start = np.concatenate([[0.0], np.cumsum([w.t[-1] + smooth for w in stretches])])
    total = float(start[-1])
    t = np.arange(0.0, total, ROW)
    t = np.append(t[: max(len(t) - 1, 1)] if total - t[-1] < 1e-9 else t, total)
    part = np.clip(np.searchsorted(start, t, side="right") - 1, 0, len(stretches) - 1)
    s, v, a = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
    piece = np.empty(len(t), dtype=np.int64)
    for k, way in enumerate(stretches):
        mine = part == k
        since = t[mine] - start[k]
        now = way.find(since)
        if smooth > 0.0:
            before = way.find(since - smooth)
            s[mine] = (now[3] - before[3]) / smooth
            v[mine], a[mine] = (now[0] - before[0]) / smooth, (now[1] - before[1]) / smooth
        else:
            s[mine], v[mine], a[mine] = now[:3]
        first, last = int(stops[k]), int(stops[k + 1])
        i = np.searchsorted(curve.s, s[mine], side="right") - 1
        piece[mine] = np.clip(i, first, last - 1)
    along = np.clip(s - curve.s[piece], 0.0, np.diff(curve.s)[piece])[:, None]
    d, bend = curve.d[piece], curve.dd[piece]
    # after a stop the direction at the grid point is that of the next interval
    c = curve.c[piece] + along * d + 0.5 * along**2 * bend
    slope = d + along * bend
    cd = slope * v[:, None]
    cdd = slope * a[:, None] + bend * v[:, None] ** 2
    cd[0] = cd[-1] = 0.0
    c[-1] = curve.c[-1]
    return Timed(t, c, cd, cdd, 0.0)
