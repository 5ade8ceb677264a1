"""Geofence and pre-flight checklist of a mission."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pydantic import Field, model_validator

from skywright.core.spec import Coordinate, Fraction, Positive, Spec


class Fence(Spec):
    """The geofence: `[mission.fence]`. Keys without a value set no limit."""

    x_min_m: Coordinate | None = None  # limit of the platform's origin in W
    x_max_m: Coordinate | None = None
    y_min_m: Coordinate | None = None
    y_max_m: Coordinate | None = None
    height_max_m: Positive | None = None  # above the ground
    radius_m: Positive | None = None  # horizontal distance from the origin of W

    @model_validator(mode="after")
    def _limits_leave_room(self) -> Fence:
        for axis in ("x", "y"):
            low, high = getattr(self, f"{axis}_min_m"), getattr(self, f"{axis}_max_m")
            if low is not None and high is not None and not low < high:
                raise ValueError(f"{axis}_min_m = {low:g} is not below {axis}_max_m = {high:g}")
        return self

    def list_excess(self, p: Sequence[float]) -> list[tuple[str, float, float, float]]:
        """Return (key, value, limit, excess m) of every limit; the excess is negative inside."""
        values = {
            "x_min_m": (p[0], -1.0), "x_max_m": (p[0], 1.0), "y_min_m": (p[1], -1.0),
            "y_max_m": (p[1], 1.0), "height_max_m": (p[2], 1.0),
            "radius_m": (math.hypot(p[0], p[1]), 1.0),
        }  # fmt: skip
        limits = [(key, *values[key], getattr(self, key)) for key in values]
        return [(k, x, limit, s * (x - limit)) for k, x, s, limit in limits if limit is not None]

    def compute_excess(self, p: Sequence[float]) -> float:
        """Return how far (m) the position p (3,) m is outside; negative inside, -inf without
        limits."""
        return max((excess for *_, excess in self.list_excess(p)), default=-math.inf)

    def explain(self, p: Sequence[float]) -> str:
        """Return which limit the position p (3,) m exceeds, "" if it is inside."""
        for key, value, limit, excess in self.list_excess(p):
            if excess > 0.0:
                return (
                    f"the goal is {excess:.2f} m outside the geofence: mission.fence.{key} = "
                    f"{limit:g}, goal {value:.2f}"
                )
        return ""


class Checklist(Spec):
    """Conditions for starting the motors: `[mission.checklist]`."""

    battery_min_fraction: Fraction = 0.3  # least charge, relative to the full battery
    fix_age_max_s: Positive = 0.5  # largest time since the last position fix
    tilt_max_deg: float = Field(default=10.0, gt=0, le=90)  # of the platform on the ground
    speed_max_mps: Positive = 0.2  # estimated speed of the platform on the ground
    spin: bool = False  # run the motors at low thrust for 0.5 s, and compare their speeds
    spin_spread_fraction: Fraction = 0.25  # largest deviation of a rotor's speed from the median
