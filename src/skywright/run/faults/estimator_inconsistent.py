"""Consecutive measurements that contradict the estimate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor

FAR = 2.0  # m, largest jump of an estimate that is still used
RESTART = 100.0
"""Number of rejections that a restart of the estimator counts as."""


class EstimatorInconsistent(Rule):
    """Number of consecutive measurements that the gate of the estimator rejected."""

    watches = (
        "number of consecutive measurements that the gate of the estimator rejects (chi-square, "
        "99.9 %); a restart of the estimator counts as 100"
    )
    unit = ""
    source = (
        "the filter restarts after 10 rejected samples that agree with each other, unless they "
        "scatter as those of a noisier sensor"
    )
    from_take_off = True
    every = 1  # hands in task space follow an estimate that jumps

    class Table(Rule.Table):
        """Limit in measurements."""

        limit: NonNegative = 12.0
        hold_s: NonNegative = 0.0
        response: Response = "land_here"

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.estimates import EstimatorState

        self._rejected = v.place(EstimatorState, "rejected")
        self._restarts = v.place(EstimatorState, "restarts")
        self._before = 0.0 if self._restarts is None else self._restarts.tolist()

    def look(self, v: Senses) -> float:
        if self._restarts is None:
            return math.nan
        restarts = self._restarts.tolist() - self._before
        return float(self._rejected.tolist() + RESTART * restarts)

    def repair(self, s: Supervisor) -> Response:
        """The robot was near its reference and may still be there, although the estimate is not.

        Hands in task space keep the joint angles commanded before the estimate was rejected.
        """
        if s.trail.crumbs:
            s.senses.posture = s.trail.crumbs[-2:][0].q
        away = np.array(s.senses.reference["p_WB"] - s.senses.estimate["p_WB"])
        if float(np.linalg.norm(away)) < FAR:
            s.senses.doubt = away
        return super().repair(s)
