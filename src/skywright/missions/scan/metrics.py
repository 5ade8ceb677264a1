"""Metrics of the kind "scan": contact, tracking, estimated weld, coverage.

The evaluation uses the truth (gap, tilt, tip error, weld position). The inspection itself uses only
data that a real flight would record (instrument and motion capture).
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.surface import Cylinder
from skywright.inspection.calibration import (
    Calibration,
    build_calibration,
    measure_lift_off,
)
from skywright.inspection.recorded_scan import CALIBRATING, SCANNING
from skywright.inspection.weld import WeldResult, process_scan
from skywright.missions.scan.coverage import (
    COVERAGE_MEASURES,
    COVERAGE_WHERE,
    SCAN,
    Coverage,
    compute_scan_coverage,
    judge_coverage,
)
from skywright.missions.scan.plan import ScanWay
from skywright.missions.scan.task import Scan
from skywright.missions.scan.welds import WELD_MEASURES, judge_welds
from skywright.missions.skills.datum import (
    DATUM_MEASURES,
    DATUM_WHERE,
    get_datum,
    judge_datum,
    read_datum,
    spread_over_pipe,
)
from skywright.missions.skills.survey import read_touches
from skywright.missions.skills.surveyed import (
    SURVEY_MEASURES,
    SURVEY_WHERE,
    Surveyed,
    fit_touches,
    get_tip,
    judge_survey,
)
from skywright.recordings.columns import has_columns
from skywright.recordings.period import compute_period
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.metrics import OFF_SURFACE, quat_angle
from skywright.run.where import Where

LIFT_OFF_THRESHOLD = 15.0  # instrument units, Tognon 2018 section VII
WELD_THRESHOLD = 1.4
HOP_S = 0.05
"""s, a shorter loss of contact is a hop: it is counted in gusts, but is not a loss of contact."""

MEASURES: Measures = {
    "contact.gap_max_mm": (
        "mm",
        "largest air gap between probe and surface during the scan; excludes hops in gusty wind",
    ),
    "contact.hops": (
        "",
        "number of hops: losses of contact (gap above 0.1 mm) shorter than 0.05 s",
    ),
    "contact.hop_max_mm": ("mm", "largest air gap of a hop"),
    "contact.off_max_s": ("s", "longest loss of contact, including hops, rounded up to 0.01 s"),
    "contact.no_force_max_s": (
        "s",
        "longest time without contact force during the scan (true force)",
    ),
    "contact.tilt_max_deg": (
        "deg",
        "largest angle between probe and surface normal during the scan",
    ),
    "contact.duration_s": ("s", "duration of the scan"),
    "contact.retries": ("", "number of repeated touches and scans"),
    "tip.tangential_rms_mm": (
        "mm",
        "rms distance of the tip from its path, measured along the surface",
    ),
    "tip.tangential_max_mm": (
        "mm",
        "largest distance of the tip from its path, measured along the surface",
    ),
    "platform.attitude_error_max_deg": ("deg", "largest attitude error during the scan"),
    "platform.offset_rms_mm": ("mm", "rms distance of the platform from its nominal pose"),
    "touch.attitude_error_max_deg": ("deg", "largest attitude error during touch-down"),
    "rotors.thrust_max_fraction": (
        "",
        "largest ratio of a rotor's thrust to its limit during the scan",
    ),
    **WELD_MEASURES,
    **SURVEY_MEASURES,
    **DATUM_MEASURES,
    **COVERAGE_MEASURES,
}
"""Metric -> unit and meaning, for the metrics that only this kind has."""


TOUCH = Where(("touch", "settle"))
RETRIED = Where((*TOUCH.phases, *SCAN.phases))
WHERE = {
    **dict.fromkeys(("contact.", "force.", "tip.", "platform.", "rotors.", "weld."), SCAN),
    **COVERAGE_WHERE,
    **SURVEY_WHERE,
    **DATUM_WHERE,
    "touch.": TOUCH,
    "contact.retries": RETRIED,
}


def compute_metrics(run: Flown[Scan, ScanWay]) -> dict[str, float]:
    """Return contact, tracking, weld and coverage of a scan."""
    samples, phases, description = run.samples, run.phases, run.setup.description
    out: dict[str, float] = {}
    surveyed = run.once(find_survey)
    if surveyed is not None and run.way.survey is not None:
        out |= judge_survey(run.setup, surveyed, run.way.survey.points, get_tip(run.setup))
        if surveyed.mark is not None:
            work, std = SCAN.select(samples, phases), run.once(find_place_std)
            out |= judge_datum(run.setup, surveyed.mark, samples, work, std or 0.0)
    scan = SCAN.select(samples, phases)
    if not np.any(scan):
        return out
    s = samples[scan]
    dt = compute_period(s["t"])
    lift = measure_lift_off(s["ec"], run.once(calibrate_on_touch))
    away = find_lifts(s["gap_max"], dt)
    hops = [a for a in away if a.duration_s < HOP_S]
    out["contact.hops"] = float(len(hops))
    out["contact.hop_max_mm"] = 1e3 * max((h.gap for h in hops), default=0.0)
    out["contact.off_max_s"] = max((a.duration_s for a in away), default=0.0)
    counts = np.ones(len(s), bool)
    if description.world.wind.gusty:
        for hop in hops:
            counts[hop.start : hop.end] = False
    out["contact.gap_max_mm"] = 1e3 * max(float(np.max(s["gap_max"][counts], initial=0.0)), 0.0)
    out["contact.lost_s"] = dt * float(np.count_nonzero(lift[counts] >= LIFT_OFF_THRESHOLD))
    if has_columns(s, "off_s"):
        out["contact.no_force_max_s"] = float(np.max(s["off_s"]))
    out["contact.tilt_max_deg"] = math.degrees(float(np.max(s["tilt"])))
    out["contact.duration_s"] = dt * len(s)
    out["contact.retries"] = float(sum(phases[i].outcome == "retry" for i in RETRIED.find(phases)))
    out["force.mean_n"] = float(np.mean(s["f_normal"]))
    out["force.min_n"] = float(np.min(s["f_normal"]))
    out["force.max_n"] = float(np.max(s["f_normal"]))
    normal = s["ref_normal_W"]
    error = s["p_WT"] - s["ref_p_WT"]
    tangential = error - np.sum(error * normal, axis=1)[:, None] * normal
    size = np.linalg.norm(tangential, axis=1)
    out["tip.tangential_rms_mm"] = 1e3 * float(np.sqrt(np.mean(size**2)))
    out["tip.tangential_max_mm"] = 1e3 * float(np.max(size))
    attitude = quat_angle(s["q_WB"], s["ref_q_WB"])
    out["platform.attitude_error_max_deg"] = math.degrees(float(np.max(attitude)))
    offset = s["p_WB"] - s["ref_p_WB"]
    out["platform.offset_rms_mm"] = 1e3 * float(np.sqrt(np.mean(np.sum(offset**2, axis=1))))
    touch = TOUCH.select(samples, phases)
    if np.any(touch):
        a = quat_angle(samples["q_WB"][touch], samples["ref_q_WB"][touch])
        out["touch.attitude_error_max_deg"] = math.degrees(float(np.max(a)))
    fractions = samples["rotor_thrust"][scan]
    rotors = description.robot.rotors
    n = len(rotors.azimuth_deg)
    out["rotors.thrust_max_fraction"] = float(np.max(fractions[:, :n])) / rotors.thrust_max_n
    coverage, weld = run.once(find_coverage), run.once(process_weld)
    if coverage is not None:
        out |= judge_coverage(run, coverage)
        if weld is not None:
            out |= judge_welds(run, weld, (coverage.path[:, 0], coverage.path[:, 1]))
    return out


class Lift(NamedTuple):
    """One interval off the surface."""

    start: int  # first sample
    end: int  # one past the last sample
    duration_s: float  # rounded up to samples
    gap: float  # m, largest


def find_lifts(gap_max: Array, dt: float) -> list[Lift]:
    """Return the intervals off the surface in `gap_max` (n,) m, the worst gap per sample.

    A gap above OFF_SURFACE is off the surface; `dt` (s) is the time between samples.
    """
    off = np.concatenate([[False], gap_max > OFF_SURFACE, [False]])
    edges = np.flatnonzero(off[1:] != off[:-1]).tolist()
    return [
        Lift(a, b, round((b - a) * dt, 6), float(np.max(gap_max[a:b])))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def find_survey(run: Flown[Scan, ScanWay]) -> Surveyed | None:
    """Fit the pipe to the recorded touches; returns None without a completed survey."""
    touches = read_touches(run.samples, run.phases)
    if run.way.survey is None or not any(not t.reason for t in touches):
        return None
    mark = read_datum(run.setup, run.samples, run.phases)
    return fit_touches(run.setup, touches, get_tip(run.setup), mark)


def find_place_std(run: Flown[Scan, ScanWay]) -> float | None:
    """Return the largest deviation (m), each way, of the pattern from the datum, or None."""
    surveyed, datum = run.once(find_survey), get_datum(run.setup)
    if surveyed is None or surveyed.mark is None or datum is None:
        return None
    corners = run.way.corners_sphi
    return spread_over_pipe(run.setup, surveyed.found, datum, surveyed.mark, corners)


def get_surface(run: Flown[Scan, ScanWay]) -> Cylinder | None:
    """Return the inspection's pipe: the surveyed one, otherwise that of the map."""
    surveyed = run.once(find_survey)
    return run.setup.cylinder if surveyed is None else surveyed.found.cylinder


