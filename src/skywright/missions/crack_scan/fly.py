"""Flight of a crack search: a scan, then a second scan of the missed parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from skywright.core.arrays import Array, Table
from skywright.description.world.surface import Cylinder, unroll_points
from skywright.missions.crack_scan.again import build_passes
from skywright.missions.crack_scan.cover import build_sector, compute_cover
from skywright.missions.crack_scan.display import find_array, place_coils
from skywright.missions.crack_scan.plan import CrackWay, compute_coil_width
from skywright.missions.crack_scan.search import find_contact
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.fly import fly_scan
from skywright.missions.scan.plan import plan_found
from skywright.planning.patterns import Pattern
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.sensors.eddy_array import EddyArray


def fly(s: Supervisor[CrackScan], way: CrackWay) -> Flight:
    """Fly the phases between take-off and landing."""
    return fly_scan(cast(Any, s), way.scan, Missed(s, way) if s.task.again else None)


class Missed:
    """Tracks the coverage while the probe slides, and plans the passes over the missed parts."""

    def __init__(self, s: Supervisor[CrackScan], way: CrackWay) -> None:
        """Constructed in the air, far from the pipe: the present reading is that of air."""
        self._s, self._way = s, way
        self._array = find_array(way.setup)
        self._reading = s.vehicle.look(EddyArray.Reading)
        self._air = self._read()
        self._seen: list[tuple[Array, Array, Any]] = []  # place (3,) m and attitude of the tip, z

    def _read(self) -> Any:
        z = np.array(self._reading.z)[: 2 * self._array.table.coils]
        return z[::2] + 1j * z[1::2]

    def look(self) -> None:
        estimate = self._s.vehicle.estimate
        self._seen.append((np.array(estimate["p_WT"]), np.array(estimate["R_WT"]), self._read()))

    def plan_again(self, known: Cylinder, row: Any) -> Mapping[str, Table] | None:
        way, task, procedure = self._way, self._s.task, self._s.task.procedure
        p, R, z = (np.array(x) for x in zip(*self._seen, strict=True))
        s, c, _ = unroll_points(known, p, near=task.get_centre() * known.radius)
        S, C = place_coils(self._array, s, c, R, known.R_WP, c / known.radius)
        counts = find_contact(way.display, z, self._air, procedure.gap_max_m)
        width = compute_coil_width(self._array)
        cover = compute_cover(build_sector(task, known.radius, width), S[counts], C[counts])
        enough = cover.fraction >= procedure.coverage_fraction
        if enough and cover.hole_m <= procedure.hole_max_m:
            return None
        # the array may be skewed to its passes: then its swath is narrower, and its ends have to go
        # further
        swath = float(np.median(np.ptp(C, axis=1))) + width
        ahead = float(np.median(np.max(np.abs(S - s[:, None]), axis=1)))
        pitch = max(swath - (way.swath_m - way.pitch_m), 0.25 * swath)
        passes = build_passes(cover, swath, pitch, way.lateral_std_m, ahead)
        if not len(passes):
            return None
        corners = passes * [1.0, 1.0 / known.radius]
        plan = plan_found(cast(Any, way.setup), known, row, Pattern(corners, None))
        return plan.segments if plan.feasible else None
