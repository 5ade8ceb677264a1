"""Entries of a crack search in the database: indications, calibrations, coverage."""

from __future__ import annotations

import numpy as np

from skywright.description.world.surface import roll_points
from skywright.inspection.files.nde import EddyScan
from skywright.inspection.history.entries import (
    Calibrated,
    Coverage,
    Entries,
    Indication,
    Missed,
    Procedure,
)
from skywright.inspection.notch_setup import TARGET
from skywright.missions.crack_scan.cover import list_gaps
from skywright.missions.crack_scan.display import find_array
from skywright.missions.crack_scan.plan import CrackWay
from skywright.missions.crack_scan.search import Search, as_scan, find_search
from skywright.missions.crack_scan.task import CrackScan
from skywright.missions.scan.metrics import find_place_std
from skywright.missions.skills.procedure import write_procedure
from skywright.run.flight import Flown
from skywright.run.setup import Setup
from skywright.vehicle.plant import SAMPLE_RATE

WALL = 0.01
"""m; the search measures no wall, but .nde requires one (assumed)."""
SIGNALS = "array.nde"
KEYS = (
    "layout", "coils", "width_m", "axis_deg", "frequency_khz", "inner_radius_m", "outer_radius_m",
    "winding_m", "recess_m", "gain_db", "phase_deg", "low_pass_hz", "high_pass_hz",
)  # fmt: skip
"""Keys of the instrument's table that an inspector chooses."""


def build_procedure(setup: Setup[CrackScan]) -> Procedure:
    """Return the procedure with the array and the speed."""
    task = setup.task
    table = find_array(setup).table
    return write_procedure(task.procedure, table, KEYS, speed_mps=task.speed_mps)


def build_entries(run: Flown[CrackScan, CrackWay]) -> Entries:
    """Return the flight's entries: places lie on the pipe of the world's file, in W.

    The position along the axis and the rotation about it, which touches do not determine, come from
    the flight's registration: the datum if one was measured, otherwise the map. A search that never
    began has only its calibration.
    """
    found, procedure = run.once(find_search), run.task.procedure
    array, display = find_array(run.setup), run.way.display.setup
    model = f"simulated array of {array.table.coils} coils"
    block = f"notch of {1e3 * procedure.notch_m:g} mm at {TARGET:g} % FSH"
    turned: dict[str, float | str] = {
        "frequency_khz": array.table.frequency_khz,
        "null_units": f"{display.null:.2f}",
        "gain_percent_per_unit": round(abs(display.factor), 3),
        "rotation_deg": round(float(np.degrees(np.angle(display.factor))), 1),
        "noise_percent": round(display.noise, 3),
    }
    before = Calibrated("ET", model, "", "before", block, turned, True)
    if found is None:
        return Entries("pipe", calibrations=((0.0, before),))
    check, end = found.check, float(run.samples["t"][-1])
    seen: dict[str, float | str] = {
        "notch_percent": round(check.height, 1), "phase_change_deg": round(check.phase_change, 2),
        "lift_off_deg": round(check.lift_angle, 2),
    }  # fmt: skip
    after = before._replace(
        stage="after", settings=seen, passed=check.holds, note="; ".join(check.reasons)
    )
    pipe = run.setup.world.pipe
    assert pipe is not None
    return Entries(
        "pipe",
        indications=tuple((x[0], x[1]) for x in _list_indications(run, found)),
        calibrations=((0.0, before), (end, after)),
        coverage=_describe_cover(found),
        material=f"{1e-6 * pipe.conductivity_s_per_m:g} MS/m, relative permeability "
        f"{pipe.relative_permeability:g}",
        registration_std_m=find_place_std(as_scan(run)),
        scans=((SIGNALS, build_eddy_scan(run, found)),),
    )


def _list_indications(
    run: Flown[CrackScan, CrackWay], found: Search
) -> list[tuple[float, Indication]]:
    mapped = run.setup.cylinder
    assert mapped is not None
    out = []
    for x in found.indications:
        # the same angle around the pipe of the map, whose radius differs
        p, _ = roll_points(mapped, x.s, x.c * mapped.radius / found.known.radius)
        place = (float(p[0, 0]), float(p[0, 1]), float(p[0, 2]))
        out.append((x.t, Indication(
            x.nature, *place, x.u95, length_mm=1e3 * x.length, amplitude=x.height,
            amplitude_unit="% FSH", data=SIGNALS,
        )))  # fmt: skip
    return out


def _describe_cover(found: Search) -> Coverage:
    cover = found.cover
    missed = [
        Missed(
            f"no coil in contact over {1e6 * gap.area_m2:.0f} mm2", gap.start, gap.end,
            float(max(np.subtract(gap.end, gap.start))),
        )
        for gap in list_gaps(cover)
    ]  # fmt: skip
    area = cover.area_m2
    return Coverage("m2", area, area * cover.fraction, tuple(missed))


def build_eddy_scan(run: Flown[CrackScan, CrackWay], found: Search) -> EddyScan:
    """Return the impedance of each coil over the scan; u is s and v is c of the tip."""
    array = find_array(run.setup)
    away = np.stack([found.s - found.place[:, :1], found.c - found.place[:, 1:]], axis=-1)
    return EddyScan(
        found.z.T, found.place, np.median(away, axis=0), 1e3 * array.table.frequency_khz, 1.0,
        SAMPLE_RATE, WALL, (f"simulated array of {array.table.coils} coils", ""), True,
        array.table.gain_db,
    )  # fmt: skip
