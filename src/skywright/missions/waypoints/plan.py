"""A flight through waypoints, with the arms folded."""

import math

import numpy as np

from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.description.world.surface import Cylinder
from skywright.missions.waypoints.task import Waypoints
from skywright.models.rigid_body import joint_names, posture
from skywright.planning.waypoints import plan_waypoints
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def plan(setup: Setup[Waypoints]) -> MissionPlan[None]:
    robot, points = setup.robot, setup.task.points
    # the planner requires a pipe; without one, any serves
    cylinder = setup.cylinder or Cylinder(np.array([0.0, 0.0, 1.0]), rot_z(0.0), 1.0, 1.0)
    poses = np.array([[w.x_m, w.y_m, w.z_m, math.radians(w.yaw_deg)] for w in points])
    rests = [w.hold_s + setup.task.settle_s if w.hold_s > 0.0 else 0.0 for w in points]
    found = plan_waypoints(
        setup.model, setup.loads, setup.clearance, cylinder, setup.limits, setup.hover, poses,
        np.array(rests), posture(robot, "folded"), setup.planning_scene,
        build_stream(setup.description.mission.seed, "planner"),
        tuple(joint_names(robot)), "pendulum" if robot.pendulum is not None else None,
    )  # fmt: skip
    return MissionPlan(
        found.feasible, found.blocked_by, found.plan_s, found.duration_s, found.min_clearance_m,
        found.min_rotor_margin, found.segments,
    )  # fmt: skip
