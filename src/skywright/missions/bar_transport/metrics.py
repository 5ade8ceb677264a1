"""Metrics of a flight along a plan file: robot and carried bar against plan and surroundings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.columns import has_columns
from skywright.core.rotations import rot_from_quat
from skywright.description.loader import Description
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import World
from skywright.models.geometry import build_clearance, compute_area_clearance, compute_clearance
from skywright.models.scene import build_scene
from skywright.planning.motion.plan_file import PlanFile
from skywright.run.flight import PhaseRecord
from skywright.run.metrics import in_phases
from skywright.run.planning import MissionPlan

Array = NDArray[np.float64]
Samples = NDArray[Any]

CARRYING = ("transport", "plan", "settle")


def compute_transport_metrics(
    samples: Samples, phases: list[PhaseRecord], plan: MissionPlan, description: Description
) -> tuple[dict[str, float], None]:
    """Judge the phases in which the plan is followed."""
    out: dict[str, float] = {}
    file = getattr(plan.task, "file", None)
    if isinstance(file, PlanFile):
        out |= file.metrics
    mask = in_phases(samples, phases, *CARRYING)
    if not np.any(mask):
        return out, None
    s = samples[mask]
    dt = float(np.median(np.diff(s["t"]))) if len(s) > 1 else 0.0
    hits = s["f_collision"] > 0.0
    for force in ("left_f_W", "right_f_W"):
        if has_columns(s, force):
            hits |= np.abs(s[force]).max(axis=1) > 0.0
    out["transport.contacts"] = float(np.count_nonzero(hits[1:] & ~hits[:-1]) + int(hits[0]))
    clearance = compute_clearances(s, description.robot, description.world)
    out["transport.clearance_min_m"] = float(np.min(clearance))
    out["transport.duration_s"] = dt * len(s)
    out["transport.energy_wh"] = float(np.sum(s["power"])) * dt / 3600.0
    tip = np.linalg.norm(compute_tip_errors(s), axis=1)
    out["tip.tracking_max_m"] = float(np.max(tip))
    out["tip.tracking_rms_m"] = float(np.sqrt(np.mean(tip**2)))
    off = np.linalg.norm(s["p_WB"] - s["ref_p_WB"], axis=1)
    out["platform.tracking_max_m"] = float(np.max(off))
    if description.robot.pendulum is not None:
        swing = np.degrees(compute_swing(s))
        out["swing.max_deg"] = float(np.max(np.abs(swing)))
        out["swing.rms_deg"] = float(np.sqrt(np.mean(swing**2)))
    return out, None


def compute_tip_errors(s: Samples) -> Array:
    """Return the bar's middle, between two hands, less where the plan has it: (n, 3) m in W.

    Without two hands the tip's.
    """
    if not has_columns(s, "right_ref_p_WH") or not np.any(s["right_ref_p_WH"]):
        return np.asarray(s["p_WT"] - s["ref_p_WT"])
    true = 0.5 * (s["left_p_WH"] + s["right_p_WH"])
    wanted = 0.5 * (s["left_ref_p_WH"] + s["right_ref_p_WH"])
    return np.asarray(true - wanted)


def compute_swing(s: Samples) -> Array:
    """Return the passive link's angle in W less the plan's, (n,) rad, in the robot's plane."""
    angle = np.empty(len(s))
    for i, row in enumerate(s):
        R = rot_from_quat(row["q_WB"])
        q = float(row["q"][0])
        down = -R @ np.array([math.sin(q), 0.0, math.cos(q)])
        ahead = R[:2, 0] / max(float(np.hypot(R[0, 0], R[1, 0])), 1e-9)
        # hanging, and turned by q about y: (-sin q, 0, -cos q)
        angle[i] = math.atan2(-float(down[:2] @ ahead), -float(down[2]))
    return np.asarray(angle - s["ref_q"][:, 0])


def compute_clearances(s: Samples, robot: Robot, world: World) -> Array:
    """Return the true distance (n,) m of robot and bar to the world and to its area's limits."""
    scene = build_scene(robot, world)
    query = build_clearance(scene)
    area = get_structures(world).area
    limits = None
    if area is not None:
        limits = np.array([
            [area.x_min_m, area.x_max_m], [area.y_min_m, area.y_max_m], [-math.inf, area.z_max_m],
        ])  # fmt: skip
    out = np.empty(len(s))
    for i, row in enumerate(s):
        R = rot_from_quat(row["q_WB"])
        out[i] = compute_clearance(query, row["p_WB"], R, row["q"][: scene.n_joints]).distance
        if limits is not None:
            out[i] = min(out[i], compute_area_clearance(query, scene, limits))
    return out
