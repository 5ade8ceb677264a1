"""Metrics of a run, from its recording and plan. Names are dotted and end in their unit.

The evaluation (gap, tilt, tip error, weld position) uses the truth. The inspection itself uses only
data that a real flight would record (instrument and motion capture).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.recordings.columns import has_columns
from skywright.run.faults._rule import LET_GO, Acted
from skywright.run.flight import Flown, PhaseRecord
from skywright.run.where import ALOFT, HELD, TRACKED

Array = NDArray[np.float64]
Samples = NDArray[Any]

OFF_SURFACE = 1e-4
"""m, gap above which the tip is off the surface; smaller gaps are within the soft contact model."""
STALLED = 0.999
"""Share of its stall torque at which a servo counts as saturated."""
BACK = ("manual", "rejoin")
"""Phases of a pilot, between the two parts of an interrupted phase."""
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


def compute_common_metrics(
    samples: Samples,
    phases: list[PhaseRecord],
    hanging: bool = False,
    acted: Sequence[Acted] = (),
) -> dict[str, float]:
    """Compute the metrics that every run has; `acted` are the rules that ended the mission.

    Two arms hang below the landing gear (`hanging`) and touch the ground during take-off and
    landing: contacts in these phases do not count as collisions. While the arms carry part of the
    weight on the ground, saturation does not count: friction at the end of a link causes a yaw
    torque that exceeds that of the rotors.
    """
    dt = np.diff(samples["t"], prepend=samples["t"][0])
    flying = samples["rotor_thrust"].sum(axis=1) > 0.5
    hits = samples["f_collision"] > 0.0
    saturated = samples["saturated"] > 0.0
    if hanging:
        standing = hits & ~ALOFT.select(samples, phases)
        hits &= ~standing
        saturated &= ~standing
    error = np.linalg.norm(samples["est_p_WB"] - samples["p_WB"], axis=1)[flying]
    out = {
        "flight.duration_s": float(samples["t"][-1]) if len(samples) else 0.0,
        "flight.energy_wh": float(np.sum(samples["power"] * dt)) / 3600.0,
        "flight.saturated_s": float(np.sum(dt[saturated])),
        "flight.saturated_max_s": _find_longest(saturated, dt),
        "contact.collisions": float(np.count_nonzero(hits[1:] & ~hits[:-1]) + int(hits[:1].any())),
    }
    if has_columns(samples, "servo_load"):
        stalled = samples["servo_load"] >= STALLED
        out["arm.saturated_s"] = float(np.sum(dt[stalled]))
        out["arm.saturated_max_s"] = _find_longest(stalled, dt)
    if len(error):
        out["estimate.position_rms_mm"] = 1e3 * float(np.sqrt(np.mean(error**2)))
        out["estimate.position_max_mm"] = 1e3 * float(np.max(error))
        out.update(_judge_localisation(samples[flying], error, dt[flying]))
    return out | _judge_response(samples[flying], phases, acted)


def _judge_response(
    s: Samples, phases: list[PhaseRecord], acted: Sequence[Acted]
) -> dict[str, float]:
    """Evaluate the descent after the first rule acted.

    Failed phases do not show this: missions and pilots end phases so as well.
    On the ground the robot stays above its descending reference: this does not count as deviation.
    """
    fell = any(p.name == LET_GO for p in phases)
    if not acted or not has_columns(s, "ref_p_WB"):
        return {}
    after = s[s["t"] > acted[0].t_s]
    if not len(after):  # the motors had stopped before the response began
        return {"response.landed": 0.0} if fell else {}
    off = after["p_WB"] - after["ref_p_WB"]
    off[:, 2] = np.minimum(off[:, 2], 0.0)
    return {
        "response.landed": 0.0 if fell or phases[-1].outcome != "done" else 1.0,
        "response.deviation_max_m": float(np.max(np.linalg.norm(off, axis=1))),
    }


def _find_longest(on: NDArray[np.bool_], dt: Array) -> float:
    """Return the longest uninterrupted time (s) of `on`; `dt` (s) are the sample durations."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
    t = np.concatenate([[0.0], np.cumsum(dt)])
    return float(np.max(t[edges[1::2]] - t[edges[::2]], initial=0.0))


