"""Noise of fixes that is larger than believed, found from the scatter of rejected fixes.

Fixes that contradict the estimate in a row have one of two causes. Either the estimate is wrong:
the innovations then change smoothly. Or the fixes are noisier than believed: the innovations then
scatter. Third differences in time tell these apart, because they remove errors of the estimate up
to a constant acceleration.
"""

from __future__ import annotations

from typing import Annotated, Any

from skywright.core.record import Array, Record
from skywright.vehicle.component import helper
from skywright.vehicle.estimators._strapdown import N_STATE

ROW = 10  # rejected fixes in a row after which noise or estimate counts as wrong


class Scatter(Record):
    """Innovations of the newest rejected fixes."""

    rejected: int  # fixes that the gate rejected so far
    row: Annotated[Array, ROW, 6]  # m, then rad; that of fix number k is at k % ROW


@helper
def keep_innovation(me: Any, nu: Any) -> None:
    """Store the innovation (6 or fewer,) of a rejected fix."""
    for i in range(len(nu)):
        me.row[me.rejected % ROW, i] = nu[i]
    me.rejected += 1


@helper
def compute_scatter(me: Any, first: int, n: int) -> float:
    """Return the variance of the noise of the numbers first..first+n-1 of the last ROW fixes."""
    total = 0.0
    for k in range(me.rejected, me.rejected + ROW - 3):  # from the oldest of them
        for i in range(first, first + n):
            a, b = me.row[k % ROW, i], me.row[(k + 1) % ROW, i]
            c, d = me.row[(k + 2) % ROW, i], me.row[(k + 3) % ROW, i]
            total += (d - 3.0 * c + 3.0 * b - a) ** 2
    return total / (20.0 * n * (ROW - 3))  # 20 = 1 + 9 + 9 + 1


@helper
def widen(me: Any, ratio: float) -> None:
    """Multiply the covariance, which was computed with too small a noise, by a ratio."""
    for i in range(N_STATE):
        for j in range(N_STATE):
            me.P[i, j] *= ratio
