"""Put an inspection tool onto a pipe and take it back (Suarez 2020, section VI-A), on its own.

The paper's twelve phases; what the paper leaves to a human operator, the installation, is done by
tracking the tool. All places follow from tool, bench, pipe and robot: the pose of the arms from
the landing gear, which the handle has to clear, the platform's places from the tool's.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.description.loader import Description
from skywright.description.mission.spec import Plant
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.surface import build_cylinder
from skywright.description.world.things import locate_thing
from skywright.errors import InputError
from skywright.missions.skills.hook_grip import build_grip, check_hooks
from skywright.missions.skills.operated_install import install_by_operator
from skywright.missions.skills.tool_handling import (
    DROP,
    LIFT,
    LIGHT_N,
    LOW,
    NEAR_SPEED,
    STEADY_S,
    TILT_MAX,
    Grip,
    Place,
    find_marker,
    find_platform,
    find_tool,
    lead_hands,
    measure_tool,
    move_platform,
    put_down,
    take_up_again,
)
from skywright.missions.tool_install.task import ToolInstall, ToolInstallMission
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.kinematic_tree import build_planning_scene
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.models.things._build import find_carried_clearance
from skywright.models.things.tool import Tool, compute_diameters, compute_seat
from skywright.planning.motion.transit import Configuration, plan_transit
from skywright.run.flight import Flight
from skywright.run.operator import Recording, load_recording
from skywright.run.planning import MissionPlan, find_hover

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

Array = NDArray[np.float64]

NEEDS = frozenset({"uav", "hands"})
OPERATED = True  # the installation may be done by an operator at a stick

BACK = 0.35  # m, behind the tool, where the platform comes from and goes to
FAR_BACK = 0.55  # m, the same where the planned way ends: MARGIN from the tool, gear and all
ABOVE = 0.10  # m, of a tool over its place before it is lowered
MARGIN = 0.1  # m, kept on the way by the robot, and by the tool above bench and pipe
TOOL_MARGIN = 0.04  # m, kept by the carried tool from anything else
NEAR_MARGIN = 0.02  # m, kept while the hands work
WIDE = 0.1  # m, wanted on the way
CALM_SPEED, CARRY_ACCELERATION = 0.4, 0.2  # m/s, m/s^2, with the tool: it swings by a / g, 1.2 deg
HANDLING_S = 140.0  # s, about, of taking up, putting down, take-off and landing
ROOM = 1.2  # weight that is fed forward at most, over what may be lifted
FELT = 3.0  # times LIGHT_N, that a tool has to weigh: what is felt of it wavers by as much
HAND_ROOM = 0.03  # m, from a hand's hook to handle's end and box
END_ROOM = 0.02  # m, from a foot's middle to the pipe's end: half its profile, and the seat's error
STEEPEST_DEG = 1.5  # of the pipe: a hanging tool is level, and is judged as if the pipe were


class ToolPlan(NamedTuple):
    """Where things and robot will be, as known before take-off."""

    grip: Grip
    folded: Array  # (n_joints,) rad
    bench: Place  # of the tool
    seat: Place
    home: Array  # (4,) m, rad
    to_bench: Array  # (n, 4) way-points: m, rad
    to_pipe: Array
    most_n: float  # weight that may be lifted
    operator: Recording | None = None  # who puts the tool onto the pipe; None: the mission itself


def plan(d: Description) -> MissionPlan:
    """Find poses and ways; what cannot be is told."""
    robot, world, mission = d.robot, d.world, d.mission
    assert isinstance(mission, ToolInstallMission)
    began, task = time.perf_counter(), mission.task
    _check_input(robot, world, task)
    world = draw_map(world, d.plant, mission.seed)
    d = d._replace(world=world)
    grip = build_grip(robot, world.find_thing(task.tool, Tool), world.gravity_mps2)
    bench, seat = find_places(world, task)
    hover, empty = find_hover(d), np.zeros((0, 4))
    found = ToolPlan(
        grip, posture(robot, "folded"), bench, seat, hover, empty, empty,
        ROOM * task.payload_max_kg * world.gravity_mps2, _load_operator(task),
    )  # fmt: skip
    blocked = _find_misfit(robot, world, task) or _find_blocked_work(
        robot, world.drop_things(task.tool), found
    )
    least = math.inf
    if blocked is None:
        found, blocked, least = _plan_ways(d, found, task.tool)
    length = sum(
        float(np.sum(np.linalg.norm(np.diff(way[:, :3], axis=0), axis=1)))
        for way in (found.to_bench, found.to_pipe)
    )
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began,
        HANDLING_S + task.wait_s + task.hover_s + 2.0 * 1.875 * length / CALM_SPEED, least,
        math.nan, {}, None, 0.0, 0.0, found,
    )  # fmt: skip


def _load_operator(task: ToolInstall) -> Recording | None:
    """Read the operator's recording; it must have been made at the task's speed."""
    if task.operator is None:
        return None
    recording = load_recording(Path(task.operator))
    v_max = recording.v_max
    if v_max is not None and abs(v_max - task.stick_speed_mps) > 1e-9:
        raise InputError(
            f"{task.operator}: made at v_max_mps = {v_max:g}, mission.task.stick_speed_mps is "
            f"{task.stick_speed_mps:g}: the same input would end elsewhere; set it to {v_max:g}"
        )
    return recording


def _plan_ways(d: Description, found: ToolPlan, name: str) -> tuple[ToolPlan, str | None, float]:
    """Plan to the bench with empty hands, and from there to the pipe with the tool.

    The planner knows the robot; with the tool it may not go lower than the tool allows, and the
    tool's own distances are looked at afterwards.
    """
    robot, world, grip = d.robot, d.world, found.grip
    assert world.pipe is not None
    tool = world.find_thing(name, Tool)
    full, bare = build_scene(robot, world), build_scene(robot, world.drop_things(name))
    at_bench, at_pipe = find_platform(grip, found.bench), find_platform(grip, found.seat)
    rng = build_stream(d.mission.seed, "planner")
    stands = float(found.bench.p_WO[2]) - tool.foot_m
    top = max(world.pipe.z_m + 0.5 * world.pipe.diameter_m, stands)
    hangs = at_bench[2] - found.bench.p_WO[2] + tool.foot_m  # below the platform
    low = max(top + MARGIN + hangs, at_bench[2] + LIFT, at_pipe[2] + ABOVE)
    ways = []
    least = math.inf
    for leg, scene, a, yaw_a, b, yaw_b, q, low_z in (
        ("to the bench", full, found.home[:3], float(found.home[3]),
         _behind(at_bench, found.bench.yaw, FAR_BACK), found.bench.yaw, grip.q_low, 0.0),
        ("to the pipe", bare, np.array([*at_bench[:2], low]), found.bench.yaw,
         np.array([*at_pipe[:2], low]), found.seat.yaw, grip.q, low),
    ):  # fmt: skip
        way = plan_transit(
            build_planning_scene(scene, robot), Configuration(a, yaw_a, q),
            Configuration(b, yaw_b, q), rng, MARGIN, wanted=WIDE, low_z=low_z,
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
    if distance < TOOL_MARGIN:
        return found, (
            f"to the pipe: the carried tool and {what} come within {max(distance, 0.0):.3f} m, "
            f"{TOOL_MARGIN:.2f} m are kept"
        ), least  # fmt: skip
    return found, None, min(least, distance)


def _check_input(robot: Robot, world: World, task: ToolInstall) -> None:
    """Raise InputError where robot or world are not those of this mission."""
    tool = world.find_thing(task.tool, Tool)
    if world.pipe is None:
        raise InputError(f"world {world.name!r} has no pipe: give it a [world.pipe] table")
    find_marker(world, task.tool)
    if not world.pipe.tracked:
        raise InputError(
            f"world {world.name!r}: where the tool goes is measured: [world.pipe] tracked = true"
        )
    check_hooks(robot, "tool-install")
    if abs(world.pipe.inclination_deg) > STEEPEST_DEG:
        raise InputError(
            f"world.pipe.inclination_deg = {world.pipe.inclination_deg:g}: a tool that hangs in "
            f"two hooks is level; valid: -{STEEPEST_DEG:g} to {STEEPEST_DEG:g}"
        )
    half = 0.5 * world.pipe.length_m - 0.5 * tool.feet_apart_m - END_ROOM
    if half < 0.0:
        raise InputError(
            f"world.pipe.length_m = {world.pipe.length_m:g}: too short for the tool's feet; valid: "
            f"from {tool.feet_apart_m + 2.0 * END_ROOM:g}"
        )
    if abs(task.along_pipe_m) > half:
        raise InputError(
            f"mission.task.along_pipe_m = {task.along_pipe_m:g}: the feet would stand beyond the "
            f"pipe's end; valid: -{half:g} to {half:g}"
        )


def _find_misfit(robot: Robot, world: World, task: ToolInstall) -> str | None:
    """Say why tool, pipe and arms do not go together, or return None."""
    tool, pipe = world.find_thing(task.tool, Tool), world.pipe
    assert pipe is not None and robot.arm is not None
    if tool.mass_kg > task.payload_max_kg:
        return (
            f"the tool weighs {tool.mass_kg:g} kg, more than the arms may lift "
            f"(mission.task.payload_max_kg = {task.payload_max_kg:g})"
        )
    lightest = FELT * LIGHT_N / world.gravity_mps2
    if tool.mass_kg < lightest:
        return (
            f"the tool weighs {tool.mass_kg:g} kg: below {lightest:.3f} kg the hands do not feel "
            "whether it hangs or stands"
        )
    if not compute_seat(tool, pipe.diameter_m).fits:
        low, high = compute_diameters(tool)
        return (
            f"the tool's feet fit pipes of {low:.3f} to {high:.3f} m in diameter; the pipe has "
            f"{pipe.diameter_m:g} m"
        )
    apart, hook = robot.arm.separation_m, robot.arm.hand.radius_m + HAND_ROOM
    inner, outer = 0.5 * tool.box_y_m + hook, 0.5 * tool.handle_length_m - hook
    if not inner <= 0.5 * apart <= outer:
        return (
            f"the hands are {apart:g} m apart; they find room on the handle between "
            f"{2.0 * inner:.3f} m (box) and {2.0 * outer:.3f} m (ends)"
        )
    return None


def find_places(world: World, task: ToolInstall) -> tuple[Place, Place]:
    """Return where the tool stands at first, and where it shall stand on the pipe."""
    assert world.pipe is not None
    p, R = locate_thing(world.things, task.tool)
    pipe = build_cylinder(world.pipe)
    return Place(p, math.atan2(R[1, 0], R[0, 0])), find_seat(world, task, pipe.p_WP, pipe.R_WP)


def find_seat(world: World, task: ToolInstall, p_WP: Array, R_WP: Array) -> Place:
    """Return where the tool shall stand on a pipe whose frame is p_WP (3,) m, R_WP (3, 3)."""
    assert world.pipe is not None
    height = compute_seat(world.find_thing(task.tool, Tool), world.pipe.diameter_m).height
    p = p_WP + task.along_pipe_m * R_WP[:, 1] + height * R_WP[:, 2]
    return Place(p, math.atan2(R_WP[1, 0], R_WP[0, 0]))


def draw_map(world: World, plant: Plant, seed: int) -> World:
    """Return the world as the planner's map has it: the pipe up to `plant.map_error` off."""
    assert world.pipe is not None
    off, turn = np.split(build_stream(seed, "map").uniform(-1.0, 1.0, 4), [3])
    x, y, z = plant.map_error_m * off
    pipe = world.pipe
    moved = pipe.model_copy(update={
        "x_m": pipe.x_m + float(x), "y_m": pipe.y_m + float(y), "z_m": pipe.z_m + float(z),
        "yaw_deg": pipe.yaw_deg + plant.map_error_deg * float(turn[0]),
    })  # fmt: skip
    return world.model_copy(update={"pipe": moved})


