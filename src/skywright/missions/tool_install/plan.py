"""Install an inspection tool on a pipe and retrieve it (Suarez 2020, section VI-A), autonomously.

The twelve phases of the paper. A human operator performs the installation in the paper; here it is
done by tracking the tool. All poses follow from tool, bench, pipe and robot: the posture of the
arms from the landing gear, which the handle has to clear, and the platform's positions from the
tool's.
"""

import math
import time
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.description.loader import Description
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_limits
from skywright.description.world.spec import World
from skywright.description.world.surface import build_cylinder, level_axes
from skywright.description.world.things import locate_thing
from skywright.description.world.wind import compute_speed
from skywright.errors import InputError
from skywright.missions.skills.hook_grip import build_grip, check_hooks, compute_hooks_apart
from skywright.missions.skills.operated import load_operator
from skywright.missions.skills.tool_handling import (
    ACCELERATION,
    DROP,
    LIFT,
    LIGHT_N,
    Grip,
    Place,
    find_platform,
)
from skywright.missions.skills.tool_motion import BACK, behind
from skywright.missions.skills.tool_pose import find_marker
from skywright.missions.tool_install.motion import ABOVE, sum_moves
from skywright.missions.tool_install.task import ToolInstall
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.kinematic_tree import build_planning_scene
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.models.things._build import find_carried_clearance
from skywright.models.things.tool import Tool, compute_diameters, compute_seat
from skywright.planning.motion.transit import Configuration, plan_transit
from skywright.run.gust_limits import find_stances
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.vehicle.interface import build_limits

FAR_BACK = 0.45  # m, the same without the clearance, at the end of the planned path
ROOM = 1.2  # largest weight that is fed forward, relative to the payload limit
FELT = 3.0  # least weight of a tool, in LIGHT_N, the noise of its estimate
HAND_ROOM = 0.03  # m, from a hand's hook to handle's end and box
END_ROOM = 0.02  # m, from a foot's middle to the pipe's end: half its profile and the error
COMES = (0.0, 0.05, 0.1, 0.2, BACK)  # m, behind the tool, where the clearance in wind is checked
STEPS = 6  # bisection steps of the search for the largest wind
STEEPEST_DEG = 1.5  # largest inclination of the pipe: a suspended tool is level


class ToolPlan(NamedTuple):
    """Poses of things and robot as known before take-off."""

    grip: Grip
    folded: Array  # (n_joints,) rad
    bench: Place  # of the tool
    seat: Place
    home: Array  # (4,) m, rad
    to_bench: Array  # (n, 4) waypoints: m, rad
    to_pipe: Array
    most_n: float  # weight that may be lifted
    clear: float = math.inf  # m, to the tool before the grasp, in the expected wind


def plan(setup: Setup[ToolInstall]) -> MissionPlan[ToolPlan]:
    """Compute poses and paths; an infeasible request is refused with the reason."""
    d, robot, world = setup.description, setup.robot, setup.world
    began, task = time.perf_counter(), setup.task
    _check_input(robot, world, task)
    grip = build_grip(robot, world.find_thing(task.tool, Tool), world.gravity_mps2)
    bench, seat = find_places(world, task)
    hover, empty = setup.hover, np.zeros((0, 4))
    found = ToolPlan(
        grip, posture(robot, "folded"), bench, seat, hover, empty, empty,
        ROOM * task.payload_max_kg * world.gravity_mps2,
    )  # fmt: skip
    operator = load_operator(task)
    blocked = _find_misfit(robot, world, task) or _find_blocked_work(
        robot, world.drop_things(task.tool), found, task.near_clearance_m
    )
    least = math.inf
    if blocked is None:
        found = found._replace(clear=_measure_stances(setup, found)[0])
        blocked = _find_strong_wind(setup, found)
    if blocked is None:
        found, blocked, least = _plan_ways(d, found, task)
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began,
        math.nan if blocked else sum_moves(found, build_limits(robot).speed), least, way=found,
        operator=operator,
    )  # fmt: skip


