"""Keys of a mission of the kind "bimanual-bench"."""

from typing import Literal

from pydantic import Field, field_validator

from skywright.description.mission.spec import Task

Trial = Literal["squeeze", "unplug", "bar", "position-sensor"]
JUDGED_BY: dict[str, tuple[str, ...]] = {
    "squeeze": ("bench.box_", "bench.squeeze_"),
    "unplug": ("bench.unplug_", "bench.plug_"),
    "bar": ("bench.bar_",),
    "position-sensor": ("bench.drift_",),
}
"""Trial -> prefixes of the names of its metrics."""


class BimanualBench(Task):
    """Trials of two hands on a bench (Suarez 2020, section V-D and VI), and their forces."""

    # which trials are done, in this order
    trials: list[Trial] = Field(
        default=["squeeze", "unplug", "bar", "position-sensor"], min_length=1
    )
    box: str = "box"  # name of the thing that is squeezed and lifted
    plug: str = "plug"  # name of the thing that is pulled out
    bar: str = "bar"  # name of the thing that both hands move and turn
    post: str = "post"  # name of the thing that the hand touches to measure the base's drift
    squeeze_n: float = Field(default=3.5, gt=0, le=15)  # squeezing force on the box
    # usable share of the computed limit k L / 2; springs differ by plant.spring_spread
    squeeze_fraction: float = Field(default=0.9, gt=0, le=1)
    lift_m: float = Field(default=0.05, gt=0, le=0.2)  # height to which the box is lifted
    hold_s: float = Field(default=5.0, gt=0, le=600)  # time for which the box is held
    # motion of the hands that counts as a release, Delta_th of (33)
    unplug_threshold_m: float = Field(default=0.03, gt=0, le=1)
    bar_turn_deg: float = Field(default=10.0, ge=0, le=30)  # angle by which the bar is turned
    # amplitude of the base's motion that is to be measured
    drift_m: float = Field(default=0.02, ge=0, le=0.05)
    drift_period_s: float = Field(default=6.0, ge=0.5, le=600)  # period of that motion

    @field_validator("trials")
    @classmethod
    def _trials_differ(cls, trials: list[Trial]) -> list[Trial]:
        if len(set(trials)) < len(trials):
            raise ValueError("a trial appears twice; valid: each one once")
        return trials
