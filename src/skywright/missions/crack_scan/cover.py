"""Coverage of a sector by the coils of a search, and the missed parts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import label
from scipy.spatial import cKDTree

from skywright.core.arrays import Array, Mask
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.coverage import CELLS


class Sector(NamedTuple):
    """The requested part of a pipe's surface, in cells."""

    cells: Array  # (m, 2) s, c m, of their centres, c varying fastest
    shape: tuple[int, int]  # along s, along c
    size: tuple[float, float]  # m, of a cell
    width: float  # m, of a coil's footprint


class Gap(NamedTuple):
    """A connected part of a sector that no coil covered, in a rectangle of s and c."""

    start: tuple[float, float]  # m, least s and c
    end: tuple[float, float]  # m, largest
    area_m2: float
    hole_m: float  # diameter of the largest circle in it


class Cover(NamedTuple):
    """Coverage of a sector."""

    sector: Sector
    covered: Mask  # (m,)
    away: Array  # (m,) m, from the nearest valid place of a coil

    @property
    def fraction(self) -> float:
        """Covered fraction of the area."""
        return float(np.mean(self.covered))

    @property
    def area_m2(self) -> float:
        """Area of the sector."""
        return len(self.covered) * self.sector.size[0] * self.sector.size[1]

    @property
    def hole_m(self) -> float:
        """Diameter (m) of the largest circle that no coil covers."""
        return 2.0 * max(float(np.max(self.away)) - 0.5 * self.sector.width, 0.0)


def build_sector(task: CrackScan, radius: float, width: float) -> Sector:
    """Return the sector of a task on a pipe of `radius` (m), for coils of `width` (m)."""
    middle = task.get_centre() * radius
    extent = (task.pass_length_m, math.radians(task.arc_deg) * radius)
    cell = max(0.25 * width, math.sqrt(extent[0] * extent[1] / CELLS))
    n = [max(1, round(x / cell)) for x in extent]
    u, v = ((np.arange(m) + 0.5) / m - 0.5 for m in n)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = [task.centre_s_m, middle] + grid * extent
    return Sector(cells, (n[0], n[1]), (extent[0] / n[0], extent[1] / n[1]), width)


def compute_cover(sector: Sector, s: Array, c: Array) -> Cover:
    """Compare a sector with the places `s`, `c` (n,) m of coils with valid readings.

    A cell is covered if a coil came within half its width.
    """
    if not s.size:
        far = np.full(len(sector.cells), float(np.hypot(*np.ptp(sector.cells, axis=0))))
        return Cover(sector, np.zeros(len(far), bool), far)
    away = cKDTree(np.column_stack([s.ravel(), c.ravel()])).query(sector.cells)[0]
    return Cover(sector, away <= 0.5 * sector.width, away)


def list_gaps(cover: Cover) -> list[Gap]:
    """Return the parts that no coil covered, the one with the largest hole first."""
    sector = cover.sector
    labels, count = label(~cover.covered.reshape(sector.shape), np.ones((3, 3), int))
    flat, half = labels.ravel(), 0.5 * np.array(sector.size)
    out = []
    for k in range(1, count + 1):
        mine = flat == k
        low, high = sector.cells[mine].min(axis=0) - half, sector.cells[mine].max(axis=0) + half
        hole = 2.0 * (float(np.max(cover.away[mine])) - 0.5 * sector.width)
        out.append(Gap(
            (float(low[0]), float(low[1])), (float(high[0]), float(high[1])),
            int(np.count_nonzero(mine)) * sector.size[0] * sector.size[1], hole,
        ))  # fmt: skip
    return sorted(out, key=lambda gap: -gap.hole_m)
