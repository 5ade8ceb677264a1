"""A scan: touch the pipe with the probe, slide along a pattern, and return (Tognon 2018)."""

import math
import time
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.description.world.surface import Cylinder, surface_frame
from skywright.errors import InputError
from skywright.missions.scan.task import Scan
from skywright.missions.skills.datum import explain_view, get_datum
from skywright.missions.skills.survey import FELT_N
from skywright.missions.skills.surveyed import (
    CLEAR,
    compute_aside,
    compute_reach,
    get_map_error,
    is_surveyed,
    move_pipe,
)
from skywright.models.rigid_body import compute_body, joint_names, posture
from skywright.planning.inverse_kinematics import State, build_state
from skywright.planning.patterns import Pattern, build_pattern
from skywright.planning.scan import ScanPlan, compute_depth, plan_scan
from skywright.planning.survey import SurveyTask, choose_points
from skywright.planning.via_points import ScanTask
from skywright.run.limits import find_exceeded_push
from skywright.run.planning import MissionPlan, refuse
from skywright.run.setup import Setup

PRESS = 2.0
"""Depth of a touch inside the surface, relative to the depth that causes FELT_N."""


DEEP = 0.1
"""m, of the desired tip inside the surface, from which this depth may be the cause of a failed
plan: arms that scan have about 0.3 m between platform and tip."""

SHALLOW = 0.02
"""m, depth at which a failed plan is repeated, to distinguish an arm that does not fit from a
depth."""


class SurveyWay(NamedTuple):
    """Survey part of a scan's plan."""

    setup: Setup[Scan]  # to plan again with, once the pipe is known
    points: Array  # (n, 2) s (m) and phi (rad) on the map
    frames: list[Array]  # (3, 3) each: of the map's surface there, z outward
    travels: Array  # (n,) m, largest travel of a touch from its stand-off
    sensed: bool  # whether the probe has a force sensor
    stand_off_m: float  # of the tip before a touch
    mark: Array | None = None  # (2,) s and phi of the datum, which is measured first


class ScanWay(NamedTuple):
    """Parts of a scan's plan that the flight and the evaluation use."""

    depth_m: float  # of the desired tip inside the surface
    push_force_n: float  # force at that depth
    path_sphi: Array  # (n, 2) s (m) and phi (rad) of the tip on the pipe, with detours
    corners_sphi: Array  # (k, 2) corners of the requested pattern, likewise
    survey: SurveyWay | None = None


def plan(setup: Setup[Scan]) -> MissionPlan[ScanWay]:
    """Plan according to the map."""
    robot, world, cylinder = setup.robot, setup.world, setup.cylinder
    if cylinder is None:
        raise InputError(f"world {world.name!r} has no pipe to scan: add a [world.pipe] table")
    if robot.arm is None or robot.probe is None:
        raise InputError(
            f"robot {robot.name!r} has no probe: a scan requires [robot.arm] and [robot.probe]"
        )
    if is_surveyed(setup) and not world.tracks_markers:
        raise InputError(
            "mission.task.survey requires motion capture of the probe; world.localisation "
            f"is {world.localisation!r}: set mission.task.survey=false"
        )
    return _plan_on(setup, cylinder, None)


def plan_found(
    setup: Setup[Scan], found: Cylinder, row: Any, pattern: Pattern | None = None
) -> MissionPlan[ScanWay]:
    """Plan again with the surveyed pipe, from the present row of REFERENCE.

    `pattern` is by default that of the task.
    """
    pipe = setup.world.pipe
    assert pipe is not None
    world = setup.world.model_copy(update={"pipe": move_pipe(pipe, found)})
    n = int(setup.model[0]["n_joints"])
    begin = build_state(row["p_WB"], row["R_WB"], row["q"][:n])
    return _plan_on(Setup(setup.description._replace(world=world)), found, begin, pattern)


def _explain_depth(setup: Setup[Scan], depth: float, stiffness: float, blocked: str) -> str:
    """Return a message that the depth (m) of the press causes `blocked`, and the keys to change."""
    if setup.task.depth_m is not None:
        return (
            f"mission.task.depth_m = {depth:g} m is too large, a push of "
            f"{depth * stiffness:.3g} N at {stiffness:.3g} N/m: {blocked}; lower "
            "mission.task.depth_m"
        )
    w = setup.robot.control.position_bandwidth_rad_s
    return (
        f"the press is too deep: {depth * stiffness:.3g} N at {stiffness:.3g} N/m (mass times "
        f"robot.control.position_bandwidth_rad_s = {w:g} rad/s squared) require the desired tip "
        f"{1e3 * depth:.0f} mm inside the surface, where {blocked}; with {1e3 * SHALLOW:.0f} mm "
        "the scan is possible: raise robot.control.position_bandwidth_rad_s, lower "
        "mission.task.force_n or set mission.task.depth_m"
    )


