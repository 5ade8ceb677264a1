"""What a mission of the kind "scan" may say."""

from typing import Literal, Self

from pydantic import Field, model_validator

from skywright.core.spec import Positive
from skywright.description.mission.spec import Task


class Scan(Task):
    """A scan pattern on the pipe's unrolled surface (s along the axis, c around it)."""

    pattern: Literal["raster", "line", "spiral"] = "raster"
    side: Literal["side", "top", "underside", "angle"] = "side"
    centre_angle_deg: float = 0.0  # circumferential angle of the sector's middle, side = "angle"
    arc_deg: float = Field(default=40.0, gt=0, le=180)
    passes: int = Field(default=4, ge=1, le=100)  # axial passes; each makes two corners
    pass_length_m: float = Field(default=0.2, ge=1e-3, le=100.0)
    centre_s_m: float = 0.0
    speed_mps: float = Field(default=0.01, ge=1e-4, le=1.0)
    force_n: Positive | None = None  # of the probe on the pipe; default robot.probe.force_n
    depth_m: Positive | None = None  # of the desired tip inside the surface, in place of a force
    stand_off_m: Positive = 0.05  # tip distance before touching
    # touch the pipe at six places first, and plan again with what they tell; default: where the map
    # may be wrong (plant.map_error_*)
    survey: bool | None = None
    retries: int = Field(default=2, ge=0, le=10)

    @model_validator(mode="after")
    def _is_one_push(self) -> Self:
        if self.force_n is not None and self.depth_m is not None:
            raise ValueError("force_n and depth_m both define the contact force: one")
        return self