def _plan_ways(
    d: Description, found: ToolPlan, task: ToolInstall
) -> tuple[ToolPlan, str | None, float]:
    """Plan the path to the bench with empty hands, and from there to the pipe with the tool.

    The planner models the robot only. With the tool its height has a lower limit, and the tool's
    own clearance is checked afterwards.
    """
    robot, world, grip, name = d.robot, d.world, found.grip, task.tool
    margin = task.way_clearance_m
    assert world.pipe is not None
    tool = world.find_thing(name, Tool)
    full, bare = build_scene(robot, world), build_scene(robot, world.drop_things(name))
    at_bench, at_pipe = find_platform(grip, found.bench), find_platform(grip, found.seat)
    rng = build_stream(d.mission.seed, "planner")
    stands = float(found.bench.p_WO[2]) - tool.foot_m
    top = max(world.pipe.z_m + 0.5 * world.pipe.diameter_m, stands)
    hangs = at_bench[2] - found.bench.p_WO[2] + tool.foot_m  # below the platform
    low = max(top + margin + hangs, at_bench[2] + LIFT, at_pipe[2] + ABOVE)
    ways = []
    least = math.inf
    for leg, scene, a, yaw_a, b, yaw_b, q, low_z in (
        ("to the bench", full, found.home[:3], float(found.home[3]),
         behind(at_bench, found.bench.yaw, FAR_BACK + margin), found.bench.yaw, grip.q_low, 0.0),
        ("to the pipe", bare, np.array([*at_bench[:2], low]), found.bench.yaw,
         np.array([*at_pipe[:2], low]), found.seat.yaw, grip.q, low),
    ):  # fmt: skip
        way = plan_transit(
            build_planning_scene(scene, robot, get_limits(world)), Configuration(a, yaw_a, q),
            Configuration(b, yaw_b, q), rng, margin, key="mission.task.way_clearance_m",
            margin_self=2.0 * d.mission.self_clearance_m, low_z=low_z,
        )  # fmt: skip
        if way.blocked_by is not None:
            return found, f"{leg}: {way.blocked_by}", math.nan
        least = min(least, way.clearance)
        ways.append(np.column_stack([way.p_WB, way.yaw]))
    found = found._replace(to_bench=ways[0], to_pipe=ways[1])
    carried = np.vstack([[*at_bench + [0.0, 0.0, LIFT], found.bench.yaw], ways[1],
                         [*at_pipe + [0.0, 0.0, ABOVE], found.seat.yaw]])  # fmt: skip
    hang = rot_z(-found.bench.yaw) @ (found.bench.p_WO - at_bench)
    distance, what = find_carried_clearance(full.model, name, carried, hang)
    if distance < task.carried_clearance_m:
        return found, (
            f"to the pipe: the carried tool and {what} come within {max(distance, 0.0):.3f} "
                f"m; required clearance: {task.carried_clearance_m:g} m "
                "(mission.task.carried_clearance_m)"
        ), least  # fmt: skip
    return found, None, min(least, distance)


def _check_input(robot: Robot, world: World, task: ToolInstall) -> None:
    """Raise InputError if robot or world do not suit this mission."""
    tool = world.find_thing(task.tool, Tool)
    if world.pipe is None:
        raise InputError(f"world {world.name!r} has no pipe: add a [world.pipe] table")
    find_marker(world, task.tool)
    if not world.pipe.tracked:
        raise InputError(
            f"world {world.name!r}: motion capture must track the pipe: [world.pipe] tracked = true"
        )
    check_hooks(robot, "tool-install")
    if abs(world.pipe.inclination_deg) > STEEPEST_DEG:
        raise InputError(
            f"world.pipe.inclination_deg = {world.pipe.inclination_deg:g}: a tool that "
            f"hangs from two hooks is level; valid: -{STEEPEST_DEG:g} to {STEEPEST_DEG:g}"
        )
    half = 0.5 * world.pipe.length_m - 0.5 * tool.feet_apart_m - END_ROOM
    if half < 0.0:
        raise InputError(
            f"world.pipe.length_m = {world.pipe.length_m:g}: too short for the tool's feet; valid: "
            f"from {tool.feet_apart_m + 2.0 * END_ROOM:g}"
        )
    if abs(task.along_pipe_m) > half:
        raise InputError(
            f"mission.task.along_pipe_m = {task.along_pipe_m:g}: the feet would be beyond "
            f"the end of the pipe; valid: -{half:g} to {half:g}"
        )


def _find_misfit(robot: Robot, world: World, task: ToolInstall) -> str | None:
    """Return why tool, pipe and arms do not fit each other, or None."""
    tool, pipe = world.find_thing(task.tool, Tool), world.pipe
    assert pipe is not None and robot.arm is not None
    if tool.mass_kg > task.payload_max_kg:
        return (
            f"the tool weighs {tool.mass_kg:g} kg, more than the payload limit "
            f"(mission.task.payload_max_kg = {task.payload_max_kg:g})"
        )
    lightest = FELT * LIGHT_N / world.gravity_mps2
    if tool.mass_kg < lightest:
        return (
            f"the tool weighs {tool.mass_kg:g} kg: below {lightest:.3f} kg the hands "
            "cannot measure whether it is carried or seated"
        )
    if not compute_seat(tool, pipe.diameter_m).fits:
        low, high = compute_diameters(tool)
        return (
            f"the tool's feet fit pipes of {low:.3f} to {high:.3f} m in diameter; the pipe has "
            f"{pipe.diameter_m:g} m"
        )
    apart, hook = compute_hooks_apart(robot), robot.arm.hand.radius_m + HAND_ROOM
    inner, outer = 0.5 * tool.box_y_m + hook, 0.5 * tool.handle_length_m - hook
    if not inner <= 0.5 * apart <= outer:
        return (
            f"the hands are {apart:g} m apart; the handle has room for {2.0 * inner:.3f} m "
            f"(box) to {2.0 * outer:.3f} m (ends)"
        )
    return None


