"""Metrics of a run, from its recording and plan. Names are dotted and end in their unit.

Truth is used to judge (gap, tilt, tip error, weld position); what the inspection itself uses
(instrument and motion capture) is the same data that a real flight would record.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.recordings.columns import has_columns
from skywright.run.flight import Flown, PhaseRecord

Array = NDArray[np.float64]
Samples = NDArray[Any]

OFF_SURFACE = 1e-4
"""m, gap above which the tip counts as off the surface; below lies the soft contact model."""
OUTAGE = 0.6
"""s without a sample of the localisation that count as an outage."""


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
    """How a flight bears outages of its localisation, and whether it knows how well."""
    if not has_columns(s, "pose_std") or not np.any(s["pose_std"] > 0.0):
        return {}
    away = s["fix_age"] > OUTAGE
    stated = s["p_std"] if has_columns(s, "p_std") else s["pose_std"][:, None]
    over = ((s["est_p_WB"] - s["p_WB"]) / stated) ** 2
    out = {
        "estimate.outage_s": float(np.sum(dt[away])),
        "estimate.sigmas": math.sqrt(np.mean(over)),
    }
    if np.any(away):
        out["estimate.outage_max_mm"] = 1e3 * float(np.max(error[away]))
        out["estimate.outage_sigmas"] = math.sqrt(np.mean(over[away]))
    return out


def compute_tracking(run: Flown[Any, Any]) -> dict[str, float]:
    """Return how the planned segments are tracked, and the error while the last hold lasts."""
    samples, phases = run.samples, run.phases
    moving = in_phases(samples, phases, *run.plan.segments) | np.isin(
        samples["phase"], [i for i, p in enumerate(phases) if p.name.startswith("hold")]
    )
    error = np.linalg.norm(samples["p_WB"] - samples["ref_p_WB"], axis=1)
    tilt = 2.0 * np.arccos(
        np.clip(np.hypot(samples["q_WB"][:, 0], samples["q_WB"][:, 3]), 0.0, 1.0)
    )
    holds = [i for i, p in enumerate(phases) if p.name.startswith("hold")]
    last = samples["phase"] == holds[-1] if holds else moving
    out: dict[str, float] = {}
    held = [samples["phase"] == i for i in holds]
    for i, phase in enumerate(phases[:-1]):  # what is not held is passed
        if phase.name in run.plan.segments and not phases[i + 1].name.startswith("hold"):
            there = np.flatnonzero(samples["phase"] == i)[-1:]
            held.append(np.isin(np.arange(len(samples)), there))
    if any(np.any(h) for h in held):
        out |= _judge_holds(samples, [h for h in held if np.any(h)])
    if np.any(moving):
        out["position.rms_m"] = float(np.sqrt(np.mean(error[moving] ** 2)))
        out["position.max_m"] = float(np.max(error[moving]))
        out["platform.tilt_max_deg"] = math.degrees(float(np.max(tilt[moving])))
    if np.any(last):
        mean = np.mean((samples["p_WB"] - samples["ref_p_WB"])[last], axis=0)
        out["position.final_error_m"] = float(np.linalg.norm(mean))
    return out


def _judge_holds(samples: Samples, held: list[NDArray[np.bool_]]) -> dict[str, float]:
    """Return how far off its place and its heading the platform is, in the worst of the holds."""
    far = np.linalg.norm(samples["p_WB"] - samples["ref_p_WB"], axis=1)
    turn = [2.0 * np.arctan2(samples[q][:, 3], samples[q][:, 0]) for q in ("q_WB", "ref_q_WB")]
    off = np.abs(np.angle(np.exp(1j * (turn[0] - turn[1]))))
    return {
        "position.hold_error_m": max(float(np.mean(far[h])) for h in held),
        "heading.hold_error_deg": math.degrees(max(float(np.mean(off[h])) for h in held)),
    }