def _behind(p: Array, yaw: float, back: float = BACK) -> Array:
    """Where the platform comes from and goes to, p (3,) m being where its hands hold the tool."""
    return np.asarray(p - back * rot_z(yaw)[:, 0] - [0.0, 0.0, DROP])


def _find_blocked_work(robot: Robot, world: World, way: ToolPlan) -> str | None:
    """Say what is in the way of the robot where its hands work, or return None.

    The world is without the tool: it is what the hands touch.
    """
    query = build_clearance(build_scene(robot, world), with_ground=True)
    grip = way.grip
    for name, place in (("at the bench", way.bench), ("at the pipe", way.seat)):
        at, R = find_platform(grip, place), rot_z(place.yaw)
        low = at - [0.0, 0.0, DROP]
        for p, q in ((at, grip.q), (low, grip.q_low), (_behind(at, place.yaw), grip.q_low)):
            found = compute_clearance(query, p, R, q)
            if found.distance < NEAR_MARGIN:
                pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
                return (
                    f"{name}: {pair} come within {max(found.distance, 0.0):.3f} m, "
                    f"{NEAR_MARGIN:.2f} m are kept"
                )
    return None


def fly(s: Supervisor) -> Flight:
    """Fly the phases between take-off and landing."""
    assert isinstance(s.mission, ToolInstallMission)
    task, way = s.mission.task, s.plan.task
    assert isinstance(way, ToolPlan)
    speeds = (task.hand_speed_mps, task.lift_speed_mps)
    s.begin("approach bench")
    s.arms.move_to(way.grip.q_low)
    s.until_arrived()
    _follow(s, way.to_bench, s.vehicle.limits.speed)
    place = find_tool(s)
    if _is_elsewhere(s, place, way.bench):
        _go_home(s, way)
        return Flight(False, "the tool does not stand where the plan has it")
    _come(s, way.grip, place)
    if task.hover_s > 0.0:
        s.begin("hover check")
        s.wait(task.hover_s)
    weight = take_up_again(s, way.grip, way.most_n, task.retries, speeds)
    if weight is None:
        s.begin("return")
        _leave(s, way, place)
        _go_home(s, way)
        return Flight(False, "the tool could not be grasped")
    s.begin("carry")
    _follow(s, way.to_pipe, CALM_SPEED)
    s.begin("approach pipe")
    seat = _measure_seat(s, task)
    move_platform(s, find_platform(way.grip, seat) + [0.0, 0.0, ABOVE], seat.yaw, NEAR_SPEED)
    if not _is_held(s, way.grip):
        _go_home(s, way, from_pipe=True)
        return Flight(False, "the tool was lost on the way to the pipe")
    operator = s.operator or way.operator
    seat = _measure_seat(s, task)
    if operator is not None:
        reason = install_by_operator(
            s, operator, way.grip, seat, weight, task.stick_speed_mps, speeds
        )
    else:
        stands = put_down(s, way.grip, seat, weight, speeds, "install")
        reason = "" if stands else "nothing took the tool's weight where the pipe was seen"
    if reason:
        return Flight(False, f"{reason}; {_give_up(s, way, place, weight, speeds)}")
    s.begin("wait")
    _leave(s, way, seat)
    s.wait(task.wait_s)
    s.begin("retrieve")
    found = find_tool(s)
    if _is_elsewhere(s, found, seat):
        _go_home(s, way, from_pipe=True)
        return Flight(False, "the tool does not stand on the pipe any more")
    _come(s, way.grip, found)
    weight = take_up_again(s, way.grip, way.most_n, task.retries, speeds)
    if weight is None:
        s.begin("return")
        _leave(s, way, seat)
        _go_home(s, way, from_pipe=True)
        return Flight(False, "the tool could not be taken back: it stays on the pipe")
    returned = _carry_back(s, way, place, weight, speeds)
    return Flight(returned, "" if returned else "the tool was lost on the way back")


