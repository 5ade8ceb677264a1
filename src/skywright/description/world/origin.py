"""Position of a world on the earth."""

from __future__ import annotations

from pydantic import Field

from skywright.core.spec import Spec


class Origin(Spec):
    """The origin of W in WGS 84: x points east, y north, z up.

    A vehicle over MAVLink uses latitude and longitude only; its heights come from the ground at the
    start. Simulated autopilots report altitude_m as the altitude above sea level (no geoid).
    """

    latitude_deg: float = Field(ge=-90, le=90)
    longitude_deg: float = Field(ge=-180, le=180)
    altitude_m: float = Field(default=0.0, ge=-500, le=9000)  # above the ellipsoid
