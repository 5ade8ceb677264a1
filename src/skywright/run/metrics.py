"""Metrics of a run, from its recording and plan. Names are dotted and end in their unit.

Truth is used to judge (gap, tilt, tip error, weld position); what the inspection itself uses
(instrument and motion capture) is the same data that a real flight would record.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import Description
from skywright.description.world.surface import build_cylinder, unroll_points
from skywright.inspection.calibration import Calibration, build_calibration
from skywright.inspection.contact_quality import compute_coverage
from skywright.inspection.weld import WeldResult, process_scan
from skywright.inspection.weld_line import compute_line_error
from skywright.run.flight import PhaseRecord
from skywright.run.planning import MissionPlan

Array = NDArray[np.float64]
Samples = NDArray[Any]

LIFT_OFF_THRESHOLD = 15.0  # instrument units, Tognon 2018 section VII
WELD_THRESHOLD = 1.4
OFF_SURFACE = 1e-4
"""m, gap above which the tip counts as off the surface; below lies the soft contact model."""
OUTAGE = 0.6
"""s without a sample of the total station that count as an outage."""
HOP_S = 0.05
"""s, a shorter time off the surface is a hop: in gusts it is counted, but is no lost contact."""


def in_phases(samples: Samples, phases: list[PhaseRecord], *names: str) -> NDArray[np.bool_]:
    """Mask (n,) of the samples taken in any phase of these names."""
    wanted = [i for i, p in enumerate(phases) if p.name in names]
    return np.isin(samples["phase"], wanted)


def quat_angle(a: Array, b: Array) -> Array:
    """Angle (n,) rad between two arrays of unit quaternions (n, 4)."""
    dot = np.abs(np.sum(a * b, axis=-1))
    return np.asarray(2.0 * np.arccos(np.clip(dot, 0.0, 1.0)))


def compute_common_metrics(samples: Samples, phases: list[PhaseRecord]) -> dict[str, float]:
    """Metrics that every run has."""
    dt = np.diff(samples["t"], prepend=samples["t"][0])
    flying = samples["rotor_thrust"].sum(axis=1) > 0.5
    hits = samples["f_collision"] > 0.0
    error = np.linalg.norm(samples["est_p_WB"] - samples["p_WB"], axis=1)[flying]
    out = {
        "flight.duration_s": float(samples["t"][-1]) if len(samples) else 0.0,
        "flight.energy_wh": float(np.sum(samples["power"] * dt)) / 3600.0,
        "flight.saturated_s": float(np.sum(dt[samples["saturated"] > 0.0])),
        "contact.collisions": float(np.count_nonzero(hits[1:] & ~hits[:-1]) + int(hits[:1].any())),
    }
    if len(error):
        out["estimate.position_rms_mm"] = 1e3 * float(np.sqrt(np.mean(error**2)))
        out["estimate.position_max_mm"] = 1e3 * float(np.max(error))
        out.update(_judge_localisation(samples[flying], error, dt[flying]))
    return out


def _judge_localisation(s: Samples, error: Array, dt: Array) -> dict[str, float]:
    """How a flight without motion capture bears outages of its total station."""
    if not np.any(s["pose_std"] > 0.0):
        return {}
    away = s["fix_age"] > OUTAGE
    out = {
        "estimate.outage_s": float(np.sum(dt[away])),
        "estimate.sigmas": float(np.sqrt(np.mean((error / s["pose_std"]) ** 2) / 3.0)),
    }
    if np.any(away):
        out["estimate.outage_max_mm"] = 1e3 * float(np.max(error[away]))
    return out


def compute_waypoint_metrics(
    samples: Samples, phases: list[PhaseRecord], plan: MissionPlan, description: Description
) -> tuple[dict[str, float], None]:
    """Tracking of the planned path and error while holding the last way-point."""
    moving = in_phases(samples, phases, *plan.segments) | np.isin(
        samples["phase"], [i for i, p in enumerate(phases) if p.name.startswith("hold")]
    )
    error = np.linalg.norm(samples["p_WB"] - samples["ref_p_WB"], axis=1)
    tilt = 2.0 * np.arccos(
        np.clip(np.hypot(samples["q_WB"][:, 0], samples["q_WB"][:, 3]), 0.0, 1.0)
    )
    holds = [i for i, p in enumerate(phases) if p.name.startswith("hold")]
    last = samples["phase"] == holds[-1] if holds else moving
    out = {}
    if np.any(moving):
        out["position.rms_m"] = float(np.sqrt(np.mean(error[moving] ** 2)))
        out["position.max_m"] = float(np.max(error[moving]))
        out["platform.tilt_max_deg"] = math.degrees(float(np.max(tilt[moving])))
    if np.any(last):
        mean = np.mean((samples["p_WB"] - samples["ref_p_WB"])[last], axis=0)
        out["position.final_error_m"] = float(np.linalg.norm(mean))
    return out, None


def compute_scan_metrics(
    samples: Samples, phases: list[PhaseRecord], plan: MissionPlan, description: Description
) -> tuple[dict[str, float], WeldResult | None]:
    """Contact, tracking, weld and coverage of a scan; the weld result is None without contact."""
    out: dict[str, float] = {}
    scan = in_phases(samples, phases, "scan")
    if not np.any(scan):
        return out, None
    s = samples[scan]
    dt = float(np.median(np.diff(s["t"]))) if len(s) > 1 else 0.0
    axis = _instrument_axis()
    lift = s["ec"] @ axis
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
    out["contact.no_force_s"] = dt * float(np.count_nonzero(s["f_normal"] <= 0.0))
    out["contact.tilt_max_deg"] = math.degrees(float(np.max(s["tilt"])))
    out["contact.duration_s"] = dt * len(s)
    out["contact.retries"] = float(sum(p.outcome == "retry" for p in phases))
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
    touch = in_phases(samples, phases, "touch", "settle")
    if np.any(touch):
        a = quat_angle(samples["q_WB"][touch], samples["ref_q_WB"][touch])
        out["touch.attitude_error_max_deg"] = math.degrees(float(np.max(a)))
    fractions = samples["rotor_thrust"][scan]
    rotors = description.robot.rotors
    n = len(rotors.azimuth_deg)
    out["rotors.thrust_max_fraction"] = float(np.max(fractions[:, :n])) / rotors.thrust_max_n
    weld = _process_weld(samples, phases, description)
    if weld is not None:
        _add_weld_metrics(out, weld, description)
    _add_coverage(out, s, plan, description)
    return out, weld


class Lift(NamedTuple):
    """One time off the surface."""

    start: int  # first sample
    end: int  # one past the last sample
    duration_s: float  # rounded up to samples
    gap: float  # m, largest


def find_lifts(gap_max: Array, dt: float) -> list[Lift]:
    """Return the times off the surface in `gap_max` (n,) m, the worst gap since the sample before.

    Off is a gap above OFF_SURFACE; `dt` (s) is the time between samples.
    """
    off = np.concatenate([[False], gap_max > OFF_SURFACE, [False]])
    edges = np.flatnonzero(off[1:] != off[:-1]).tolist()
    return [
        Lift(a, b, round((b - a) * dt, 6), float(np.max(gap_max[a:b])))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def _instrument_axis() -> Array:
    from skywright.inspection.eddy_current import Instrument

    phase = Instrument().phase
    return np.array([math.cos(phase), math.sin(phase)])


def _process_weld(
    samples: Samples, phases: list[PhaseRecord], description: Description
) -> WeldResult | None:
    """Calibrate on the last approach before the scan, then process the scan's own data."""
    pipe = description.world.pipe
    if pipe is None:
        return None
    calibration = calibrate_on_touch(samples, phases)
    scan = in_phases(samples, phases, "scan")
    s = samples[scan]
    result = process_scan(s["t"], s["ec"], s["meas_p_WT"], build_cylinder(pipe), calibration)
    if result.line is None:
        return result
    # all crossings share the calibration error of the probe's markers, so no fit can see it
    shared = math.hypot(result.line.std_offset, description.world.mocap.calibration_m)
    return result._replace(line=result.line._replace(std_offset=shared))


