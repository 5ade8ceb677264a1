"""Equipment of a robot for localisation outdoors: prism, tracking camera, range finder."""

from __future__ import annotations

from pydantic import Field, model_validator

from skywright.core.spec import NonNegative, Positive, Spec


class Prism(Spec):
    """Position in B of the prism that a total station tracks."""

    x_m: float = Field(default=0.0, ge=-2, le=2)
    y_m: float = Field(default=0.0, ge=-2, le=2)
    z_m: float = Field(default=0.12, ge=-2, le=2)


class TrackingCamera(Spec):
    """Visual odometry at the origin of B, in a frame of its own with a scale error and drift."""

    rate_hz: float = Field(default=200.0, gt=0, le=500)
    scale: float = Field(default=0.95, gt=0.2, lt=5)  # ratio of reported to true length
    walk_m_per_sqrt_m: NonNegative = 0.015  # drift along the path, each axis
    walk_m_per_sqrt_s: NonNegative = 0.0
    yaw_rate_deg_per_min: float = Field(default=1.0, ge=-60, le=60)  # drift of the heading
    noise_m: NonNegative = 0.5e-3
    attitude_noise_rad: NonNegative = 0.002
    jump_interval_s: NonNegative = 60.0  # mean; 0: never
    jump_m: NonNegative = 0.01  # 1 sigma, each axis


class RangeFinder(Spec):
    """Laser range finder that points down (-z of B) from the origin of B."""

    rate_hz: float = Field(default=20.0, gt=0, le=500)
    range_min_m: NonNegative = 0.2
    range_max_m: Positive = 120.0
    resolution_m: Positive = 0.01
    bias_m: NonNegative = 0.05  # 1 sigma, drawn once per run
    noise_m: NonNegative = 0.02

    @model_validator(mode="after")
    def _limits_do_not_cross(self) -> RangeFinder:
        if self.range_min_m >= self.range_max_m:
            raise ValueError(
                f"range_min_m {self.range_min_m:g} must be below range_max_m {self.range_max_m:g}"
            )
        return self
