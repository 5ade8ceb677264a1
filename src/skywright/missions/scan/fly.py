"""A scan: touch the pipe with the probe, slide along a pattern, and come back (Tognon 2018)."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.streams import build_stream
from skywright.description.loader import Description
from skywright.description.world.surface import build_cylinder
from skywright.errors import InputError
from skywright.missions.skills.tables import build_retreat, cut_table, lift_table, reverse_table
from skywright.models.geometry import build_clearance
from skywright.models.kinematic_tree import build_planning_scene
from skywright.models.rigid_body import build_body_model, compute_body, joint_names, posture
from skywright.models.scene import build_scene
from skywright.planning.patterns import SIDES, build_pattern
from skywright.planning.scan import compute_depth, plan_scan
from skywright.planning.via_points import ScanTask
from skywright.run.flight import Flight
from skywright.run.planning import (
    MissionPlan,
    build_limits,
    build_mission_loads,
    find_hover,
)
from skywright.vehicle.guard import CONTACT_LOST

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

Table = NDArray[Any]

NEEDS = frozenset({"uav", "whole_body", "probe"})

TRIM_ERROR = 0.003  # m, tip error at which the free-flight integral is called settled
TRIM_TIMES = (2.0, 12.0)  # s, least and most time for it
SETTLE = 4.0  # s in contact before sliding: the attitude integral takes up the push
LOST_PATIENCE = 0.5  # s without contact before the scan backs off


def plan(d: Description) -> MissionPlan:
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
    built = build_scene(robot, world)
    query, scene = build_clearance(built), build_planning_scene(built, robot)
    hover = find_hover(d)
    began = time.perf_counter()
    if not loads.full:
        blocked = (
            f"robot {robot.name!r} cannot push sideways: "
            "its rotors make no independent lateral force"
        )
        return MissionPlan(
            False, blocked, 0.0, math.nan, math.nan, math.nan, {}, None, depth, force
        )
    found = plan_scan(
        model, loads, query, scene, cylinder, task, build_limits(robot), force, hover, hover,
        posture(robot, "folded"), posture(robot, "working"),
        build_stream(d.mission.seed, "planner"),
        tuple(joint_names(robot)), d.mission.planner_time_s,
    )  # fmt: skip
    return MissionPlan(
        found.feasible, found.blocked_by, time.perf_counter() - began, found.duration_s,
        found.min_clearance_m, found.min_rotor_margin, found.segments, found, depth, force,
    )  # fmt: skip


def fly(s: Supervisor) -> Flight:
    segments = s.plan.segments
    assert s.mission.scan is not None
    for name in ("approach", "unfold", "close_in"):
        s.follow(name, segments[name])
    retries = s.mission.scan.retries
    table, done = segments["scan"], 0.0
    touch: Table = segments["touch"]
    away: Table | None = None  # from the present surface place back to the stand-off
    for attempt in range(retries + 1):
        _trim(s)
        if not _touch(s, touch):
            away = reverse_table(touch)
            s.follow("back_off", away)
            continue
        lost_at = _slide(s, cut_table(table, done) if done else table)
        if lost_at is None:
            for name in ("leave", "fold", "return"):
                s.follow(name, segments[name])
            return Flight(True, "")
        done += lost_at
        row = np.array(s.vehicle.reference)
        distance = float(np.linalg.norm(touch["p_WT"][0] - touch["p_WT"][-1]))
        s.follow("back_off", build_retreat(row, distance, 4.0))
        touch = build_retreat(row, distance, 8.0, back=True)
        if attempt == retries:
            break
    _go_home(s, done)
    where = f"after {done:.1f} s of the scan" if done else "at the first touch"
    return Flight(False, f"no lasting contact {where}, {retries} retries used")


def _touch(s: Supervisor, table: Table) -> bool:
    s.follow("touch", table)
    s.begin("settle")
    s.body.hold()
    s.wait(SETTLE)
    made = s.probe.in_contact()
    s.end("done" if made else "retry")
    return made


def _slide(s: Supervisor, table: Table) -> float | None:
    """Follow the scan; returns the time along `table` at which contact was lost for good."""
    s.begin("scan")
    s.body.track(table)
    start, out_since = s.vehicle.t, None
    while True:
        ticked = s.tick(CONTACT_LOST)
        if s.probe.in_contact():
            out_since = None
        elif out_since is None:
            out_since = ticked.t
        elif ticked.t - out_since > LOST_PATIENCE:
            s.end("retry")
            return out_since - start
        if ticked.arrived:
            s.end("done")
            return None


def _trim(s: Supervisor) -> None:
    """Let the integral settle at the stand-off, all directions, before touching."""
    s.begin("trim")
    s.body.hold()
    start = good_since = s.vehicle.t
    while True:
        t = s.tick().t
        error = s.vehicle.reference["p_WT"] - s.vehicle.estimate["p_WT"]
        if float(np.linalg.norm(error)) > TRIM_ERROR:
            good_since = t
        if (t - start > TRIM_TIMES[0] and t - good_since > 1.0) or t - start > TRIM_TIMES[1]:
            s.end("done")
            return


def _go_home(s: Supervisor, done: float) -> None:
    """Back along the planned way: over the scanned path at the stand-off, then the approach."""
    segments = s.plan.segments
    flown = segments["scan"][segments["scan"]["t"] <= done]
    touch = segments["touch"]
    lift = float(np.linalg.norm(touch["p_WT"][0] - touch["p_WT"][-1]))
    if done > 0.0 and len(flown) > 1:
        s.follow("retrace", reverse_table(lift_table(flown, lift), speed_up=4.0))
    for name in ("close_in", "unfold", "approach"):
        s.follow(f"reverse {name}", reverse_table(segments[name]))
