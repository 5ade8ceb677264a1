"""An excitation flight: motions from which `skywright identify` learns a robot's parameters."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skywright.core.rotations import rot_z
from skywright.core.spec import NonNegative, Positive, Spec
from skywright.core.types import REFERENCE
from skywright.description.loader import Description
from skywright.description.mission.spec import Mission
from skywright.models.geometry import (
    ClearanceQuery,
    build_clearance,
    compute_clearance,
    compute_self_clearance,
)
from skywright.models.rigid_body import build_body_model, compute_tip, posture
from skywright.models.scene import build_scene
from skywright.planning.excitation import (
    RAMP,
    Excitation,
    count_lines,
    plan_excitation,
    plan_joint_move,
    plan_joint_swing,
)
from skywright.run.flight import Flight
from skywright.run.planning import MissionPlan, build_mission_loads, find_hover

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

NEEDS = frozenset({"uav"})

LINES = 3  # fewest sines that a channel needs
ARM_SPEED = 0.8  # rad/s, between poses
CLEAR = 0.05  # m, from anything in the world
CLEAR_SELF = 0.005  # m, of the arm from the propellers


class ExcitationTask(Spec):
    """What is moved, and how much; amplitudes are peaks and shrink where the rotors ask for it."""

    duration_s: float = Field(default=40.0, ge=4 * RAMP, le=600)  # of each pose
    poses: list[Literal["folded", "working"]] = Field(default=["folded"], min_length=1)
    tilt_deg: NonNegative = 4.0  # roll and pitch, where the rotors allow a free attitude
    yaw_deg: NonNegative = 12.0
    acceleration_mps2: NonNegative = 0.8
    low_hz: Positive = 0.15
    high_hz: float = Field(default=1.2, gt=0, le=5)
    joint_deg: NonNegative = 0.0  # swing of the arm's joints after each pose; 0: none
    joint_duration_s: float = Field(default=20.0, ge=4 * RAMP, le=600)

    @model_validator(mode="after")
    def _band_holds_lines(self) -> ExcitationTask:
        for name, channels in (("duration_s", 6), ("joint_duration_s", 2)):
            e = Excitation(getattr(self, name), 0, 0, 0, self.low_hz, self.high_hz)
            if count_lines(e, channels) < LINES:
                least = channels * LINES / max(self.high_hz - self.low_hz, 1e-9) + 2 * RAMP
                raise ValueError(
                    f"{name} = {getattr(self, name):g} with a band of {self.low_hz:g} to "
                    f"{self.high_hz:g} Hz gives too few frequencies to tell directions "
                    f"apart: about {least:.0f} s are needed, or a wider band"
                )
        return self


class ExcitationMission(Mission):
    """A mission of kind "excitation"."""

    task: ExcitationTask = ExcitationTask()


def plan(d: Description) -> MissionPlan:
    robot, world = d.robot, d.world
    assert isinstance(d.mission, ExcitationMission)
    task = d.mission.task
    loads = build_mission_loads(robot, world)
    query = build_clearance(build_scene(robot, world))
    began = time.perf_counter()
    e = Excitation(
        task.duration_s, math.radians(task.tilt_deg), math.radians(task.yaw_deg),
        task.acceleration_mps2, task.low_hz, task.high_hz,
    )  # fmt: skip
    hover = find_hover(d)
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
            query, table, name, len(posture(robot, "folded")), clearance
        )
        if blocked:
            break
    spent = time.perf_counter() - began
    if blocked:
        return MissionPlan(False, blocked, spent, math.nan, math.nan, math.nan, {}, None, 0.0, 0.0)
    duration = sum(float(table["t"][-1]) for table in segments.values())
    return MissionPlan(True, None, spent, duration, clearance, margin, segments, None, 0.0, 0.0)


def _rest(d: Description, hover: NDArray[np.float64]) -> Any:
    """Return the REFERENCE row of hovering with the arm folded."""
    row = np.zeros(1, REFERENCE)[0]
    q = posture(d.robot, "folded")
    R = rot_z(float(hover[3]))
    tip, R_BT = compute_tip(build_body_model(d.robot), q)
    row["p_WB"], row["R_WB"], row["R_WS"], row["active"] = hover[:3], R, np.eye(3), 1.0
    row["q"][: len(q)] = q
    row["p_WT"], row["R_WT"] = hover[:3] + R @ tip, R @ R_BT
    return row


def _check_clearance(
    query: ClearanceQuery, table: NDArray[Any], name: str, n: int, least: float
) -> tuple[float, str]:
    """Return the smallest clearance so far, and what comes too close ("" when nothing)."""
    for row in table[:: 25 if name.startswith("excite") else 10]:
        found = compute_clearance(query, row["p_WB"], row["R_WB"], row["q"][:n])
        least = min(least, found.distance)
        if found.distance < CLEAR:
            pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
            return least, f"{name}: {pair} come within {max(found.distance, 0.0):.3f} m < {CLEAR} m"
        own = compute_self_clearance(query, row["q"][:n])
        if own.distance < CLEAR_SELF:
            pair = f"{query.names[own.robot_geom]} and {query.names[own.other_geom]}"
            return least, f"{name}: {pair} come within {max(own.distance, 0.0):.3f} m of each other"
    return least, ""


def fly(s: Supervisor) -> Flight:
    for name, table in s.plan.segments.items():
        s.follow(name, table)
        s.begin(f"rest after {name}")
        s.wait(1.0)
    return Flight(True, "")
