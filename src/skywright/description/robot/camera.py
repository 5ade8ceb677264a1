"""Keys of a robot's cameras: the tables `robot.camera`, `robot.probe.camera`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skywright.core.rotations import rot_y, rot_z
from skywright.core.spec import NonNegative, Positive, Spec


class Camera(Spec):
    """A camera on the platform that measures a marker's pose.

    Its optical axis is x of B, rotated by `yaw_deg` to the left and then by `pitch_deg` down.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    field_of_view_deg: float = Field(default=70.0, gt=0, lt=170)  # horizontal and vertical
    range_max_m: Positive = 3.0
    slant_max_deg: float = Field(default=70.0, gt=0, le=90)  # angle of the marker's normal
    rate_hz: float = Field(default=30.0, gt=0, le=500)
    bearing_noise_rad: NonNegative = 0.001
    range_noise_fraction: NonNegative = 0.005
    attitude_noise_rad: NonNegative = 0.01

    @property
    def rotation(self) -> NDArray[np.float64]:
        """R_BC (3, 3): z of C forward along the optical axis, x to the right, y down."""
        level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        return rot_z(math.radians(self.yaw_deg)) @ rot_y(math.radians(self.pitch_deg)) @ level


class ProbeCamera(Spec):
    """A camera on the probe's holder that measures a datum mark: `robot.probe.camera`.

    Its optical axis is parallel to the probe's axis, `back_m` behind the tip and `aside_m` beside
    the axis (along x of T).
    """

    back_m: float = Field(default=0.08, ge=0, le=1)
    aside_m: float = Field(default=0.03, ge=-0.5, le=0.5)
    field_of_view_deg: float = Field(default=80.0, gt=0, lt=170)  # horizontal and vertical
    range_max_m: Positive = 1.0
    slant_max_deg: float = Field(default=60.0, gt=0, le=90)  # angle of the mark's normal
    rate_hz: float = Field(default=30.0, gt=0, le=500)
    bearing_noise_rad: NonNegative = 0.001
    range_noise_fraction: NonNegative = 0.005
