"""How a mission went."""

from __future__ import annotations

from typing import NamedTuple


class PhaseRecord(NamedTuple):
    """One phase as it was flown."""

    name: str
    start_s: float
    end_s: float
    outcome: str  # "done", "retry", "failed"


class Measurement(NamedTuple):
    """One contact measurement: where, when, how hard, and how well the place was known."""

    spot: str
    how: str  # "docked" or "flying"
    x_m: float  # place of the tip in the structure's frame S
    y_m: float
    off_m: float  # off the surface, as estimated: what the place errs by across it
    p_W: tuple[float, float, float]  # m, the same place in W
    start_s: float  # mission time
    end_s: float
    force_des_n: float
    force_n: float  # mean of the force sensor
    force_std_n: float
    pose_std_m: float  # standard deviation of the platform's place, as the estimator says
    wander_m: float  # farthest that the estimated tip was from its mean


class Flight(NamedTuple):
    """How a mission went."""

    completed: bool
    reason: str  # why it was cut short, or ""
