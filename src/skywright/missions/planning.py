"""From a description to a plan: scans and way-point flights."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.errors import InputError
from skywright.missions.limits import (
    compute_wind_allowance,
    find_exceeded_push,
    find_exceeded_wind,
)
from skywright.missions.loader import Description
from skywright.models.allocation import build_allocator
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.rigid_body import build_body_model, compute_body, joint_names, posture
from skywright.models.rotors import build_rotors
from skywright.models.scene import build_scene
from skywright.planning.inverse_dynamics import Loads, build_loads
from skywright.planning.patterns import SIDES, build_pattern
from skywright.planning.problem import Limits
from skywright.planning.scan import ScanPlan, compute_depth, plan_scan
from skywright.planning.via_points import ScanTask
from skywright.planning.waypoints import plan_waypoints
from skywright.robots.spec import Robot
from skywright.worlds.spec import World
from skywright.worlds.surface import Cylinder, build_cylinder

Array = NDArray[np.float64]

CLIMB_STEP = 0.05  # m, between clearance checks of take-off and landing
CLIMB_MARGIN = 0.1  # m, kept from everything on the way up and down


class MissionPlan(NamedTuple):
    """What a mission will fly, or why it cannot."""

    feasible: bool
    blocked_by: str | None
    plan_s: float
    duration_s: float
    min_clearance_m: float
    min_rotor_margin: float
    segments: dict[str, NDArray[Any]]  # REFERENCE rows, each segment's time from 0
    scan: ScanPlan | None
    depth_m: float  # of the desired tip inside the surface
    push_force_n: float

    def to_json(self) -> dict[str, Any]:
        """Return the keys of `skywright plan --json`; numbers that do not exist are null."""

        def number(x: float) -> float | None:
            return float(x) if math.isfinite(x) else None

        return {
            "feasible": self.feasible,
            "blocked_by": self.blocked_by,
            "plan_s": self.plan_s,
            "duration_s": number(self.duration_s),
            "min_clearance_m": number(self.min_clearance_m),
            "min_rotor_margin": number(self.min_rotor_margin),
        }


def plan_mission(description: Description) -> MissionPlan:
    """Plan the description's mission; an impossible one is told in `blocked_by`, not raised.

    Raises InputError when robot or world lack what the mission is about.
    """
    plan_it = _plan_scan_mission if description.mission.kind == "scan" else _plan_waypoint_mission
    plan = plan_it(description)
    if not plan.feasible and plan.plan_s > description.mission.planner_time_s:
        plan = plan_it(description)  # the first call in a process may have spent its time compiling
    if plan.feasible:
        blocked = _find_blocked_climb(description)
        if blocked is not None:
            plan = plan._replace(feasible=False, blocked_by=blocked)
    too_windy = find_exceeded_wind(description, plan.segments)
    if too_windy is None and description.mission.kind == "scan" and plan.feasible:
        too_windy = find_exceeded_push(description, plan.push_force_n)
    if too_windy is not None:
        return plan._replace(feasible=False, blocked_by=too_windy)
    return plan


def _find_blocked_climb(d: Description) -> str | None:
    """Say what stands in the way between the ground and the hover point, or return None."""
    robot, hover = d.robot, _hover(d)
    query = build_clearance(build_scene(robot, d.world), with_ground=False)
    folded, attitude = posture(robot, "folded"), rot_z(float(hover[3]))
    ground = robot.platform.gear_height_m
    for z in np.linspace(ground, hover[2], max(math.ceil((hover[2] - ground) / CLIMB_STEP), 1) + 1):
        at = np.array([hover[0], hover[1], z])
        found = compute_clearance(query, at, attitude, folded)
        if found.distance < CLIMB_MARGIN:
            pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
            return (
                f"take-off and landing at ({hover[0]:.2f}, {hover[1]:.2f}) m: {pair} come within "
                f"{max(found.distance, 0.0):.3f} m < {CLIMB_MARGIN:.2f} m at a height of {z:.2f} m"
            )
    return None


def build_mission_loads(robot: Robot, world: World) -> Loads:
    """Return rotors with the mission's thrust fraction, and the mean wind as an allowance."""
    rotors = build_rotors(robot.rotors)
    p = robot.platform
    return build_loads(
        build_allocator(rotors), rotors.position, rotors.axis, rotors.drag_coefficient,
        robot.rotors.thrust_fraction,
        np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2]),
        world.air_density_kg_m3, compute_wind_allowance(robot, world),
    )  # fmt: skip


