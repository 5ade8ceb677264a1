"""Evaluation of a search: its indications and the true cracks of the sector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.surface import Cylinder, roll_points, unroll_points
from skywright.inspection.indications import Indication
from skywright.missions.crack_scan.plan import CrackWay
from skywright.missions.crack_scan.search import Search, as_scan, find_search
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.coverage import SCAN
from skywright.missions.scan.metrics import find_survey, get_surface
from skywright.models.things.crack import Crack
from skywright.run.flight import Flown
from skywright.run.inspected import Inspected, InspectedFlaw

NEAR = 0.008
"""m: an indication within this distance of a crack's mouth is that crack's."""
SITE = 0.02
"""m: edge of a square of surface that counts as one site without a crack."""


class Flaw(NamedTuple):
    """A true crack of the sector, in coordinates of the surveyed surface."""

    name: str
    crack: Crack
    s: float
    c: float
    wanted: tuple[float, float]  # s, c at which an indication of it is expected

    def measure(self, s: Array, c: Array) -> Array:
        """Return the distance (n,) m of places from its mouth."""
        turn, half = math.radians(self.crack.angle_deg), self.crack.length_m / 2
        ds, dc = np.asarray(s) - self.s, np.asarray(c) - self.c
        along = ds * math.sin(turn) + dc * math.cos(turn)
        across = ds * math.cos(turn) - dc * math.sin(turn)
        return np.asarray(np.hypot(np.maximum(np.abs(along) - half, 0.0), across))


def list_flaws(run: Flown[CrackScan, CrackWay]) -> tuple[list[Flaw], list[Flaw]]:
    """Return the cracks in the requested sector, and those beside it.

    Their places are expressed on the surveyed pipe, in its s and c. With a datum, indications are
    expected at the cracks' places on the asset: an error of the datum is an error of the
    indication.
    """
    true, task = run.setup.true.cylinder, run.task
    known = get_surface(as_scan(run)) or run.setup.cylinder
    if true is None or known is None:
        return [], []
    surveyed = find_survey(as_scan(run))
    seen = surveyed is not None and surveyed.mark is not None
    middle = task.get_centre()
    flaws, beside = list[Flaw](), list[Flaw]()
    for name, thing in run.setup.true.world.things.items():
        if isinstance(thing, Crack):
            s, c = carry(true, known, thing, middle * known.radius)
            wanted = carry(known, known, thing, middle * known.radius) if seen else (s, c)
            around = abs(math.remainder(wanted[1] / known.radius - middle, 2 * math.pi))
            inside = abs(wanted[0] - task.centre_s_m) <= task.pass_length_m / 2
            asked = inside and around <= math.radians(task.arc_deg) / 2
            (flaws if asked else beside).append(Flaw(name, thing, s, c, wanted))
    return flaws, beside


def carry(
    true: Cylinder, known: Cylinder, crack: Crack, middle: float = 0.0
) -> tuple[float, float]:
    """Return (s, c) m of a crack's middle on the known pipe, c within half a turn of `middle`."""
    p, _ = roll_points(true, crack.s_m, true.radius * math.radians(crack.around_deg))
    s, c, _ = unroll_points(known, p, near=middle)
    return float(s[0]), float(c[0])


def match(
    found: list[Indication], flaws: list[Flaw], beside: Sequence[Flaw] = ()
) -> tuple[list[float | None], int]:
    """Return the distance (m) of the nearest report of each flaw, or None; and the false calls.

    Reports are cracks and ambiguous indications with a positive height. A report within NEAR of a
    flaw of the sector, or `beside` it, belongs to that flaw; any other is a false call.
    """
    reports = [
        x for x in found if x.nature == "crack" or (x.nature == "ambiguous" and x.height > 0)
    ]
    s, c = np.array([x.s for x in reports]), np.array([x.c for x in reports])
    known = [*flaws, *beside]
    off = np.array([f.measure(s, c) for f in known]).reshape(len(known), len(reports))
    errors: list[float | None] = []
    for f, row in zip(flaws, off, strict=False):
        mine = np.flatnonzero(row <= NEAR)
        away = np.hypot(s[mine] - f.wanted[0], c[mine] - f.wanted[1])
        errors.append(float(np.min(away)) if mine.size else None)
    false = int(np.count_nonzero(np.min(off, axis=0, initial=math.inf) > NEAR))
    return errors, false


def find_inspected(run: Flown[CrackScan, CrackWay]) -> Inspected:
    """Return the cracks of the sector, found or not, and its sites without a crack."""
    (flaws, beside), found = list_flaws(run), run.once(find_search)
    if found is None:
        return Inspected(tuple(
            InspectedFlaw(f.name, _measure(f), False, False) for f in flaws
        ))  # fmt: skip
    errors, false = match(found.indications, flaws, beside)
    samples = run.samples[SCAN.select(run.samples, run.phases)]
    out = []
    for f, error in zip(flaws, errors, strict=True):
        near = f.measure(found.s, found.c) < 0.002
        seen = near & np.isfinite(found.height)
        rows = near.any(axis=1)
        gap = float(np.max(samples["gap_max"][rows])) if rows.any() else math.nan
        signal = float(np.max(found.height[seen])) if seen.any() else None
        out.append(InspectedFlaw(
            f.name, _measure(f), error is not None, bool(seen.any()), signal, {"gap_mm": 1e3 * gap}
        ))  # fmt: skip
    return Inspected(
        tuple(out), *_count_sites(found, [*flaws, *beside], false), f"{1e3 * SITE:.0f} mm square"
    )


def _measure(flaw: Flaw) -> dict[str, float]:
    return {"depth_mm": 1e3 * flaw.crack.depth_m, "length_mm": 1e3 * flaw.crack.length_m}


def _count_sites(found: Search, flaws: list[Flaw], false: int) -> tuple[int, int]:
    """Return the number of covered squares without a crack, and of false calls among them."""
    cells = found.cover.sector.cells[found.cover.covered]
    if not len(cells):
        return 0, 0
    clear = np.ones(len(cells), bool)
    for f in flaws:
        clear &= f.measure(*cells.T) > NEAR + SITE / 2
    sites = len(np.unique(np.floor(cells[clear] / SITE), axis=0))
    return sites, min(false, sites)