def find_places(world: World, task: ToolInstall) -> tuple[Place, Place]:
    """Return the tool's initial place, and its goal on the pipe."""
    assert world.pipe is not None
    p, R = locate_thing(world.things, task.tool)
    pipe = build_cylinder(world.pipe)
    return Place(p, math.atan2(R[1, 0], R[0, 0])), find_seat(world, task, pipe.p_WP, pipe.R_WP)


def find_seat(world: World, task: ToolInstall, p_WP: Array, R_WP: Array) -> Place:
    """Return the tool's goal on a pipe whose frame is p_WP (3,) m, R_WP (3, 3)."""
    assert world.pipe is not None
    height = compute_seat(world.find_thing(task.tool, Tool), world.pipe.diameter_m).height
    ahead, axis, up = level_axes(R_WP).T
    p = p_WP + task.along_pipe_m * axis + height * up
    return Place(p, math.atan2(ahead[1], ahead[0]))


def _find_strong_wind(setup: Setup[ToolInstall], way: ToolPlan) -> str | None:
    """Return a refusal if wind tilts or moves the robot against the tool, or None."""
    wind, keeps = setup.world.wind, setup.task.wind_clearance_m
    if compute_speed(wind) == 0.0 or way.clear >= keeps:
        return None

    def judge(share: float) -> tuple[float, str]:
        air = wind.model_copy(update={
            "mean_mps": share * wind.mean_mps, "vertical_mps": share * wind.vertical_mps
        })  # fmt: skip
        world = setup.world.model_copy(update={"wind": air})
        return _measure_stances(Setup(setup.description._replace(world=world)), way)

    least, what = judge(1.0)
    low, high = 0.0, 1.0
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if judge(middle)[0] >= keeps else (low, middle)
    speed = compute_speed(wind)
    return (
        f"a {wind.kind} wind of {speed:g} m/s tilts and moves the robot (gusts and braking "
        f"included): before the hands hold the tool, {what} come within {max(least, 0.0):.3f} m; "
        f"required clearance: {keeps:g} m (mission.task.wind_clearance_m); largest wind: "
        f"{low * speed:.1f} m/s (world.wind.mean_mps)"
    )


def _measure_stances(setup: Setup[ToolInstall], way: ToolPlan) -> tuple[float, str]:
    """Return the least distance (m) on the approach to the tool, over all attitudes in the wind."""
    query = build_clearance(setup.scene)
    least, what = math.inf, ""
    at, bench = find_platform(way.grip, way.bench), rot_z(way.bench.yaw)
    for place in (way.bench, way.seat):  # the geometry is the same at both
        for R, shift in find_stances(setup, place.yaw, way.grip.q_low, ACCELERATION):
            here = bench @ rot_z(-place.yaw)
            for back in COMES:
                p = at + here @ shift - [0.0, 0.0, DROP] - back * bench[:, 0]
                found = compute_clearance(query, p, here @ R, way.grip.q_low)
                if found.distance < least:
                    least = found.distance
                    pair = query.names[found.robot_geom], query.names[found.other_geom]
                    what = f"{pair[0]} and {pair[1]}"
    return least, what


def _find_blocked_work(robot: Robot, world: World, way: ToolPlan, keeps: float) -> str | None:
    """Return what is too close to the robot where its hands work, or None.

    The world is without the tool, because the hands touch it.
    """
    query = build_clearance(build_scene(robot, world), with_ground=True)
    grip = way.grip
    for name, place in (("at the bench", way.bench), ("at the pipe", way.seat)):
        at, R = find_platform(grip, place), rot_z(place.yaw)
        low = at - [0.0, 0.0, DROP]
        for p, q in ((at, grip.q), (low, grip.q_low), (behind(at, place.yaw), grip.q_low)):
            found = compute_clearance(query, p, R, q)
            if found.distance < keeps:
                pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
                return (
                    f"{name}: {pair} come within {max(found.distance, 0.0):.3f} m; "
                    f"required clearance: {keeps:g} m (mission.task.near_clearance_m)"
                )
    return None
