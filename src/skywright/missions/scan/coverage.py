"""Coverage of a scan: inspected fraction of the pattern's length, and of the area."""

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from skywright.core.arrays import Array, Mask
from skywright.description.world.surface import Cylinder, roll_points, unroll_points
from skywright.inspection.contact_quality import GAP_LIMIT, REACH, TILT_LIMIT
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.task import Scan
from skywright.models.eddy_current import Coil
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.where import PLANNING, Where

STEP = 0.001
"""m, spacing of points on the path."""
CELLS = 40_000
"""Largest number of cells of the sector; a cell is a quarter of a footprint wide if that gives
fewer."""

COVERAGE_MEASURES: Measures = {
    "coverage.fraction": (
        "",
        "fraction of the requested pattern inspected with a gap up to 1 mm and a tilt up to 10 deg",
    ),
    "coverage.missed_max_mm": ("mm", "longest uninspected piece of the requested pattern"),
    "coverage.area_fraction": (
        "",
        "fraction of the sector's area under the coil's footprint with a gap up to 1 mm "
        "(crack-scan: as its procedure says) and a tilt up to 10 deg",
    ),
    "coverage.pitch_mm": ("mm", "distance between neighbouring passes of a raster"),
    "coverage.pitch_full_mm": (
        "mm",
        "largest pass distance that inspects the whole area: the coil's footprint; crack-scan: the "
        "swath less the lateral error",
    ),
}
"""Metrics of `judge_coverage`."""
SCAN = Where(("scan",))
COVERAGE_WHERE = {"coverage.": SCAN, "coverage.pitch": PLANNING}


class Coverage(NamedTuple):
    """Coverage of one scan, on the true pipe; c is unwrapped around the pattern's middle."""

    path: Array  # (n, 2) s, c m, the requested pattern
    seen: Mask  # (n,) whether it was inspected there
    cells: Array  # (k, 2) s, c m, of the sector
    covered: Mask  # (k,)
    cell: float  # m, their width
    footprint: float  # m, the coil's diameter


def find_asked_path(way: ScanWay, known: Cylinder, true: Cylinder) -> Array:
    """Return the requested pattern on the true pipe, (n, 2) s, c m, c unwrapped.

    The robot places it on the pipe that it `known`s. An error of the position along the axis and of
    the rotation about it, which touches do not determine, is not attributed to the scan.
    """
    corners = way.corners_sphi
    pieces = [corners[:1]]
    for a, b in pairwise(corners):
        n = math.ceil(math.hypot(b[0] - a[0], known.radius * (b[1] - a[1])) / STEP)
        pieces.append(a + np.linspace(0.0, 1.0, n + 1)[1:, None] * (b - a))
    return _carry(np.concatenate(pieces), known, true)


def _carry(sphi: Array, known: Cylinder, true: Cylinder) -> Array:
    p, _ = roll_points(known, sphi[:, 0], known.radius * sphi[:, 1])
    s, c, _ = unroll_points(true, p, near=true.radius * sphi[:, 1])
    return np.column_stack([s, c])


def compute_scan_coverage(run: Flown[Scan, ScanWay], known: Cylinder) -> Coverage:
    """Compare the scan with the requested pattern."""
    s, true = run.samples[SCAN.select(run.samples, run.phases)], run.setup.true.cylinder
    assert true is not None
    path = find_asked_path(run.way, known, true)
    along, around, _ = unroll_points(true, s["p_WT"], near=float(np.mean(path[:, 1])))
    good = (s["gap_max"] < GAP_LIMIT) & (s["tilt"] < TILT_LIMIT)
    tip = cKDTree(np.column_stack([along, around])[good]) if np.any(good) else None
    coil, task = Coil(), run.task
    footprint = 2.0 * coil.outer_radius
    arc = math.radians(task.arc_deg) * known.radius if task.pattern != "line" else footprint
    cell = max(0.25 * footprint, math.sqrt(arc * task.pass_length_m / CELLS))
    n = [max(1, round(x / cell)) for x in (task.pass_length_m, arc)]
    middle = task.get_centre()
    u, v = ((np.arange(k) + 0.5) / k - 0.5 for k in n)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    sector = [task.centre_s_m, middle] + grid * [task.pass_length_m, arc / known.radius]
    cells = _carry(sector, known, true)
    if tip is None:
        seen, covered = np.zeros(len(path), bool), np.zeros(len(cells), bool)
    else:
        seen = tip.query(path, distance_upper_bound=REACH)[0] < REACH
        covered = tip.query(cells)[0] < 0.5 * footprint
    return Coverage(path, seen, cells, covered, cell, footprint)


def judge_coverage(run: Flown[Scan, ScanWay], found: Coverage) -> dict[str, float]:
    """Return the metrics of a coverage."""
    out = {
        "coverage.fraction": float(np.mean(found.seen)),
        "coverage.missed_max_mm": max((1e3 * m[2] for m in list_missed(found)), default=0.0),
        "coverage.area_fraction": float(np.mean(found.covered)),
        "coverage.pitch_full_mm": 1e3 * found.footprint,
    }
    if run.task.pattern == "raster" and run.task.passes > 1:
        around = found.path[:, 1]
        out["coverage.pitch_mm"] = 1e3 * float(np.ptp(around)) / (run.task.passes - 1)
    return out


def list_missed(found: Coverage) -> list[tuple[Array, Array, float]]:
    """Return the missed pieces of the pattern: both ends (2,) m and their length (m)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], found.seen, [True]]).astype(int)))
    return [
        (found.path[a], found.path[b - 1], STEP * float(b - a))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def describe_coverage(found: Coverage) -> dict[str, Any]:
    """Return areas and missed pieces as plain numbers (s and c in m, on the pipe)."""
    area = len(found.cells) * found.cell**2
    return {
        "sector_m2": round(area, 6),
        "inspected_m2": round(area * float(np.mean(found.covered)), 6),
        "missed": [
            {"from_m": a.round(4).tolist(), "to_m": b.round(4).tolist(), "length_m": round(n, 4)}
            for a, b, n in list_missed(found)
        ],
    }
