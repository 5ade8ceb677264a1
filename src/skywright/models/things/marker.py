"""A marker that a camera or motion capture measures, fixed in W or `on` a thing."""

import math
from typing import ClassVar

import numpy as np

from skywright.core.rotations import rot_y, rot_z
from skywright.description.world.thing import Array, Placed

_FACING = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


class Marker(Placed):
    """A marker with frame M; it adds no geometry.

    Its normal (z of M) points along -x, rotated by `pitch_deg` about y and then `yaw_deg` about z.
    y of M points up, and x to the right of an observer who faces the marker.
    """

    kind: str = "marker"
    is_marker: ClassVar[bool] = True
    pitch_deg: float = 0.0
    tracked: bool = True

    @property
    def attitude(self) -> Array:
        """R_WM (3, 3), or R_OM on a thing."""
        return rot_z(math.radians(self.yaw_deg)) @ rot_y(math.radians(self.pitch_deg)) @ _FACING

    def describe(self) -> str:
        """Return a description with the thing that carries it."""
        return "marker" if self.on is None else f"marker on {self.on}"
