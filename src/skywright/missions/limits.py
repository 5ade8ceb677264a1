"""The wind that a mission may ask a robot to hold, from the computed capability.

Rotor loads under push and wind are checked along the plan by the planner itself; here stands the
margin that a mission keeps on top (`mission.wind_fraction`), and the number for a refusal.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.missions.loader import Description
from skywright.models.capability import compute_capability, compute_wind_limit
from skywright.worlds.surface import build_cylinder

HEADING_STEP_DEG = 10.0  # headings of a plan are grouped to this


def find_exceeded_wind(description: Description, segments: dict[str, NDArray[Any]]) -> str | None:
    """Say by how much the wind exceeds what the robot may be asked to hold, or return None.

    Checked at every heading of `segments`; without a plan at the heading of the start and at the
    one that faces the pipe. The arm is in its working posture.
    """
    d, wind = description, description.world.wind
    speed = math.hypot(wind.mean_mps, wind.vertical_mps)
    if wind.kind == "none" or speed == 0.0:
        return None
    capability = compute_capability(
        d.robot,
        gravity=d.world.gravity_mps2,
        air_density=d.world.air_density_kg_m3,
        directions_deg=[0.0],
    )
    worst, worst_toward = math.inf, 0.0
    for heading in _headings(d, segments):
        toward = (wind.toward_deg - heading + 180.0) % 360.0 - 180.0
        limit = compute_wind_limit(capability, toward)
        if not limit >= worst:  # NaN: not even calm air is held
            worst, worst_toward = (limit if math.isfinite(limit) else 0.0), toward
    allowed = d.mission.wind_fraction * worst
    if speed <= allowed:
        return None
    return (
        f"wind of {speed:.1f} m/s exceeds {allowed:.1f} m/s, {d.mission.wind_fraction:.0%} of the "
        f"{worst:.1f} m/s that {d.robot.name} can hold when it blows toward {worst_toward:.0f} deg "
        "(0 is ahead, 90 to the left)"
    )


def _headings(d: Description, segments: dict[str, NDArray[Any]]) -> list[float]:
    """Distinct headings (deg) of a plan, or the two that a mission starts from."""
    if segments:
        found = set()
        for table in segments.values():
            r = table["R_WB"]
            yaw = np.degrees(np.arctan2(r[:, 1, 0], r[:, 0, 0]))
            found |= set(np.round(yaw / HEADING_STEP_DEG).astype(int).tolist())
        return [k * HEADING_STEP_DEG for k in sorted(found)]
    out = [d.mission.start_yaw_deg]
    if d.world.pipe is not None:
        ahead = build_cylinder(d.world.pipe).R_WP[:, 0]
        out.append(math.degrees(math.atan2(ahead[1], ahead[0])))
    return out
