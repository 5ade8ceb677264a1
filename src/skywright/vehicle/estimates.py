"""What estimators tell besides Estimate; an estimator of a user need not fill these."""

from __future__ import annotations

from skywright.core.record import Vec3
from skywright.vehicle.component import Output


class RotorForce(Output):
    """What the rotors make, as believed."""

    f_B: Vec3  # N


class EstimatorState(Output):
    """How an estimator does."""

    ready: float  # 1: Estimate holds
    heard: float  # s, when the localisation was last heard of
    fix_age: float  # s, since the newest fix that was used, where fixes come by themselves
    pose_std: float  # m, largest standard deviation of the position; NaN where it is not known
    rejected: float  # measurements of the place in a row that contradict the estimate
    restarts: float  # times that it gave up its estimate for what is measured