def find_coverage(run: Flown[Scan, ScanWay]) -> Coverage | None:
    """Compare the scan with the pattern; returns None if it never began."""
    known = get_surface(run)
    if known is None or not np.any(SCAN.select(run.samples, run.phases)):
        return None
    return compute_scan_coverage(run, known)


def process_weld(run: Flown[Scan, ScanWay]) -> WeldResult | None:
    """Calibrate on the last approach before the scan, then process the scan's own data.

    Returns None if the scan never began. Raises InputError if the approach is insufficient.
    """
    cylinder = get_surface(run)
    s = run.samples[SCAN.select(run.samples, run.phases)]
    if cylinder is None or not len(s):
        return None
    calibration = run.once(calibrate_on_touch)
    result = process_scan(s["t"], s["ec"], s["meas_p_WT"], cylinder, calibration)
    # all crossings share the calibration error of the probe's markers: no fit contains it
    shared = run.setup.world.mocap.calibration_m
    return result._replace(lines=tuple(
        x._replace(std_offset=math.hypot(x.std_offset, shared)) for x in result.lines
    ))  # fmt: skip


def calibrate_on_touch(run: Flown[Scan, ScanWay]) -> Calibration:
    """Calibrate on the last touch before the first scan, from air to contact."""
    names = [p.name for p in run.phases]
    begin = first = names.index(SCANNING)
    while begin > 0 and names[begin - 1] in CALIBRATING:
        begin -= 1
    phase = run.samples["phase"]
    return build_calibration(
        run.samples["ec"][(phase >= begin) & (phase < first)],
        lift_off_threshold=LIFT_OFF_THRESHOLD,
        weld_threshold=WELD_THRESHOLD,
    )
