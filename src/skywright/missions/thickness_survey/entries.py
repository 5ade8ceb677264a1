"""Entries of a thickness survey in the database: readings with A-scans, calibrations, coverage."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.description.world.structure import Surface, build_surface, find_place
from skywright.inspection.echoes import find_echoes
from skywright.inspection.files.nde import UltrasonicScan
from skywright.inspection.history.entries import (
    COVERAGE,
    Calibrated,
    Coverage,
    Entries,
    Missed,
    Procedure,
    Reading,
)
from skywright.inspection.thickness import Rules
from skywright.missions.bridge_contact.metrics import find_place_std
from skywright.missions.bridge_contact.survey import read_survey
from skywright.missions.skills.datum import read_datum
from skywright.missions.skills.procedure import write_procedure
from skywright.missions.skills.surveyed_structure import fit_structure
from skywright.missions.thickness_survey.gauge import find_probe
from skywright.missions.thickness_survey.metrics import (
    SpotReading,
    find_check,
    find_readings,
    list_spot_names,
)
from skywright.missions.thickness_survey.plan import ThicknessWay
from skywright.missions.thickness_survey.task import ThicknessSurvey
from skywright.models.things.wall import Wall
from skywright.models.ultrasonic import SAMPLE_RATE
from skywright.recordings.columns import has_columns
from skywright.run.flight import Flown
from skywright.run.setup import Setup

KEYS = ("rate_hz", "frequency_mhz", "face_radius_m", "separation_m", "gain", "viscosity_pa_s")
"""Keys of the instrument's table that an inspector chooses."""
STEP = 0.001
"""m, spacing that .nde requires even for a single place."""


def build_procedure(setup: Setup[ThicknessSurvey]) -> Procedure:
    """Return the procedure with probe, force and times."""
    task = setup.task
    return write_procedure(
        task.procedure, find_probe(setup).table, KEYS, force_n=task.forces_n[0],
        settle_s=task.settle_s, hold_s=task.hold_s, tries=task.tries,
    )  # fmt: skip


def build_entries(run: Flown[ThicknessSurvey, ThicknessWay]) -> Entries:
    """Return the flight's entries: the last reading of each touch, at its place in S."""
    procedure, gauge = run.task.procedure, run.way.gauge
    probe = find_probe(run.setup)
    model = f"simulated contact probe, {probe.table.frequency_mhz:g} MHz"
    block = f"steps of {1e3 * procedure.block_thin_m:g} and {1e3 * procedure.block_thick_m:g} mm"
    before = Calibrated("UT", model, "", "before", block, {
        "velocity_mps": round(gauge.velocity, 1), "zero_us": round(1e6 * gauge.zero, 4),
        "gain_db": round(20 * math.log10(probe.table.gain), 1),
    }, True)  # fmt: skip
    found = run.once(find_readings)
    calibrations = [(0.0, before)]
    if found:
        check = run.once(find_check)
        after = before._replace(
            stage="after", passed=not check.reasons, note="; ".join(check.reasons),
            settings={f"error_{name}_mm": round(1e3 * e, 4) if math.isfinite(e) else "none"
                      for name, e in zip(("thin", "thick"), check.errors, strict=True)},
        )  # fmt: skip
        calibrations.append((float(run.samples["t"][-1]), after))
    surface = find_surface(run)
    readings, scans = [], []
    for k, one in enumerate(found, 1):
        name = f"ascans/{k:03d}.nde"
        place, u95 = _find_place(run, surface, one.reading.t)
        readings.append((one.reading.t, _build_reading(one, place, u95, f"{name}#0,0")))
        scans.append((name, _build_scan(run, one, place, model)))
    return Entries(
        _name_wall(run.setup), tuple(readings), calibrations=tuple(calibrations),
        coverage=_build_coverage(run.task, found), nominal_mm=1e3 * procedure.nominal_m,
        registration_std_m=find_place_std(run), scans=tuple(scans),
    )  # fmt: skip


def find_surface(run: Flown[ThicknessSurvey, ThicknessWay]) -> Surface:
    """Return the surveyed surface of the structure; without a survey that of the map."""
    structure, survey = run.setup.world.structure, run.way.contact.survey
    assert structure is not None
    if survey is not None:
        touches, ball = read_survey(survey, run.samples, run.phases)
        if any(not t.reason for t in touches):
            mark = read_datum(run.setup, run.samples, run.phases)
            structure = fit_structure(run.setup, touches, ball, mark).structure
    return build_surface(structure)


def _name_wall(setup: Setup[Any]) -> str:
    return next(name for name, thing in setup.world.things.items() if isinstance(thing, Wall))


def _find_place(run: Flown[Any, Any], surface: Surface, t: float) -> tuple[Any, float | None]:
    """Return the estimated place (3,) m of the tip in S at a time, and its u95 (m)."""
    samples, mocap = run.samples, run.setup.world.mocap
    i = min(int(np.searchsorted(samples["t"], t)), len(samples) - 1)
    std = math.nan
    if run.setup.world.tracks_markers:
        std = math.hypot(mocap.calibration_m, mocap.position_noise_m)
    elif has_columns(samples, "pose_std"):
        std = float(samples["pose_std"][i])
    place = find_place(surface, samples["est_p_WT"][i])
    return place, COVERAGE * std if math.isfinite(std) else None


def _build_reading(one: SpotReading, place: Any, u95: float | None, data: str) -> Reading:
    r, (x, y, off) = one.reading, (float(v) for v in place)

    def tell(value: float) -> float | None:
        return 1e3 * value if math.isfinite(value) else None

    return Reading(
        "thickness", tell(r.thickness), "mm", tell(r.u95), x, y, off, u95, r.accepted, r.reason,
        one.spot, data,
    )  # fmt: skip


def _build_scan(
    run: Flown[ThicknessSurvey, ThicknessWay], one: SpotReading, place: Any, model: str
) -> UltrasonicScan:
    """Return the A-scan of one reading at its place; its gated time is that of the first echo."""
    gauge, table = run.way.gauge, find_probe(run.setup).table
    echoes = find_echoes(one.ascan, gauge.pulse, Rules().threshold_fsh)
    time = echoes.times[0] if echoes.times else math.nan
    return UltrasonicScan(
        one.ascan[None, None], np.array([[time]]), SAMPLE_RATE, 0.0, (float(place[0]), STEP),
        (float(place[1]), STEP), gauge.velocity, 1e6 * table.frequency_mhz,
        2 * table.face_radius_m, run.task.procedure.nominal_m, (model, ""), True, table.rate_hz,
        20 * math.log10(table.gain),
    )  # fmt: skip


def _build_coverage(task: ThicknessSurvey, found: list[SpotReading]) -> Coverage:
    """Return the spots with an accepted reading, and the reasons for the others."""
    good = {r.spot for r in found if r.reading.accepted}
    why = {r.spot: r.reading.reason for r in found}
    missed = [
        Missed(f"{name}: {why.get(name, 'not reached, or no A-scan taken')}",
               (spot.x_m, spot.y_m), (spot.x_m, spot.y_m))
        for name, spot in zip(list_spot_names(task), task.spots, strict=True)
        if name not in good
    ]  # fmt: skip
    return Coverage("spots", float(len(task.spots)), float(len(good)), tuple(missed))
