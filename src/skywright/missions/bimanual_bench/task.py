"""What a mission of the kind "bimanual-bench" may say."""

from typing import Literal

from pydantic import Field

from skywright.description.mission.spec import Task

Trial = Literal["squeeze", "unplug", "bar", "position-sensor"]
JUDGED_BY: dict[str, tuple[str, ...]] = {
    "squeeze": ("bench.box_", "bench.squeeze_"),
    "unplug": ("bench.unplug_", "bench.plug_"),
    "bar": ("bench.bar_",),
    "position-sensor": ("bench.drift_",),
}
"""Trial -> beginnings of the names of its metrics."""


class BimanualBench(Task):
    """Two hands on a bench (Suarez 2020, section V-D and VI): which trials, and how hard."""

    trials: list[Trial] = Field(
        default=["squeeze", "unplug", "bar", "position-sensor"], min_length=1
    )
    box: str = "box"  # names of the things that are squeezed, pulled out, led and felt
    plug: str = "plug"
    bar: str = "bar"
    post: str = "post"
    squeeze_n: float = Field(default=3.5, gt=0, le=15)
    # of the computed k L / 2: springs differ by 10 % (plant.spring_spread)
    squeeze_fraction: float = Field(default=0.9, gt=0, le=1)
    lift_m: float = Field(default=0.05, gt=0, le=0.2)
    hold_s: float = Field(default=5.0, gt=0, le=600)
    unplug_threshold_m: float = Field(default=0.03, gt=0, le=1)  # Delta_th of (33)
    bar_turn_deg: float = Field(default=10.0, ge=0, le=30)
    drift_m: float = Field(default=0.02, ge=0, le=0.05)  # of the base, peak, while it is measured
    drift_period_s: float = Field(default=6.0, ge=0.5, le=600)
