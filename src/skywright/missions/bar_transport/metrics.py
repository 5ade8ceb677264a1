"""Metrics of a flight along a plan file: robot and carried bar against plan and obstacles."""

import math
from typing import Any

import numpy as np

from skywright.core.arrays import Array, Samples
from skywright.core.rotations import rot_from_quat
from skywright.description.world.scenario import get_limits
from skywright.missions.bar_transport.task import BarTransport
from skywright.models.geometry import compute_area_clearance, compute_clearance
from skywright.recordings.columns import has_columns
from skywright.recordings.period import compute_period
from skywright.run.flight import Flown
from skywright.run.kind import Measures
from skywright.run.setup import Setup
from skywright.run.where import Where

MEASURES: Measures = {
    "transport.contacts": ("", "contacts of robot, hands or bar during the transport"),
    "transport.clearance_min_m": (
        "m",
        "smallest clearance of robot and bar to structures, ground and the limits of the area",
    ),
    "transport.clearance_share": ("", "transport.clearance_min_m divided by the plan's margin"),
    "transport.goal_error_m": (
        "m",
        "distance of the bar's middle at the end from where it is with the platform at its goal",
    ),
    "transport.duration_s": ("s", "duration of the transport, without take-off and landing"),
    "transport.energy_wh": ("Wh", "electrical energy used during the transport"),
    "tip.tracking_max_m": ("m", "largest distance of the bar's centre from the plan"),
    "tip.tracking_rms_m": ("m", "rms distance of the bar's centre from the plan"),
    "platform.tracking_max_m": (
        "m",
        "largest distance of the platform from its reference: the plan, led by the lag of what "
        "hangs below it",
    ),
    "swing.max_deg": ("deg", "largest deviation of the passive link's angle from the plan"),
    "swing.rms_deg": ("deg", "rms deviation of the passive link's angle from the plan"),
}
"""Metric -> unit and meaning."""
CARRYING = Where(("transport", "plan", "settle"))
WHERE = dict.fromkeys(("transport.", "tip.", "platform.tracking_max_m", "swing."), CARRYING)


def compute_metrics(run: Flown[Any, None]) -> dict[str, float]:
    """Evaluate the phases in which the plan is followed."""
    samples, robot = run.samples, run.setup.robot
    out = run.plan.metrics
    mask = CARRYING.select(samples, run.phases)
    if not np.any(mask):
        return out
    s = samples[mask]
    dt = compute_period(s["t"])
    hits = s["f_collision"] > 0.0
    for force in ("left_f_W", "right_f_W"):
        if has_columns(s, force):
            hits |= np.abs(s[force]).max(axis=1) > 0.0
    out["transport.contacts"] = float(np.count_nonzero(hits[1:] & ~hits[:-1]) + int(hits[0]))
    clearance = compute_clearances(s, run.setup)
    out["transport.clearance_min_m"] = float(np.min(clearance))
    task = run.task
    if isinstance(task, BarTransport):
        out["transport.clearance_share"] = float(np.min(clearance)) / task.margin_m
        if not task.plan_file:
            goal = np.array([task.goal_x_m, 0.0, task.goal_z_m])
            # In wind the platform moves so that the bar keeps its position.
            error = s["ref_p_WB"][-1] - goal + compute_tip_errors(s[-1:])[0]
            out["transport.goal_error_m"] = float(np.linalg.norm(error))
    out["transport.duration_s"] = dt * len(s)
    out["transport.energy_wh"] = float(np.sum(s["power"])) * dt / 3600.0
    tip = np.linalg.norm(compute_tip_errors(s), axis=1)
    out["tip.tracking_max_m"] = float(np.max(tip))
    out["tip.tracking_rms_m"] = float(np.sqrt(np.mean(tip**2)))
    off = np.linalg.norm(s["p_WB"] - s["ref_p_WB"], axis=1)
    out["platform.tracking_max_m"] = float(np.max(off))
    if robot.pendulum is not None:
        swing = np.degrees(compute_swing(s))
        out["swing.max_deg"] = float(np.max(np.abs(swing)))
        out["swing.rms_deg"] = float(np.sqrt(np.mean(swing**2)))
    return out


def find_middle(s: Samples) -> Array:
    """Return the midpoint (n, 3) m of both hands."""
    return np.asarray(0.5 * (s["left_p_WH"] + s["right_p_WH"]))


def compute_tip_errors(s: Samples) -> Array:
    """Return the error of the midpoint of both hands relative to the plan, (n, 3) m in W.

    With fewer than two hands it is the error of the tip.
    """
    if not has_columns(s, "right_ref_p_WH") or not np.any(s["right_ref_p_WH"]):
        return np.asarray(s["p_WT"] - s["ref_p_WT"])
    true = find_middle(s)
    wanted = 0.5 * (s["left_ref_p_WH"] + s["right_ref_p_WH"])
    return np.asarray(true - wanted)


def compute_swing(s: Samples) -> Array:
    """Return the error of the passive link's angle in W, (n,) rad, in the robot's plane."""
    angle = np.empty(len(s))
    for i, row in enumerate(s):
        R = rot_from_quat(row["q_WB"])
        q = float(row["q"][0])
        down = -R @ np.array([math.sin(q), 0.0, math.cos(q)])
        ahead = R[:2, 0] / max(float(np.hypot(R[0, 0], R[1, 0])), 1e-9)
        # pointing down, rotated by q about y: (-sin q, 0, -cos q)
        angle[i] = math.atan2(-float(down[:2] @ ahead), -float(down[2]))
    return np.asarray(angle - s["ref_q"][:, 0])


def compute_clearances(s: Samples, setup: Setup[Any]) -> Array:
    """Return the true distance (n,) m of robot and bar to obstacles and to the area's limits."""
    scene, query = setup.scene, setup.clearance
    limits = get_limits(setup.world)
    out = np.empty(len(s))
    for i, row in enumerate(s):
        R = rot_from_quat(row["q_WB"])
        out[i] = compute_clearance(query, row["p_WB"], R, row["q"][: scene.n_joints]).distance
        if limits is not None:
            out[i] = min(out[i], compute_area_clearance(query, scene, limits))
    return out
