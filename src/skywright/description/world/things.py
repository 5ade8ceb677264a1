"""What a world file may say of things that move: `world.objects`, `world.bench`, `world.marker`."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skywright.core.rotations import rot_y, rot_z
from skywright.core.spec import Coordinate, NonNegative, Positive, Spec


class Thing(Spec):
    """A movable thing; (x, y, z) is its centre.

    A box has three edges; a cylinder the diameter `size_x_m` and the length `size_z_m` along its
    own z; `pitch_deg` and `yaw_deg` turn it about its y, then about W's z. With `held_n` it is
    stuck (a plug in its socket) until it is pulled with that force.
    """

    shape: Literal["box", "cylinder"] = "box"
    size_x_m: Positive
    size_y_m: Positive | None = None
    size_z_m: Positive
    mass_kg: Positive
    x_m: Coordinate
    y_m: Coordinate
    z_m: Coordinate
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    friction: NonNegative = 0.5
    held_n: Positive | None = None

    @model_validator(mode="after")
    def _box_has_three_edges(self) -> Thing:
        if self.shape == "box" and self.size_y_m is None:
            raise ValueError("shape = 'box' needs size_y_m")
        return self


class Pad(Spec):
    """A sprung plate on the face of a box that looks towards -x (at yaw 0): what one runs into.

    Its stiffness is a number of its own, whatever touches it: MuJoCo's soft contacts are the
    stiffer the heavier the robot, which would spoil a comparison of robots.
    """

    stiffness_n_per_m: Positive = 3000.0
    damping_ns_per_m: NonNegative = 15.0
    mass_kg: Positive = 0.1  # of the plate
    thickness_m: Positive = 0.02  # of the plate
    travel_m: Positive = 0.05  # until the foam is flat


class Bench(Spec):
    """A fixture that clamps the platform, arms free; it may drift while a trial wants it to."""

    x_m: Coordinate = 0.0
    y_m: Coordinate = 0.0
    z_m: float = Field(default=1.2, gt=0, le=100)  # of the platform's origin
    pitch_deg: float = Field(default=0.0, ge=-90, le=90)  # about y; 90: what was up points along x

    @property
    def q_WB(self) -> tuple[float, float, float, float]:
        """Attitude of the platform (wxyz)."""
        half = 0.5 * math.radians(self.pitch_deg)
        return math.cos(half), 0.0, math.sin(half), 0.0


class Marker(Spec):
    """A marker that a camera or motion capture measures, in W or `on` a movable thing.

    Its normal (z of frame M) looks along -x, turned by `pitch_deg` about y and `yaw_deg` about z; y
    of M is up, x to the right of one who looks at it.
    """

    x_m: Coordinate
    y_m: Coordinate
    z_m: Coordinate
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    on: str | None = None  # an object, or "tool": the place is then in that thing's frame

    @property
    def rotation(self) -> NDArray[np.float64]:
        """R_WM (3, 3), or R_OM on a thing."""
        facing = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        return rot_z(math.radians(self.yaw_deg)) @ rot_y(math.radians(self.pitch_deg)) @ facing