def _carry_back(
    s: Supervisor, way: ToolPlan, place: Place, weight: float, speeds: tuple[float, float]
) -> bool:
    """Bring the tool back to `place` on the bench, fly home; returns whether it was not lost."""
    s.begin("carry back")
    move_platform(s, way.to_pipe[-1, :3], way.seat.yaw, NEAR_SPEED)
    _follow(s, way.to_pipe[::-1], CALM_SPEED)
    s.begin("back to the bench")
    move_platform(s, find_platform(way.grip, place) + [0.0, 0.0, ABOVE], place.yaw, NEAR_SPEED)
    held = _is_held(s, way.grip)
    if held:
        put_down(s, way.grip, place, weight, speeds, "lower")
        s.begin("return")
    _leave(s, way, place)
    _go_home(s, way)
    return held


def _give_up(
    s: Supervisor, way: ToolPlan, place: Place, weight: float, speeds: tuple[float, float]
) -> str:
    """After an installation that failed: bring the tool back if it hangs on the hooks, fly home.

    `place` is the bench's. Returns what became of the tool.
    """
    if _is_held(s, way.grip):
        returned = _carry_back(s, way, place, weight, speeds)
        return "it was carried back to the bench" if returned else "it was lost on the way back"
    s.begin("return")
    _leave(s, way, way.seat)
    _go_home(s, way, from_pipe=True)
    return "it stays where it is"


