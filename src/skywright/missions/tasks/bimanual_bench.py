"""What a mission of the kind "bimanual-bench" may say."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from skywright.core.spec import Positive, Spec
from skywright.missions.spec import Mission

Trial = Literal["squeeze", "unplug", "bar", "position-sensor"]


class BimanualBench(Spec):
    """Two hands on a bench (Suarez 2020, section V-D and VI): which trials, and how hard."""

    trials: list[Trial] = Field(
        default=["squeeze", "unplug", "bar", "position-sensor"], min_length=1
    )
    squeeze_n: float = Field(default=3.5, gt=0, le=15)
    lift_m: float = Field(default=0.05, gt=0, le=0.2)
    hold_s: Positive = 5.0
    unplug_threshold_m: Positive = 0.03  # Delta_th of (33)
    bar_turn_deg: float = Field(default=10.0, ge=0, le=30)
    drift_m: float = Field(default=0.02, ge=0, le=0.05)  # of the base, peak, while it is measured
    drift_period_s: Positive = 6.0


class BimanualBenchMission(Mission):
    """A mission with the table `mission.task` of this kind."""

    task: BimanualBench = BimanualBench()