def calibrate_on_touch(samples: Samples, phases: list[PhaseRecord]) -> Calibration:
    """The touch before the scan is the calibration: from air to contact."""
    touch = in_phases(samples, phases, "touch", "settle")
    return build_calibration(
        samples["ec"][touch],
        lift_off_threshold=LIFT_OFF_THRESHOLD,
        weld_threshold=WELD_THRESHOLD,
    )


def _add_weld_metrics(out: dict[str, float], weld: WeldResult, description: Description) -> None:
    out["weld.contact_fraction"] = weld.contact_fraction
    out["weld.crossings"] = float(sum(c.on_line or weld.line is None for c in weld.crossings))
    true = description.world.weld
    if weld.line is None or true is None or not true.present:
        return
    offset, angle = compute_line_error(weld.line, true)
    out["weld.offset_error_mm"] = 1e3 * abs(offset)
    out["weld.angle_error_deg"] = math.degrees(abs(angle))
    out["weld.offset_std_mm"] = 1e3 * weld.line.std_offset
    out["weld.angle_std_deg"] = math.degrees(weld.line.std_angle)


def _add_coverage(
    out: dict[str, float], s: Samples, plan: MissionPlan, description: Description
) -> None:
    pipe = description.world.pipe
    if pipe is None or plan.scan is None:
        return
    cyl = build_cylinder(pipe)
    path = np.asarray(plan.scan.path_sphi)
    along, around, _ = unroll_points(cyl, s["p_WT"])
    out["coverage.fraction"] = compute_coverage(
        path[:, 0], cyl.radius * path[:, 1], along, around, s["gap_max"], s["tilt"]
    )


__all__ = [
    "calibrate_on_touch",
    "compute_common_metrics",
    "compute_scan_metrics",
    "compute_waypoint_metrics",
    "find_lifts",
    "in_phases",
    "quat_angle",
]
