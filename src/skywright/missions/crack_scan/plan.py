"""Plan of a crack search: the pitch of the passes follows from swath and lateral error."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np

from skywright.description.world.surface import unroll_points
from skywright.errors import InputError
from skywright.inspection.indications import COIL_WIDTH
from skywright.missions.crack_scan.display import (
    Array,
    Display,
    find_array,
    place_coils,
    set_up_display,
)
from skywright.missions.crack_scan.lateral import compute_lateral_std
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.plan import plan as plan_scan
from skywright.missions.skills.procedure import CrackProcedure
from skywright.run.need import find_lacking_energy
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

OUTER_RADIUS = 0.0025
"""m, of the coil of COIL_WIDTH: the footprint of other coils scales with their radius."""


class CrackWay(NamedTuple):
    """Display, passes and plan of the search."""

    scan: ScanWay
    display: Display  # set up on the block before the flight
    swath_m: float  # of one pass
    pitch_m: float  # largest distance between passes
    lateral_std_m: float  # of a pass, in the wind of the mission
    passes: int
    setup: Setup[CrackScan]  # to plan again with


def plan(setup: Setup[CrackScan]) -> MissionPlan[CrackWay]:
    """Set up the display, choose the passes, and plan their scan.

    Raises InputError for a robot without an array, a sector narrower than the swath, and an
    unsuitable block.
    """
    array, task = find_array(setup), setup.task
    pipe = setup.world.pipe
    if pipe is None:
        raise InputError(f"world {setup.world.name!r} has no pipe to search for cracks")
    display = set_up_display(setup, array)
    swath = compute_swath(array)
    arc = math.radians(task.arc_deg) * pipe.diameter_m / 2
    if swath > arc:
        raise InputError(
            f"mission.task.arc_deg: a sector of {1e3 * arc:.0f} mm is narrower than the swath of "
            f"{1e3 * swath:.0f} mm; valid: {math.degrees(2 * swath / pipe.diameter_m):.0f} deg or "
            "more, or fewer coils"
        )
    lateral = compute_lateral_std(setup)
    pitch = compute_pitch(swath, array, task.procedure, lateral)
    passes = task.passes or 1 + math.ceil((arc - swath) / pitch - 1e-9)
    # the outer passes lie half a swath inside the sector, less their lateral error
    inside = arc - swath + (swath - pitch)
    narrow = math.degrees(2 * max(inside, 1e-4) / pipe.diameter_m)
    d = setup.description
    asked = task.model_copy(update={
        "arc_deg": narrow, "passes": max(passes, 1), "pattern": "raster" if passes > 1 else "line"
    })  # fmt: skip
    mission = d.mission.model_copy(update={"task": asked})
    found = plan_scan(cast(Any, Setup(d._replace(mission=mission))))
    if found.feasible:
        spacing = inside / (passes - 1) if passes > 1 else 0.0
        askew = find_askew(array, setup, found.segments["scan"], swath, min(pitch, spacing))
        found = found._replace(feasible=askew is None, blocked_by=askew)
    way = (
        None
        if found.way is None
        else CrackWay(found.way, display, swath, pitch, lateral, passes, setup)
    )
    planned = cast(MissionPlan[CrackWay], found._replace(way=cast(Any, way)))
    if not planned.feasible:
        return planned
    what = f"{passes} passes of {1e3 * task.pass_length_m:.0f} mm"
    lacking = find_lacking_energy(setup, planned, what)
    return planned._replace(feasible=lacking is None, blocked_by=lacking)


def find_askew(
    array: Array, setup: Setup[CrackScan], rows: Any, swath: float, pitch: float
) -> str | None:
    """Return a refusal if the array is so skewed to its passes that they leave gaps, or None.

    The heading of a level platform follows the level part of the probe's axis, and the array turns
    with it.
    """
    cylinder = setup.cylinder
    if cylinder is None or array.table.coils < 2:
        return None
    _, c, _ = unroll_points(cylinder, rows["p_WT"])
    phi = c / cylinder.radius
    zero = np.zeros(len(rows))
    along, _ = place_coils(array, zero, zero, rows["R_WT"], cylinder.R_WP, phi)
    skew = np.arcsin(np.minimum(np.ptp(along, axis=1) / array.table.width_m, 1.0))
    k = int(np.argmax(skew))
    left = swath - array.table.width_m * (1.0 - math.cos(float(skew[k])))
    if left >= pitch - 1e-9:
        return None
    inclined = math.degrees(math.asin(abs(float(cylinder.R_WP[2, 1]))))
    return (
        f"the array lies {math.degrees(skew[k]):.0f} deg askew to its passes at phi = "
        f"{math.degrees(phi[k]):.0f} deg and covers {1e3 * left:.0f} mm of the "
        f"{1e3 * pitch:.0f} mm between them: near the top or the bottom of a pipe that is inclined "
        f"by {inclined:.2f} deg a level platform turns with the normal; leave that part out"
    )


def compute_coil_width(array: Array) -> float:
    """Return the width (m) of a coil's footprint, at half height over a crack."""
    return COIL_WIDTH * array.table.outer_radius_m / OUTER_RADIUS


def compute_swath(array: Array) -> float:
    """Return the width (m) that one pass covers."""
    table = array.table
    return (table.width_m if table.coils > 1 else 0.0) + compute_coil_width(array)


def compute_pitch(
    swath: float, array: Array, procedure: CrackProcedure, lateral: float
) -> float:  # fmt: skip
    """Return the largest distance (m) of passes that leaves gaps on at most 1 % of their length.

    Both passes have the lateral deviation `lateral` (m): p = w - 2.33 sqrt(2) s, limited to w less
    the overlap. Raises InputError if the lateral error leaves nothing.
    """
    overlap = procedure.overlap_fraction * compute_coil_width(array)
    pitch = swath - max(2.33 * math.sqrt(2.0) * lateral, overlap)
    if pitch < 0.001:
        raise InputError(
            f"mission.task.procedure.lateral_std_m: {1e3 * procedure.lateral_std_m:g} mm, "
            f"{1e3 * lateral:.2g} mm with the gusts of world.wind, leaves a pitch of "
            f"{1e3 * pitch:.1f} mm of a swath of {1e3 * swath:.1f} mm; valid: 1 mm or more; use an "
            "array, or lower the lateral error"
        )
    return pitch