def _measure_seat(s: Supervisor, task: ToolInstall) -> Place:
    """Where the tool shall stand, on the pipe as motion capture sees it."""
    arms = s.vehicle.hands
    return find_seat(s.vehicle.world, task, np.array(arms["p_WP"]), np.array(arms["R_WP"]))


def _come(s: Supervisor, grip: Grip, place: Place) -> None:
    """Come up to a tool that stands at `place`, hands low; then they wait below its handle."""
    p = find_platform(grip, place)
    move_platform(s, _behind(p, place.yaw), place.yaw, NEAR_SPEED)
    move_platform(s, p - [0.0, 0.0, DROP], place.yaw, NEAR_SPEED)
    lead_hands(s, grip, -LOW, 0.05)
    s.wait(STEADY_S)


def _leave(s: Supervisor, way: ToolPlan, place: Place) -> None:
    """Draw back from a tool that stands, hands low."""
    s.arms.move_to(way.grip.q_low)
    s.until_arrived()
    here = s.vehicle.reference["p_WB"] + [0.0, 0.0, DROP]  # where the hands would hold
    move_platform(s, _behind(here, place.yaw), place.yaw, NEAR_SPEED)


def _is_elsewhere(s: Supervisor, place: Place, wanted: Place) -> bool:
    """Whether the tool has fallen, or stands too far from where the way was looked at."""
    far = float(np.linalg.norm(place.p_WO - wanted.p_WO)) > MARGIN
    return far or measure_tool(s)[1][2, 2] < math.cos(TILT_MAX)


