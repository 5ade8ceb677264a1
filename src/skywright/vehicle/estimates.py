"""What estimators tell besides Estimate; an estimator of a user need not fill these."""

from __future__ import annotations

from skywright.core.record import Vec3
from skywright.vehicle.component import Output, Recorded


class RotorForce(Output):
    """What the rotors make, as believed."""

    f_B: Vec3  # N


class EstimatorState(Output):
    """How an estimator does."""

    ready: float  # 1: Estimate holds
    heard: float  # s, when the localisation was last heard of
    fix_age: float  # s, since the newest fix that was used, where fixes come by themselves
    p_std: Vec3  # m, standard deviations of the position now
    pose_std: float  # m, the largest of them; NaN where it is not known
    rejected: float  # measurements of the place in a row that contradict the estimate
    restarts: float  # times that it gave up its estimate for what is measured


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