def build_frame(cylinder: Cylinder, phi: float) -> Array:
    """Return R_WS (3, 3) at the angle `phi` (rad)."""
    R = np.empty((3, 3))
    surface_frame(cylinder, phi, R)
    return R


def _plan_on(
    setup: Setup[Scan], cylinder: Cylinder, begin: State | None, pattern: Pattern | None = None
) -> MissionPlan[ScanWay]:
    """Plan on a surface, from the start (with the survey, if required), or from `begin`."""
    d, robot, scan = setup.description, setup.robot, setup.task
    assert robot.probe is not None
    model = setup.model
    mass, _, _ = compute_body(model, posture(robot, "working"))
    stiffness = mass * robot.control.position_bandwidth_rad_s**2
    if scan.depth_m is None:
        force = robot.probe.force_n if scan.force_n is None else scan.force_n
        depth = compute_depth(mass, robot.control.position_bandwidth_rad_s, force)
    else:
        depth, force = scan.depth_m, scan.depth_m * stiffness
    pattern = pattern or build_pattern(
        scan.pattern, cylinder.radius, cylinder.half_length, scan.get_centre(),
        math.radians(scan.arc_deg), scan.passes, scan.pass_length_m, scan.centre_s_m,
        scan.get_least_pitch(robot),
    )  # fmt: skip
    way, stand_off, survey = None, scan.stand_off_m, None
    if is_surveyed(setup) and begin is None and pattern.blocked_by is None:
        points, datum, error = (
            choose_points(pattern.corners),
            get_datum(setup),
            get_map_error(setup),
        )
        mark = None if datum is None else np.array(datum.get_place())
        stops = points if mark is None else np.vstack([mark, points])
        reach = np.array([compute_reach(cylinder, error, x) for x in stops])
        stand_off = max(stand_off, float(np.max(reach)) + CLEAR)
        press = PRESS * FELT_N / stiffness
        beyond = reach + press
        survey = SurveyTask(stops, float(np.max(beyond)), press)
        frames = [build_frame(cylinder, float(x[1])) for x in points]
        way = SurveyWay(
            setup, points, frames, stand_off + beyond[-len(points) :],
            robot.force_sensor is not None, stand_off, mark,
        )  # fmt: skip
        if mark is not None:
            hidden = explain_view(
                setup, stand_off, float(reach[0]), compute_aside(cylinder, error, mark)
            )
            if hidden:
                return refuse(hidden, 0.0)
    query, scene, loads, hover = setup.clearance, setup.planning_scene, setup.loads, setup.hover
    began = time.perf_counter()
    if not loads.full:
        return refuse(
            f"robot {robot.name!r} cannot push sideways: its rotors produce no independent "
            "lateral force",
            0.0,
        )

    def attempt(depth: float, survey: SurveyTask | None, force: float) -> ScanPlan:
        task = ScanTask(pattern, scan.speed_mps, depth, 1.5 * depth, stand_off)
        return plan_scan(
            model, loads, query, scene, cylinder, task, setup.limits, force, hover, hover,
            posture(robot, "folded"), posture(robot, "working"),
            build_stream(d.mission.seed, "planner"),
            tuple(joint_names(robot)), d.mission.planner_time_s, survey, begin,
        )  # fmt: skip

    found = attempt(depth, survey, force)
    blocked = found.blocked_by
    if blocked and way is not None and way.mark is not None and survey is not None:
        alone = survey._replace(points=way.points)
        if attempt(depth, alone, force).blocked_by is None:
            blocked = (
                f"the robot cannot look at the datum at s = {way.mark[0]:g} m, phi = "
                f"{math.degrees(way.mark[1]):.0f} deg: {blocked}; move the mark nearer to the "
                "sector, or set mission.task.datum=false"
            )
    if blocked and depth >= DEEP:
        through = scan.depth_m is not None and depth >= cylinder.radius  # no arm can reach it
        light = force if scan.depth_m is None else SHALLOW * stiffness
        anyhow = None if through else attempt(SHALLOW, None, light).blocked_by
        blocked = (
            f"{anyhow}, also with the desired tip {1e3 * SHALLOW:.0f} mm inside the surface "
            f"instead of {1e3 * depth:.0f} mm"
            if anyhow
            else _explain_depth(setup, depth, stiffness, blocked)
        )
    spent = time.perf_counter() - began
    blocked = blocked or find_exceeded_push(setup, force, found.segments["scan"])
    return MissionPlan(
        blocked is None, blocked, spent, found.duration_s, found.min_clearance_m,
        found.min_rotor_margin, found.segments,
        ScanWay(depth, force, found.path_sphi, pattern.corners, way), found.traces,
    )  # fmt: skip