def build_limits(robot: Robot) -> Limits:
    """Return the limits that a robot file sets."""
    c = robot.control
    return Limits(
        speed=c.speed_max_mps,
        acceleration=c.acceleration_max_mps2,
        tilt=math.radians(c.tilt_max_deg),
        ground=robot.platform.gear_height_m + 0.05,
    )


def _hover(description: Description) -> Array:
    m = description.mission
    return np.array([m.start_x_m, m.start_y_m, m.hover_height_m, math.radians(m.start_yaw_deg)])


def _plan_scan_mission(d: Description) -> MissionPlan:
    robot, world, scan = d.robot, d.world, d.mission.scan
    assert scan is not None
    if world.pipe is None:
        raise InputError(f"world {world.name!r} has no pipe to scan: give it a [world.pipe] table")
    if robot.arm is None or robot.probe is None:
        raise InputError(
            f"robot {robot.name!r} has no probe: a scan needs [robot.arm] and [robot.probe]"
        )
    model = build_body_model(robot, world.gravity_mps2)
    cylinder = build_cylinder(world.pipe)
    mass, _, _ = compute_body(model, posture(robot, "working"))
    stiffness = mass * robot.control.position_bandwidth_rad_s**2
    if scan.depth_m is None:
        force = robot.probe.force_n
        depth = compute_depth(mass, robot.control.position_bandwidth_rad_s, force)
    else:
        depth, force = scan.depth_m, scan.depth_m * stiffness
    centre = SIDES.get(scan.side, scan.centre_angle_deg)
    task = ScanTask(
        pattern=build_pattern(
            scan.pattern, cylinder.radius, cylinder.half_length, math.radians(centre),
            math.radians(scan.arc_deg), scan.passes, scan.pass_length_m, scan.centre_s_m,
            2.0 * robot.probe.tip_radius_m,
        ),
        speed=scan.speed_mps,
        depth=depth,
        dead_zone=1.5 * depth,
        stand_off=scan.stand_off_m,
    )  # fmt: skip
    loads = build_mission_loads(robot, world)
    query = build_clearance(build_scene(robot, world))
    hover = _hover(d)
    began = time.perf_counter()
    if not loads.full:
        blocked = (
            f"robot {robot.name!r} cannot push sideways: "
            "its rotors make no independent lateral force"
        )
        return MissionPlan(
            False, blocked, 0.0, math.nan, math.nan, math.nan, {}, None, depth, force
        )
    plan = plan_scan(
        model, loads, query, cylinder, task, build_limits(robot), force, hover, hover,
        posture(robot, "folded"), posture(robot, "working"),
        build_stream(d.mission.seed, "planner"),
        tuple(joint_names(robot)), d.mission.planner_time_s,
    )  # fmt: skip
    return MissionPlan(
        plan.feasible, plan.blocked_by, time.perf_counter() - began, plan.duration_s,
        plan.min_clearance_m, plan.min_rotor_margin, plan.segments, plan, depth, force,
    )  # fmt: skip


def _plan_waypoint_mission(d: Description) -> MissionPlan:
    robot, world = d.robot, d.world
    model = build_body_model(robot, world.gravity_mps2)
    cylinder = (
        build_cylinder(world.pipe)
        if world.pipe is not None
        else Cylinder(np.array([0.0, 0.0, 1.0]), rot_z(0.0), 1.0, 1.0)
    )
    poses = np.array([[w.x_m, w.y_m, w.z_m, math.radians(w.yaw_deg)] for w in d.mission.waypoints])
    holds = np.array([w.hold_s for w in d.mission.waypoints])
    plan = plan_waypoints(
        model, build_mission_loads(robot, world), build_clearance(build_scene(robot, world)),
        cylinder, build_limits(robot), _hover(d), poses, holds, posture(robot, "folded"),
        tuple(joint_names(robot)),
    )  # fmt: skip
    return MissionPlan(
        plan.feasible, plan.blocked_by, plan.plan_s, plan.duration_s, plan.min_clearance_m,
        plan.min_rotor_margin, plan.segments, None, 0.0, 0.0,
    )  # fmt: skip