def _judge_localisation(s: Samples, error: Array, dt: Array) -> dict[str, float]:
    """Evaluate the estimate during outages of the localisation, and its consistency."""
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
    """Return the tracking error of the planned segments, and the error during the last hold."""
    samples, phases = run.samples, run.phases
    moving = TRACKED.select(samples, phases, run.plan.segments)
    error = np.linalg.norm(samples["p_WB"] - samples["ref_p_WB"], axis=1)
    tilt = 2.0 * np.arccos(
        np.clip(np.hypot(samples["q_WB"][:, 0], samples["q_WB"][:, 3]), 0.0, 1.0)
    )
    holds = HELD.find(phases)
    out: dict[str, float] = {}
    held = [np.isin(samples["phase"], whole) for whole in _join_holds(phases, holds)]
    judged = [_judge_hold(samples, h) for h in held if np.any(h)]
    passed = list[tuple[float, float]]()
    for i, phase in enumerate(phases[:-1]):  # a segment without a hold is passed
        whole = not phase.is_interrupted
        if phase.name in run.plan.segments and whole and not phases[i + 1].name.startswith("hold"):
            passed.append(_judge_passage(samples, np.flatnonzero(samples["phase"] == i)))
    if passed or judged:
        far, off = np.max(passed + judged, axis=0)
        out |= {"position.hold_error_m": float(far)}
        out["heading.hold_error_deg"] = math.degrees(off)
    if np.any(moving):
        out["position.rms_m"] = float(np.sqrt(np.mean(error[moving] ** 2)))
        out["position.max_m"] = float(np.max(error[moving]))
        out["platform.tilt_max_deg"] = math.degrees(float(np.max(tilt[moving])))
    if judged:
        out["position.final_error_m"] = judged[-1][0]
    return out


def _join_holds(phases: list[PhaseRecord], holds: list[int]) -> list[list[int]]:
    """Return the phases of each hold; a hold that a pilot interrupts consists of several."""
    out = list[list[int]]()
    for i in holds:
        if out and _goes_on(phases[out[-1][-1] : i + 1]):
            out[-1].append(i)
        else:
            out.append([i])
    return out


def _goes_on(phases: list[PhaseRecord]) -> bool:
    """Whether the last phase continues the first one after a pilot took over and gave back."""
    first, *between, last = phases
    back = all(p.name in BACK and p.outcome != "failed" for p in between)
    return first.outcome == "taken over" and first.name == last.name and back


def _judge_hold(samples: Samples, held: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the mean distance (m) and heading error (rad) from the held pose."""
    s = samples[held]
    far = np.linalg.norm(s["p_WB"] - s["ref_p_WB"], axis=1)
    return float(np.mean(far)), float(np.mean(_turn_between(s["q_WB"], s["ref_q_WB"])))


def _judge_passage(samples: Samples, segment: NDArray[np.intp]) -> tuple[float, float]:
    """Return distance (m) and heading error (rad) at which the platform passes a segment's end.

    The platform follows its reference with a lag, so samples within 1 s of the end count.
    """
    if not len(segment):
        return 0.0, 0.0
    end = samples[segment[-1]]
    near = samples[np.abs(samples["t"] - end["t"]) <= 1.0]
    far = np.linalg.norm(near["p_WB"] - end["ref_p_WB"], axis=1)
    k = int(np.argmin(far))
    off = _turn_between(near["q_WB"][k : k + 1], end["ref_q_WB"][None])
    return float(far[k]), float(off[0])


def _turn_between(a: Array, b: Array) -> Array:
    """Return the angle (n,) rad, 0 to pi, between the headings of attitudes (n, 4)."""
    turn = [2.0 * np.arctan2(q[:, 3], q[:, 0]) for q in (a, b)]
    return np.abs(np.angle(np.exp(1j * (turn[0] - turn[1]))))
