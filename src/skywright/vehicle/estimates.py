"""Outputs of estimators besides Estimate; an estimator of a user need not fill them."""

from __future__ import annotations

from skywright.core.record import Vec3
from skywright.vehicle.component import Output, Recorded


class RotorForce(Output):
    """Nominal force of the rotors."""

    f_B: Vec3  # N


class EstimatorState(Output):
    """State of an estimator."""

    ready: float  # 1: Estimate is valid
    heard: float  # s, time of the last data from the localisation
    fix_age: float  # s, since the newest fix used, if fixes arrive separately
    p_std: Vec3  # m, standard deviations of the position
    pose_std: float  # m, the largest of them; NaN where it is not known
    rejected: float  # consecutive position measurements that contradict the estimate
    restarts: float  # number of resets to the measurements


POSITION_COLUMNS = (
    Recorded("fix_age", EstimatorState, "fix_age", "s", "age of the newest used fix"),
    Recorded("p_std", EstimatorState, "p_std", "m", "stated standard deviations of the position"),
    Recorded(
        "pose_std",
        EstimatorState,
        "pose_std",
        "m",
        "largest stated standard deviation of the position",
    ),
)
