"""Result of a search: the display over the surface, indications, coverage, final block check."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np

from skywright.core.arrays import Array as Numbers
from skywright.core.arrays import Mask
from skywright.description.world.surface import Cylinder, roll_points, unroll_points
from skywright.inspection.indications import FlawFinder, Indication
from skywright.inspection.notch_setup import SetupCheck
from skywright.missions.crack_scan.cover import Cover, build_sector, compute_cover, list_gaps
from skywright.missions.crack_scan.display import Display, check_display, find_array, place_coils
from skywright.missions.crack_scan.plan import CrackWay, compute_coil_width
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.coverage import SCAN
from skywright.missions.scan.metrics import get_surface
from skywright.models.drawing import rotate_vectors
from skywright.recordings.columns import has_columns
from skywright.run.flight import Flown
from skywright.run.where import Where

AIR = Where(("start",))
TILT_LIMIT = math.radians(10.0)


class Search(NamedTuple):
    """Result of one flight; places are on the surveyed pipe."""

    s: Numbers  # (n, k) m, of the coils
    c: Numbers
    height: Numbers  # (n, k) % FSH, without slow changes; NaN where the gap was too large
    indications: list[Indication]
    counts: Mask  # (n, k), which readings are in contact, by their lift-off and the tip's axis
    cover: Cover  # coverage according to the robot
    z: Any  # (n, k) complex, display units
    t: Numbers  # (n,) s
    place: Numbers  # (n, 2) s, c m of the tip
    known: Cylinder  # the surveyed pipe
    check: SetupCheck  # on the block, after the flight


def find_search(run: Flown[CrackScan, CrackWay]) -> Search | None:
    """Process the scan; returns None if it never began."""
    samples = run.samples[SCAN.select(run.samples, run.phases)]
    known = get_surface(as_scan(run))
    if known is None or not len(samples) or not has_columns(samples, "eddy_array"):
        return None
    array, procedure = find_array(run.setup), run.task.procedure
    k = array.table.coils
    middle = run.task.get_centre() * known.radius
    s, c, _ = unroll_points(known, samples["meas_p_WT"], near=middle)
    S, C = place_coils(array, s, c, read_attitude(samples), known.R_WP, c / known.radius)
    z, air = read_signals(samples, k), find_air(run, k)
    counts = find_contact(run.way.display, z, air, procedure.gap_max_m)
    counts &= (compute_tilt(samples, known, c) < TILT_LIMIT)[:, None]
    display = run.way.display.setup.show(z)
    display[~counts] = np.nan
    finder = FlawFinder(
        threshold=procedure.threshold_percent, coil_width_m=compute_coil_width(array),
        track_std=procedure.track_std_m, radius_m=known.radius,
    )  # fmt: skip
    finder.add(samples["t"], display, S, C)
    _, height, _, _ = finder.compute_heights()
    sector = build_sector(run.task, known.radius, compute_coil_width(array))
    cover = compute_cover(sector, S[counts], C[counts])
    check = check_display(run.setup, array, run.way.display.setup, float(run.samples["t"][-1]))
    return Search(
        S, C, height, finder.find(), counts, cover, z, samples["t"], np.column_stack([s, c]), known,
        check,
    )  # fmt: skip


def read_signals(samples: Any, coils: int) -> Any:
    """Return the recorded signals (n, coils), complex, in display units."""
    z = samples["eddy_array"]
    return z[:, : 2 * coils : 2] + 1j * z[:, 1 : 2 * coils : 2]


def find_air(run: Flown[CrackScan, CrackWay], coils: int) -> Any:
    """Return the reading of each coil (coils,) in the air, on the ground before the flight."""
    z = read_signals(run.samples[AIR.select(run.samples, run.phases)], coils)
    return np.median(z.real, axis=0) + 1j * np.median(z.imag, axis=0)


def find_contact(display: Display, z: Any, air: Any, gap_max: float) -> Mask:
    """Return which signals (n, k) have a gap below `gap_max` (m), by their lift-off."""
    gap = display.measure_gaps(z, air)
    return np.asarray(np.isfinite(gap) & (np.nan_to_num(gap, nan=np.inf) < gap_max))


def compute_tilt(samples: Any, known: Cylinder, c: Numbers) -> Numbers:
    """Return the measured angle (n,) rad of the probe from the normal of the known pipe."""
    _, normal = roll_points(known, np.zeros(len(c)), c)
    axis = samples["meas_axis_W"]
    return np.asarray(np.arccos(np.clip(-np.sum(axis * normal, axis=1), -1.0, 1.0)))


def read_attitude(samples: Any) -> Numbers:
    """Return the tip's reference attitude (n, 3, 3), from which the coils' places follow."""
    n = len(samples)
    return np.stack(
        [rotate_vectors(samples["ref_q_WT"], np.tile(e, (n, 1))) for e in np.eye(3)], axis=2
    )


def as_scan(run: Flown[CrackScan, CrackWay]) -> Any:
    """Return the flight as one of the kind "scan"."""
    plan = run.plan._replace(way=cast(Any, run.way.scan))
    return Flown(cast(Any, run.setup), plan, run.samples, run.phases)


def describe_search(run: Flown[CrackScan, CrackWay], found: Search) -> dict[str, Any]:
    """Return procedure, passes, indications and the check as plain numbers."""
    way, cover = run.way, found.cover
    return {
        "procedure": run.task.procedure.model_dump(),
        "passes": way.passes,
        "swath_mm": round(1e3 * way.swath_m, 2),
        "pitch_mm": round(1e3 * way.pitch_m, 2),
        "sector_m2": round(cover.area_m2, 6),
        "inspected_m2": round(cover.area_m2 * cover.fraction, 6),
        "missed": [
            {
                "from_m": np.round(gap.start, 4).tolist(), "to_m": np.round(gap.end, 4).tolist(),
                "length_m": round(max(np.subtract(gap.end, gap.start)), 4),
            }
            for gap in list_gaps(cover)
        ],
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
