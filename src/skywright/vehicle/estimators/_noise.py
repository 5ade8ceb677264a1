"""Noise of fixes that is larger than believed, found from the scatter of rejected fixes.

Fixes that contradict the estimate in a row have one of two causes. Either the estimate or the
sensor is wrong: the innovations then change smoothly, or by more than MOST. Or the fixes are
noisier than believed: the innovations then scatter. Third differences in time tell these apart,
because they remove errors of the estimate up to a constant acceleration.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from skywright.core.record import Array, Record
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._strapdown import BA_, BG_, N_STATE, R_

ROW = 10  # rejected fixes in a row after which noise or estimate counts as wrong
KNOWN_AFTER = 400  # fixes for noise within 2 %: the error of a variance is sqrt(2 / 3n)
LEAST = 2.0  # ratio of variances, below which the scatter of ten fixes may be chance
MOST = 400.0  # times the variance of the data sheet: 20 times its deviation
EARLY = 5  # rejected fixes in a row after which a growing error of the estimate is recognised
GROWN = 2.0  # ratio of the last and the first innovation in that row
CLEAR = 10.0  # ratio of the last innovation and the deviation of the scatter
EVEN = 1.5  # largest ratio of two intervals of fixes whose differences are compared


class Scatter(Record):
    """Innovations of the newest rejected fixes."""

    rejected: int  # fixes that the gate rejected so far
    row: Annotated[Array, ROW, 6]  # m, then rad; that of fix number k is at k % ROW
    when: Annotated[Array, ROW]  # s, times of these fixes


@helper
def compute_product(before: Any, H: Any, dx: Any, i: int) -> float:
    """Return the product of residual i before and after the correction `dx`.

    Its mean is the variance of the noise (Desroziers et al., Diagnosis of observation, background
    and analysis-error statistics in observation space, 2005, (4)).
    """
    after = before[i]
    for j in range(N_STATE):
        after -= H[i, j] * dx[j]
    return float(before[i] * after)


@helper
def keep_innovation(me: Any, nu: Any, t: float) -> None:
    """Store the innovation (6 or fewer,) of a rejected fix taken at `t` (s)."""
    k = me.rejected % ROW
    for i in range(len(nu)):
        me.row[k, i] = nu[i]
    me.when[k] = t
    me.rejected += 1


@helper
def compute_scatter(me: Any, first: int, n: int, last: int) -> float:
    """Return the variance of the noise of the numbers first..first+n-1 of the `last` fixes.

    At most ROW of them. Infinite if the fixes are not evenly spaced.
    """
    begin = me.rejected + ROW - last  # the oldest of them; ROW keeps it positive
    shortest, longest = math.inf, 0.0
    for k in range(begin, begin + last - 1):
        interval = me.when[(k + 1) % ROW] - me.when[k % ROW]
        shortest, longest = min(shortest, interval), max(longest, interval)
    if not longest <= EVEN * shortest:
        return math.inf
    total = 0.0
    for k in range(begin, begin + last - 3):
        for i in range(first, first + n):
            a, b = me.row[k % ROW, i], me.row[(k + 1) % ROW, i]
            c, d = me.row[(k + 2) % ROW, i], me.row[(k + 3) % ROW, i]
            total += (d - 3.0 * c + 3.0 * b - a) ** 2
    return total / (20.0 * n * (last - 3))  # 20 = 1 + 9 + 9 + 1


@helper
def is_leaving(me: Any) -> bool:
    """Whether the estimate diverges from the last EARLY rejected fixes.

    The innovations of position then grow by GROWN and exceed their scatter by CLEAR. Those of fixes
    that jumped do not grow.
    """
    a, b = (me.rejected + ROW - EARLY) % ROW, (me.rejected + ROW - 1) % ROW
    first = last = 0.0
    for i in range(3):
        first += me.row[a, i] ** 2
        last += me.row[b, i] ** 2
    if last < GROWN**2 * first:
        return False
    return last > CLEAR**2 * 3.0 * compute_scatter(me, 0, 3, EARLY)


@helper
def widen(me: Any, p: float, R: float) -> None:
    """Enlarge the covariance, which was computed with too small a noise.

    Variances of position, velocity and accelerometer bias by the ratio `p`, those of attitude and
    gyroscope bias by `R`; of biases to their values at the start at most.
    """
    for i in range(N_STATE):
        s = math.sqrt(R if R_ <= i < R_ + 3 or BG_ <= i < BG_ + 3 else p)
        if BG_ <= i < BG_ + 3:
            s = min(s, math.sqrt(max(me.p_bg / me.P[i, i], 1.0)))
        elif BA_ <= i < BA_ + 3:
            s = min(s, math.sqrt(max(me.p_ba / me.P[i, i], 1.0)))
        for j in range(N_STATE):
            me.P[i, j] *= s
            me.P[j, i] *= s
