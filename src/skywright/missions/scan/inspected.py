"""Welds as flaws: the result of a scan for each weld that its pattern meets."""

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.description.world.surface import build_weld_curve, unroll_points
from skywright.inspection.weld import WeldResult
from skywright.missions.scan.coverage import SCAN, STEP, Coverage
from skywright.missions.scan.metrics import find_coverage, process_weld
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.task import Scan
from skywright.missions.scan.welds import NEAR, Expected, find_expected
from skywright.models.eddy_current import compute_weld_signal
from skywright.run.flight import Flown
from skywright.run.inspected import Inspected, InspectedFlaw

SITE = 2.0 * NEAR
"""m of path that count as one site without a weld."""


def find_inspected(run: Flown[Scan, ScanWay]) -> Inspected:
    """Return the welds that the pattern meets, found or not, and the sites without a weld.

    All crossings of one weld are one datum. A scan that never began found nothing and had no
    contact. A weld that the pattern does not meet is not considered.
    """
    world, true = run.setup.true.world, run.setup.true.cylinder
    pipe = world.pipe
    if true is None or pipe is None:
        return Inspected(())
    sizes = [
        {"contrast_units": abs(compute_weld_signal(pipe, w)), "width_mm": 2e3 * w.half_width_m}
        for w in world.list_welds()
    ]
    coverage = run.once(find_coverage)
    if coverage is None:
        lost = [InspectedFlaw(f"weld-{k}", size, False, False) for k, size in enumerate(sizes, 1)]
        return Inspected(tuple(lost))
    return judge_flaws(run, sizes, coverage, run.once(process_weld))


def judge_flaws(
    run: Flown[Scan, ScanWay],
    sizes: list[dict[str, float]],
    coverage: Coverage,
    weld: WeldResult | None,
) -> Inspected:
    """Compare the result with the welds of the true pipe; `sizes` are theirs, in order."""
    world, true = run.setup.true.world, run.setup.true.cylinder
    assert true is not None
    curves = [build_weld_curve(w, true.radius) for w in world.list_welds()]
    s, c = coverage.path.T
    expected = [
        find_expected(curve, s, c, w.half_width_m)
        for curve, w in zip(curves, world.list_welds(), strict=True)
    ]
    samples = run.samples[SCAN.select(run.samples, run.phases)]
    tip = np.column_stack(unroll_points(true, samples["p_WT"])[:2])
    found = np.zeros((0, 2))
    if weld is not None and weld.crossings:
        found = np.column_stack(unroll_points(true, np.array([x.p_W for x in weld.crossings]))[:2])
    flaws = []
    for k, (one, size) in enumerate(zip(expected, sizes, strict=True), 1):
        places = np.concatenate([one.crossings.reshape(-1, 2), *one.along])
        if len(places):
            under = _find_near(places, coverage.path, true.radius, 0.5 * coverage.footprint)
            seen = coverage.seen[under]
            near = _find_near(places, tip, true.radius)
            gap = float(np.max(samples["gap_max"][near])) if near.any() else np.nan
            flaws.append(InspectedFlaw(
                f"weld-{k}", size, bool(_find_near(places, found, true.radius).any()),
                bool(seen.any()), _find_signal(weld, near),
                {"gap_mm": 1e3 * gap, "crossings": float(len(one.crossings))},
            ))  # fmt: skip
    away = _measure_nearest(expected, s, c)
    clear = int(np.count_nonzero(coverage.seen & (away > SITE)) * STEP / SITE)
    calls = int(np.count_nonzero(_measure_nearest(expected, *found.T) > NEAR))
    return Inspected(tuple(flaws), clear, min(calls, clear), f"{1e3 * SITE:.0f} mm of path")


def _find_near(places: Array, points: Array, radius: float, within: float = NEAR) -> Mask:
    """Return which of `points` (n, 2) lie `within` (m) of any of `places` (k, 2), over the pipe."""
    apart = points[:, None, :] - places[None]
    around = radius * np.angle(np.exp(1j * apart[..., 1] / radius))
    return np.asarray(np.any(np.hypot(apart[..., 0], around) < within, axis=1))


def _measure_nearest(expected: list[Expected], s: Array, c: Array) -> Array:
    """Return the distance (n,) m of places from the nearest weld; infinite without one."""
    each = [np.abs(e.curve.measure_distance(s, c)) for e in expected]
    return np.min(np.stack(each), axis=0) if each else np.full(len(s), np.inf)


def _find_signal(weld: WeldResult | None, near: Mask) -> float | None:
    """Return the largest weld signal among the samples near the flaw, in contact."""
    if weld is None or len(weld.weld) != len(near):
        return None
    values = np.abs(weld.weld[near & weld.contact])
    return float(np.nanmax(values)) if np.isfinite(values).any() else None
