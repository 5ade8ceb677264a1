"""What a search found: the display over the surface, indications, coverage, the block after it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.spatial import cKDTree

from skywright.core.arrays import Array as Numbers
from skywright.core.arrays import Mask
from skywright.description.world.surface import Cylinder, unroll_points
from skywright.inspection.indications import FlawFinder, Indication
from skywright.inspection.notch_setup import SetupCheck
from skywright.missions.crack_scan.display import check_display, find_array, place_coils
from skywright.missions.crack_scan.plan import CrackWay, compute_coil_width
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.coverage import CELLS, SCAN
from skywright.missions.scan.metrics import get_surface
from skywright.models.drawing import rotate_vectors
from skywright.planning.patterns import SIDES
from skywright.recordings.columns import has_columns
from skywright.run.flight import Flown

TILT_LIMIT = math.radians(10.0)


class Search(NamedTuple):
    """Of one flight; places are on the pipe as the survey found it."""

    s: Numbers  # (n, k) m, of the coils
    c: Numbers
    height: Numbers  # (n, k) % FSH, less what is slow; NaN where the gap was too large
    indications: list[Indication]
    cells: Numbers  # (m, 2) s, c m, of the sector
    covered: Mask  # (m,)
    gap_max_m: float  # largest hole
    check: SetupCheck  # on the block, after the flight


def find_search(run: Flown[CrackScan, CrackWay]) -> Search | None:
    """Process the scan; None where it never came to scanning."""
    samples = run.samples[SCAN.select(run.samples, run.phases)]
    known = get_surface(as_scan(run))
    if known is None or not len(samples) or not has_columns(samples, "eddy_array"):
        return None
    array, procedure = find_array(run.setup), run.task.procedure
    k = array.table.coils
    s, c, _ = unroll_points(known, samples["meas_p_WT"])
    S, C = place_coils(array, s, c, read_attitude(samples), known.R_WP, c / known.radius)
    z = samples["eddy_array"][:, : 2 * k : 2] + 1j * samples["eddy_array"][:, 1 : 2 * k : 2]
    good = (samples["gap_max"] < procedure.gap_max_m) & (samples["tilt"] < TILT_LIMIT)
    display = run.way.display.show(z)
    display[~good] = np.nan
    finder = FlawFinder(
        threshold=procedure.threshold_percent, coil_width_m=compute_coil_width(array),
        track_std=procedure.track_std_m,
    )  # fmt: skip
    finder.add(samples["t"], display, S, C)
    _, height, _, _ = finder.compute_heights()
    cells, covered, hole = compute_coverage(run, known, S[good], C[good], compute_coil_width(array))
    check = check_display(run.setup, array, run.way.display, float(run.samples["t"][-1]))
    return Search(S, C, height, finder.find(), cells, covered, hole, check)


def read_attitude(samples: Any) -> Numbers:
    """Return the tip's attitude (n, 3, 3), as it was led: the coils' places follow from it."""
    n = len(samples)
    return np.stack(
        [rotate_vectors(samples["ref_q_WT"], np.tile(e, (n, 1))) for e in np.eye(3)], axis=2
    )


def compute_coverage(
    run: Flown[CrackScan, CrackWay], known: Cylinder, s: Numbers, c: Numbers, width: float
) -> tuple[Numbers, Mask, float]:
    """Return the sector's cells (m, 2), which are covered (m,), and the largest hole (m).

    A cell counts where a coil came within half its width, with a gap and tilt that count. A hole is
    the largest circle without a place that a coil covers.
    """
    task = run.task
    middle = math.radians(SIDES.get(task.side, task.centre_angle_deg)) * known.radius
    arc = math.radians(task.arc_deg) * known.radius
    cell = max(0.25 * width, math.sqrt(arc * task.pass_length_m / CELLS))
    n = [max(1, round(x / cell)) for x in (task.pass_length_m, arc)]
    u, v = ((np.arange(m) + 0.5) / m - 0.5 for m in n)
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = [task.centre_s_m, middle] + grid * [task.pass_length_m, arc]
    if not s.size:
        return cells, np.zeros(len(cells), bool), 2 * max(arc, task.pass_length_m)
    away = cKDTree(np.column_stack([s.ravel(), c.ravel()])).query(cells)[0]
    covered = away <= 0.5 * width
    return cells, covered, 2.0 * max(float(np.max(away)) - 0.5 * width, 0.0)


def as_scan(run: Flown[CrackScan, CrackWay]) -> Any:
    """Return the flight as one of the kind that it is flown as."""
    plan = run.plan._replace(way=cast(Any, run.way.scan))
    return Flown(cast(Any, run.setup), plan, run.samples, run.phases)


def describe_search(run: Flown[CrackScan, CrackWay], found: Search) -> dict[str, Any]:
    """Return procedure, passes, indications and the check as plain numbers."""
    way = run.way
    return {
        "procedure": run.task.procedure.model_dump(),
        "passes": way.passes,
        "swath_mm": round(1e3 * way.swath_m, 2),
        "pitch_mm": round(1e3 * way.pitch_m, 2),
        "block_after": {
            "notch_percent": round(found.check.height, 2),
            "phase_change_deg": round(found.check.phase_change, 2),
            "reasons": list(found.check.reasons),
        },
        "indications": [
            {
                "s_m": round(x.s, 4), "c_m": round(x.c, 4), "height_percent": round(x.height, 1),
                "length_mm": round(1e3 * x.length, 1), "width_mm": round(1e3 * x.width, 1),
                "angle_deg": round(math.degrees(x.angle), 0), "nature": x.nature,
                "u95_mm": round(1e3 * x.u95, 2),
            }
            for x in found.indications
        ],
    }  # fmt: skip
