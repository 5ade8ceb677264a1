"""The true state instead of an estimate; a report states this choice.

The filter still runs, for the external force and the tip's samples.
"""

from __future__ import annotations

import math
from typing import Any

from skywright.vehicle.bus import Estimate, Truth
from skywright.vehicle.component import Component, Estimator, InOut
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.estimators.filter import Filter


class TrueState(Estimator):
    """Overwrites Estimate with Truth."""

    side = "plant"
    is_truth = True

    @classmethod
    def assemble(cls, table: Any, context: Any) -> list[Component]:
        """Return a filter and the component that overwrites its estimate."""
        return [*Filter.assemble(Filter.Table(), context), cls("truth estimator", table)]

    @staticmethod
    def step(truth: Truth, est: InOut[Estimate], state: InOut[EstimatorState]) -> None:
        state.pose_std = math.nan
        for a in range(3):
            est.p_WB[a] = truth.p_WB[a]
            est.v_WB[a] = truth.v_WB[a]
            est.w_WB_B[a] = truth.w_WB_B[a]
            est.p_WT[a] = truth.p_WT[a]
            for c in range(3):
                est.R_WB[a, c] = truth.R_WB[a, c]
                est.R_WT[a, c] = truth.R_WT[a, c]
