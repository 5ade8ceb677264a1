"""Keys of a mission of the kind "scan"."""

import math
from typing import Literal, Self

from pydantic import Field, model_validator

from skywright.core.spec import Positive
from skywright.description.mission.spec import Task
from skywright.description.robot.spec import Robot
from skywright.planning.patterns import SIDES


class Scan(Task):
    """A scan pattern on the pipe's unrolled surface (s along the axis, c around it)."""

    # axial passes joined by steps, one pass, or arcs that advance along the axis
    pattern: Literal["raster", "line", "spiral"] = "raster"
    # where the middle of the sector lies; angle: at centre_angle_deg
    side: Literal["side", "top", "underside", "angle"] = "side"
    centre_angle_deg: float = 0.0  # circumferential angle of the sector's middle, for side = angle
    arc_deg: float = Field(default=40.0, gt=0, le=180)  # extent of the sector around the pipe
    passes: int = Field(default=4, ge=1, le=100)  # axial passes; a spiral has one arc more
    # extent of the sector along the axis
    pass_length_m: float = Field(default=0.2, ge=1e-3, le=100.0)
    centre_s_m: float = 0.0  # position of the sector's middle along the axis
    speed_mps: float = Field(default=0.01, ge=1e-4, le=1.0)  # speed of the probe on the surface
    force_n: Positive | None = None  # contact force; default: robot.probe.force_n
    # depth of the desired tip below the surface, instead of a force
    depth_m: Positive | None = None
    stand_off_m: Positive = 0.05  # distance of the tip from the surface before contact
    # touch the pipe at six places first and plan again; default: if plant.map_error_* is not 0
    survey: bool | None = None
    datum: bool = True  # measure the world's datum before the survey; places are relative to it
    retries: int = Field(default=2, ge=0, le=10)  # how often a lost contact is established again

    def get_least_pitch(self, robot: Robot) -> float:
        """Return the least distance (m) of passes: the width of the probe's tip."""
        return 0.0 if robot.probe is None else 2.0 * robot.probe.tip_radius_m

    def get_centre(self) -> float:
        """Return the circumferential angle (rad) of the sector's middle."""
        return math.radians(SIDES.get(self.side, self.centre_angle_deg))

    @model_validator(mode="after")
    def _is_one_push(self) -> Self:
        if self.force_n is not None and self.depth_m is not None:
            raise ValueError("force_n and depth_m both define the contact force: one")
        return self
