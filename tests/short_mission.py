"""Missions of one way-point: `waypoints` cut short, and one for back ends that are an autopilot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import skywright

HOP = (
    "mission.task.points=[{ x_m = 0.3, y_m = 0.0, z_m = 1.0, hold_s = 0.2 }]",
    "mission.hover_height_m=0.8",
    "mission.timestep_ms=2",
)
"""Settings of `waypoints` for a short flight."""
TEXT = """
[mission]
name = "short"
kind = "waypoints"
robot = "ROBOT"
world = "open"
seed = 1
hover_height_m = 1.0
timestep_ms = STEP
[[mission.task.points]]
x_m = 0.6
y_m = 0.3
z_m = 1.2
yaw_deg = 30.0
hold_s = 1.0
[mission.requirements]
"position.rms_m" = { limit = 0.3, sense = "<=", unit = "m", source = "trim not settled" }
"position.hold_error_m" = { limit = 0.15, sense = "<=", unit = "m", source = "likewise" }
"""


def write_short(folder: Path, robot: str = "hexarotor") -> Any:
    """Write the mission into `folder` and load it."""
    file = folder / "short.toml"
    step = "1" if robot.startswith("f550") else "2"  # ms, what its docking feet bear
    file.write_text(TEXT.replace("ROBOT", robot).replace("STEP", step))
    return skywright.load(file)
