"""A flight through way-points; any robot can fly it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.description.loader import Description
from skywright.description.world.surface import Cylinder, build_cylinder
from skywright.models.geometry import build_clearance
from skywright.models.kinematic_tree import build_planning_scene
from skywright.models.rigid_body import build_body_model, joint_names, posture
from skywright.models.scene import build_scene
from skywright.planning.waypoints import plan_waypoints
from skywright.run.flight import Flight
from skywright.run.planning import (
    MissionPlan,
    build_limits,
    build_mission_loads,
    find_hover,
)

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

NEEDS = frozenset({"uav"})


def plan(d: Description) -> MissionPlan:
    robot, world = d.robot, d.world
    model = build_body_model(robot, world.gravity_mps2)
    cylinder = (
        build_cylinder(world.pipe)
        if world.pipe is not None
        else Cylinder(np.array([0.0, 0.0, 1.0]), rot_z(0.0), 1.0, 1.0)
    )
    poses = np.array([[w.x_m, w.y_m, w.z_m, math.radians(w.yaw_deg)] for w in d.mission.waypoints])
    holds = np.array([w.hold_s for w in d.mission.waypoints])
    scene = build_scene(robot, world)
    found = plan_waypoints(
        model, build_mission_loads(robot, world), build_clearance(scene), cylinder,
        build_limits(robot), find_hover(d), poses, holds, posture(robot, "folded"),
        build_planning_scene(scene, robot), build_stream(d.mission.seed, "planner"),
        tuple(joint_names(robot)), "pendulum" if robot.pendulum is not None else None,
    )  # fmt: skip
    return MissionPlan(
        found.feasible, found.blocked_by, found.plan_s, found.duration_s, found.min_clearance_m,
        found.min_rotor_margin, found.segments, None, 0.0, 0.0,
    )  # fmt: skip


def fly(s: Supervisor) -> Flight:
    for i, (name, table) in enumerate(s.plan.segments.items()):
        s.follow(name, table)
        hold = s.mission.waypoints[i].hold_s if i < len(s.mission.waypoints) else 0.0
        if hold > 0.0:
            s.begin(f"hold {i + 1}")
            s.wait(hold)
    return Flight(True, "")