def _is_held(s: Supervisor, grip: Grip) -> bool:
    """Whether the tool hangs where the hands are."""
    p, R = measure_tool(s)
    middle = np.mean(s.vehicle.hands["p_WH"][:2], axis=0)
    return float(np.linalg.norm(p + R @ grip.handle - middle)) < LOW


def _follow(s: Supervisor, points: Array, speed: float) -> None:
    """Fly along way-points (n, 4) m, rad, at rest in each."""
    for point in points:
        here = s.vehicle.reference["p_WB"]
        if float(np.linalg.norm(point[:3] - here)) > 1e-3:
            move_platform(s, point[:3], float(point[3]), speed, CARRY_ACCELERATION)


def _go_home(s: Supervisor, way: ToolPlan, from_pipe: bool = False) -> None:
    """Fly back over the take-off place and lift the arms above the landing gear."""
    if from_pipe:
        here = s.vehicle.reference["p_WB"]
        high = np.array([here[0], here[1], way.to_pipe[-1, 2]])
        move_platform(s, high, way.seat.yaw, NEAR_SPEED)
        _follow(s, way.to_pipe[::-1], CALM_SPEED)
        back = _behind(way.to_pipe[0, :3], way.bench.yaw)
        move_platform(s, back, way.bench.yaw, CALM_SPEED)
    _follow(s, way.to_bench[::-1], s.vehicle.limits.speed)
    s.begin("lift arms")
    s.arms.move_to(way.folded)
    s.until_arrived()
