"""The wall behind a surface: its thickness as a field, its roughness and its paint."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from skywright.core.arrays import Array
from skywright.core.spec import Coordinate, Spec
from skywright.description.world.thing import Thing


class Patch(Spec):
    """A rectangle of the surface with its own thickness of wall, of paint, or both."""

    u_m: Coordinate = 0.0  # centre: along the pipe's axis, or x of the structure's frame S
    v_m: Coordinate = 0.0  # centre: around the pipe (radius times angle), or y of S
    size_u_m: float = Field(default=0.1, gt=0, le=1000)
    size_v_m: float = Field(default=0.1, gt=0, le=1000)
    thickness_m: float | None = Field(default=None, ge=2e-4, le=1.0)  # default: unchanged
    paint_m: float | None = Field(default=None, ge=0, le=0.01)  # default: unchanged


class Pit(Spec):
    """A round pit in the back surface of the wall, with a parabolic bottom."""

    u_m: Coordinate = 0.0  # centre, as for a patch
    v_m: Coordinate = 0.0
    diameter_m: float = Field(default=0.01, gt=0, le=1.0)
    depth_m: float = Field(default=0.002, gt=0, le=0.5)


class Wall(Thing):
    """The wall of the world's pipe or structure; it adds no geometry.

    `random_pits` further pits, drawn with `pit_seed`, lie within `pit_range_m` of the centre.
    """

    kind: str = "wall"
    thickness_m: float = Field(default=0.0095, ge=2e-4, le=1.0)
    patches: dict[str, Patch] = {}
    pits: dict[str, Pit] = {}
    random_pits: int = Field(default=0, ge=0, le=1000)
    pit_seed: int = Field(default=0, ge=0, le=2**32)
    pit_range_m: float = Field(default=0.2, gt=0, le=100)
    velocity_m_per_s: float = Field(default=5920.0, ge=500, le=15000)  # speed of sound; steel
    roughness_front_m: float = Field(default=5e-6, ge=0, le=0.001)  # rms
    roughness_back_m: float = Field(default=10e-6, ge=0, le=0.001)  # rms
    paint_m: float = Field(default=0.0, ge=0, le=0.01)
    cap_m: float = Field(default=0.0, ge=0, le=0.005)  # height of the weld cap

    def describe(self) -> str:
        """Return a description with its thickness."""
        pits = len(self.pits) + self.random_pits
        return f"wall of {1e3 * self.thickness_m:g} mm with {pits} pits"


class WallField(NamedTuple):
    """Data of a wall as arrays."""

    thickness: float  # m
    paint: float  # m
    patches: Array  # (n, 6) centre u, v, half sizes, thickness, paint (m); NaN: unchanged
    pits: Array  # (n, 4) centre u, v, radius, depth (m)


def build_wall_field(wall: Wall) -> WallField:
    """Collect patches and pits, and draw the random ones."""
    nan = math.nan
    patches = [
        (p.u_m, p.v_m, p.size_u_m / 2, p.size_v_m / 2,
         nan if p.thickness_m is None else p.thickness_m, nan if p.paint_m is None else p.paint_m)
        for p in wall.patches.values()
    ]  # fmt: skip
    pits = [(p.u_m, p.v_m, p.diameter_m / 2, p.depth_m) for p in wall.pits.values()]
    rng = np.random.default_rng(wall.pit_seed)
    for _ in range(wall.random_pits):
        u, v = rng.uniform(-wall.pit_range_m, wall.pit_range_m, 2).tolist()
        radius = float(rng.uniform(0.002, 0.008))
        pits.append((u, v, radius, wall.thickness_m * float(rng.uniform(0.1, 0.5))))
    return WallField(
        wall.thickness_m, wall.paint_m,
        np.array(patches).reshape(-1, 6), np.array(pits).reshape(-1, 4),
    )  # fmt: skip


def compute_wall(field: WallField, u: Array, v: Array) -> tuple[Array, Array]:
    """Return the thickness of wall and paint (m) at points `u`, `v` (n,) m.

    Of overlapping patches the last one counts. A pit reduces the local thickness, to 0.2 mm at
    least.
    """
    u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
    thickness, paint = np.full(u.shape, field.thickness), np.full(u.shape, field.paint)
    for row in field.patches:
        inside = (np.abs(u - row[0]) <= row[2]) & (np.abs(v - row[1]) <= row[3])
        if not math.isnan(row[4]):
            thickness = np.where(inside, row[4], thickness)
        if not math.isnan(row[5]):
            paint = np.where(inside, row[5], paint)
    loss = np.zeros(u.shape)
    for row in field.pits:
        away = ((u - row[0]) ** 2 + (v - row[1]) ** 2) / row[2] ** 2
        loss = np.maximum(loss, row[3] * np.maximum(1.0 - away, 0.0))
    return np.maximum(thickness - loss, 2e-4), paint
