"""The structure that a robot inspects by contact: `world.structure`, its frame and its distance.

Frame S is on the surface, with z the outward normal. A surface that faces down (a deck's underside,
a tunnel's crown) has x_S along `yaw_deg`. One that faces to the side (a wall, a pillar) faces -x of
W rotated by `yaw_deg`, with x_S level and y_S up. Places of inspection points are given in S, which
belongs to the structure, not to a flight.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skywright.core.rotations import rot_z
from skywright.core.spec import Coordinate, NonNegative, Positive, Spec

Array = NDArray[np.float64]

PLANE, CYLINDER, ARCH = 0, 1, 2
SHAPES = {"plane": PLANE, "cylinder": CYLINDER, "arch": ARCH}


class Structure(Spec):
    """A plane, a pillar (`cylinder`) or the inside of a tunnel (`arch`).

    `slope_deg` of a surface that faces down: it rises toward `slope_toward_deg` (counter-clockwise
    from +x of W). Of one that faces to the side: it leans over the robot. A pillar that faces to
    the side is vertical; every other axis is along x_S.
    """

    shape: Literal["plane", "cylinder", "arch"] = "plane"
    facing: Literal["down", "side"] = "down"
    x_m: Coordinate
    y_m: Coordinate = 0.0
    z_m: float = Field(gt=0, le=500)
    yaw_deg: float = 0.0
    slope_deg: float = Field(default=0.0, ge=0, le=45)
    slope_toward_deg: float = 0.0
    length_m: Positive = 6.0  # along x_S
    width_m: Positive = 4.0  # along y_S
    thickness_m: Positive = 0.25
    radius_m: Positive | None = None  # of a cylinder or an arch
    friction: NonNegative = 0.6  # between the probe's tip and the surface

    @model_validator(mode="after")
    def _curved_has_a_radius(self) -> Structure:
        if (self.shape == "plane") != (self.radius_m is None):
            needs = "takes no radius_m" if self.shape == "plane" else "needs radius_m"
            raise ValueError(f"shape = {self.shape!r} {needs}")
        return self

    @property
    def is_upright(self) -> bool:
        """Whether it is a vertical pillar: its axis is along y_S."""
        return self.shape == "cylinder" and self.facing == "side"

    @property
    def half_extents(self) -> dict[str, float]:
        """Half its extent (m) along x_S (`x_m`) and y_S (`y_m`); if curved, along its axis only."""
        half = {"x_m": 0.5 * self.length_m, "y_m": 0.5 * self.width_m}
        if self.shape != "plane":
            half.pop("x_m" if self.is_upright else "y_m")
        return half


class Surface(NamedTuple):
    """A structure's surface as numbers."""

    p_WS: Array  # (3,) m
    R_WS: Array  # (3, 3), z outward
    shape: int  # PLANE, CYLINDER, ARCH
    radius: float  # m, 0 for a plane
    along: int  # column of R_WS along the axis of a curved surface


def build_surface(s: Structure) -> Surface:
    """Return the surface of a structure."""
    if s.facing == "down":
        heading = rot_z(math.radians(s.yaw_deg))[:, 0]
        turn = math.radians(s.slope_toward_deg)
        # the underside z = z0 + tan(slope) (d . p) has the downward normal (sin d, -cos)
        z = np.array([
            math.sin(math.radians(s.slope_deg)) * math.cos(turn),
            math.sin(math.radians(s.slope_deg)) * math.sin(turn),
            -math.cos(math.radians(s.slope_deg)),
        ])  # fmt: skip
        x = heading - (heading @ z) * z
        x /= np.linalg.norm(x)
    else:
        lean = math.radians(s.slope_deg)
        z = rot_z(math.radians(s.yaw_deg)) @ np.array([-math.cos(lean), 0.0, -math.sin(lean)])
        x = rot_z(math.radians(s.yaw_deg)) @ np.array([0.0, -1.0, 0.0])
    R = np.ascontiguousarray(np.column_stack([x, np.cross(z, x), z]))
    place, along = np.array([s.x_m, s.y_m, s.z_m]), int(s.is_upright)
    return Surface(place, R, SHAPES[s.shape], s.radius_m or 0.0, along)


def locate_point(surface: Surface, place: Array) -> tuple[Array, Array]:
    """Return (p_W (3,) m, R (3, 3)) of a place (2,) m in S: the point and its local frame.

    On a curved surface the coordinate across the axis is an arc length.
    """
    p, R = surface.p_WS, surface.R_WS
    if surface.shape == PLANE:
        return p + R[:, :2] @ np.asarray(place, dtype=float), R
    k, across = surface.along, 1 - surface.along
    angle = float(place[across]) / surface.radius
    out = 1.0 if surface.shape == CYLINDER else -1.0  # the axis is behind, or in front
    centre = p - out * surface.radius * R[:, 2]
    n = math.cos(angle) * R[:, 2] + out * math.sin(angle) * R[:, across]
    local = np.array(R)
    local[:, 2] = n
    local[:, across] = np.cross(n, R[:, 0]) if across == 1 else np.cross(R[:, 1], n)
    return centre + out * surface.radius * n + float(place[k]) * R[:, k], local


def find_place(surface: Surface, p_W: Array) -> Array:
    """Return the place (3,) m in S of a point in W: along x_S, along y_S, off the surface."""
    r = surface.R_WS.T @ (np.asarray(p_W, dtype=float) - surface.p_WS)
    if surface.shape == PLANE:
        return np.asarray(r)
    across = 1 - surface.along
    out = 1.0 if surface.shape == CYLINDER else -1.0
    height = r[2] + out * surface.radius  # above the axis, along z_S
    far = math.hypot(r[across], height)
    r[across] = surface.radius * math.atan2(r[across], out * height)
    r[2] = out * (far - surface.radius)
    return np.asarray(r)
