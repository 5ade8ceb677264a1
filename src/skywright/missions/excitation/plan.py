"""An excitation flight: motions from which `skywright identify` estimates a robot's parameters."""

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.core.types import REFERENCE
from skywright.description.loader import Description
from skywright.missions.excitation.task import ExcitationTask
from skywright.models.geometry import (
    compute_clearance,
    compute_self_clearance,
)
from skywright.models.rigid_body import build_body_model, compute_tip, posture
from skywright.planning.excitation import (
    Excitation,
    plan_excitation,
    plan_joint_move,
    plan_joint_swing,
)
from skywright.run.planning import MissionPlan, refuse
from skywright.run.setup import Setup

ARM_SPEED = 0.8  # rad/s, between poses


def plan(setup: Setup[ExcitationTask]) -> MissionPlan[None]:
    d, robot, world = setup.description, setup.robot, setup.world
    task, loads = setup.task, setup.loads
    began = time.perf_counter()
    e = Excitation(
        task.duration_s, math.radians(task.tilt_deg), math.radians(task.yaw_deg),
        task.acceleration_mps2, task.low_hz, task.high_hz,
    )  # fmt: skip
    hover = setup.hover
    row = _rest(d, hover)
    segments: dict[str, NDArray[Any]] = {}
    margin, blocked = math.inf, ""
    for pose in task.poses if robot.arm is not None else ["folded"]:
        q = posture(robot, pose)
        move = plan_joint_move(robot, row, q, ARM_SPEED)
        if len(move) > 2:
            segments[f"arm {pose}"] = move
            row = move[-1]
        found = plan_excitation(robot, loads, e, hover, q, world.gravity_mps2)
        if found.rows is None:
            blocked = f"arm {pose}, {found.blocked_by}"
            break
        segments[f"excite {pose}"] = found.rows
        margin = min(margin, found.rotor_margin)
        if task.joint_deg > 0.0 and len(q):
            model = build_body_model(robot)[0]
            shorter = e._replace(duration=task.joint_duration_s)
            swing = plan_joint_swing(
                robot, row, math.radians(task.joint_deg), shorter,
                model["q_min"][: len(q)], model["q_max"][: len(q)],
            )  # fmt: skip
            segments[f"swing {pose}"] = swing
    if not blocked and robot.arm is not None:
        back = plan_joint_move(robot, row, posture(robot, "folded"), ARM_SPEED)
        if len(back) > 2:
            segments["arm home"] = back
    clearance = math.inf
    for name, table in segments.items() if not blocked else ():
        clearance, blocked = _check_clearance(
            setup, table, name, len(posture(robot, "folded")), clearance
        )
        if blocked:
            break
    spent = time.perf_counter() - began
    if blocked:
        return refuse(blocked, spent)
    duration = sum(float(table["t"][-1]) for table in segments.values())
    return MissionPlan(True, None, spent, duration, clearance, margin, segments)


def _rest(d: Description, hover: Array) -> Any:
    """Return the REFERENCE row of hover with the arm folded."""
    row = np.zeros(1, REFERENCE)[0]
    q = posture(d.robot, "folded")
    R = rot_z(float(hover[3]))
    tip, R_BT = compute_tip(build_body_model(d.robot), q)
    row["p_WB"], row["R_WB"], row["R_WS"], row["active"] = hover[:3], R, np.eye(3), 1.0
    row["q"][: len(q)] = q
    row["p_WT"], row["R_WT"] = hover[:3] + R @ tip, R @ R_BT
    return row


def _check_clearance(
    setup: Setup[ExcitationTask], table: NDArray[Any], name: str, n: int, least: float
) -> tuple[float, str]:
    """Return the smallest clearance so far, and which geometries are too close, or ""."""
    query, mission = setup.clearance, setup.description.mission
    keeps, apart = mission.clearance_m, mission.self_clearance_m
    for row in table[:: 25 if name.startswith("excite") else 10]:
        found = compute_clearance(query, row["p_WB"], row["R_WB"], row["q"][:n])
        least = min(least, found.distance)
        if found.distance < keeps:
            pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
            return least, (
                f"{name}: {pair} come within {max(found.distance, 0.0):.3f} m; required "
                f"clearance: {keeps:g} m (mission.clearance_m)"
            )
        own = compute_self_clearance(query, row["q"][:n])
        if own.distance < apart:
            pair = f"{query.names[own.robot_geom]} and {query.names[own.other_geom]}"
            return least, (
                f"{name}: {pair} come within {max(own.distance, 0.0):.3f} m; required clearance: "
                f"{apart:g} m (mission.self_clearance_m)"
            )
    return least, ""
