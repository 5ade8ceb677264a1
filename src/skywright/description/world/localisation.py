"""A total station, for a world with localisation = "total-station".

It tracks a prism on the robot and measures positions only, so the robot also requires a tracking
camera.
"""

from __future__ import annotations

from pydantic import Field, model_validator

from skywright.core.spec import Coordinate, NonNegative, Positive, Spec


class TotalStation(Spec):
    """A robotic total station: its position and accuracy."""

    x_m: Coordinate = -18.0
    y_m: Coordinate = -9.0
    z_m: float = Field(default=1.6, ge=0, le=100)
    rate_max_hz: float = Field(default=20.0, gt=0, le=50)
    rate_mean_hz: float = Field(default=10.0, gt=0, le=50)
    latency_min_s: float = Field(default=0.05, ge=0, le=1)
    latency_mean_s: float = Field(default=0.1, ge=0, le=1)
    range_noise_m: NonNegative = 2e-3  # along the line of sight
    angle_noise_rad: NonNegative = 4.85e-6
    # across the line of sight: the prism has a finite size
    pointing_noise_m: NonNegative = 1.5e-3
    # time in sight before it measures again after an interruption
    relock_s: NonNegative = 1.0
    # 1 sigma of its clock's offset from the robot's, drawn once per run
    clock_s: NonNegative = 0.2
    calibration_s: float = Field(default=60.0, ge=30, le=600)  # of flight before the mission
    # [from, to], s: intervals in which an obstacle blocks the line of sight
    blocked_s: list[list[Positive]] = []

    @model_validator(mode="after")
    def _means_follow(self) -> TotalStation:
        if self.rate_mean_hz > self.rate_max_hz:
            raise ValueError(
                f"rate_mean_hz {self.rate_mean_hz:g} exceeds rate_max_hz {self.rate_max_hz:g}"
            )
        if self.latency_mean_s < self.latency_min_s:
            raise ValueError(
                f"latency_mean_s {self.latency_mean_s:g} is below latency_min_s "
                f"{self.latency_min_s:g}"
            )
        for span in self.blocked_s:
            if len(span) != 2 or span[0] >= span[1]:
                raise ValueError(
                    f"blocked_s contains {span}; each entry must be [from, to] in s with from < to"
                )
        return self
