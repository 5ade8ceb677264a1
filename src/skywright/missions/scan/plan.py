"""A scan: touch the pipe with the probe, slide along a pattern, and come back (Tognon 2018)."""

import math
import time
from typing import NamedTuple

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.errors import InputError
from skywright.missions.scan.task import Scan
from skywright.models.rigid_body import compute_body, joint_names, posture
from skywright.planning.patterns import SIDES, build_pattern
from skywright.planning.scan import compute_depth, plan_scan
from skywright.planning.via_points import ScanTask
from skywright.run.limits import find_exceeded_push
from skywright.run.planning import MissionPlan, refuse
from skywright.run.setup import Setup


class ScanWay(NamedTuple):
    """What a scan keeps of its plan."""

    depth_m: float  # of the desired tip inside the surface
    push_force_n: float  # that it makes
    path_sphi: Array  # (n, 2) s (m) and phi (rad) of the tip on the pipe


def plan(setup: Setup[Scan]) -> MissionPlan[ScanWay]:
    d, robot, world, scan = setup.description, setup.robot, setup.world, setup.task
    cylinder = setup.cylinder
    if cylinder is None:
        raise InputError(f"world {world.name!r} has no pipe to scan: give it a [world.pipe] table")
    if robot.arm is None or robot.probe is None:
        raise InputError(
            f"robot {robot.name!r} has no probe: a scan needs [robot.arm] and [robot.probe]"
        )
    model = setup.model
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
    query, scene, loads, hover = setup.clearance, setup.planning_scene, setup.loads, setup.hover
    began = time.perf_counter()
    if not loads.full:
        return refuse(
            f"robot {robot.name!r} cannot push sideways: "
            "its rotors make no independent lateral force",
            0.0,
        )
    found = plan_scan(
        model, loads, query, scene, cylinder, task, setup.limits, force, hover, hover,
        posture(robot, "folded"), posture(robot, "working"),
        build_stream(d.mission.seed, "planner"),
        tuple(joint_names(robot)), d.mission.planner_time_s,
    )  # fmt: skip
    spent = time.perf_counter() - began
    blocked = found.blocked_by or find_exceeded_push(setup, force)
    return MissionPlan(
        blocked is None, blocked, spent, found.duration_s, found.min_clearance_m,
        found.min_rotor_margin, found.segments, ScanWay(depth, force, found.path_sphi),
        found.traces,
    )  # fmt: skip
