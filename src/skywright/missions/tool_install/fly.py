"""Install an inspection tool on a pipe and retrieve it (Suarez 2020, section VI-A), autonomously.

The twelve phases of the paper. A human operator performs the installation in the paper; without an
operator, it is done here by tracking the tool. All poses follow from tool, bench, pipe and robot:
the posture of the arms from the landing gear, which the handle has to clear, and the platform's
positions from the tool's.
"""

import math
from collections.abc import Callable

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.missions.skills.operated import Lead
from skywright.missions.skills.tool_handling import (
    DROP,
    LOW,
    NEAR_SPEED,
    STEADY_S,
    TILT_MAX,
    Grip,
    Place,
    compute_miss,
    find_platform,
    find_tool,
    lead_hands,
    move_platform,
    put_down,
    take_up_again,
)
from skywright.missions.skills.tool_motion import behind
from skywright.missions.skills.tool_pose import measure_tool
from skywright.missions.tool_install.motion import ABOVE, CALM_SPEED, CARRY_ACCELERATION
from skywright.missions.tool_install.operated_install import install_by_operator
from skywright.missions.tool_install.operated_retrieval import HAND_OVER, retrieve_by_operator
from skywright.missions.tool_install.plan import ToolPlan, find_seat
from skywright.missions.tool_install.task import ToolInstall
from skywright.models.geometry import compute_clearance
from skywright.run.faults._response import back_off
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms.ports import Hands
from skywright.vehicle.targets import PIPE

BACKS_OFF = 0.45
"""m/s^2, after a fault: a lean of 2.6 deg, which raises hands 0.45 m ahead of the robot by 2 cm.
The arms are 3.6 cm below the handle."""

UNPLANNED = 0.008
"""m, by which a robot may come nearer to the tool than planned: the arm's length has an error of 4
mm, and 20 % more drag leans the robot by as much (plant)."""

BECAME = {
    True: "it was carried back to the bench",
    False: "it was lost on the way back, or could not be put down",
}
"""Outcome for a tool that the operator did not install."""


def fly(s: Supervisor[ToolInstall], way: ToolPlan) -> Flight:
    """Fly the phases between take-off and landing."""
    task = s.task
    speeds = (task.hand_speed_mps, task.lift_speed_mps)
    s.begin("approach bench")
    s.arms.move_to(way.grip.q_low)
    s.until_arrived()
    _follow(s, way.to_bench, s.vehicle.limits.speed)
    place = find_tool(s)
    if _is_elsewhere(s, place, way.bench):
        _go_home(s, way)
        return Flight(False, "the tool is not at its planned position")
    _come(s, way, place)
    if task.hover_s > 0.0:
        s.begin("hover check")
        s.hold(task.hover_s)
    s.senses.room = None
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
    seat = _measure_seat(s, task)
    lead = None if s.operator is None else Lead(s, s.operator)
    if lead is not None:
        reason = install_by_operator(s, lead, way.grip, seat, weight, speeds)
    else:
        reason = put_down(s, way.grip, seat, weight, speeds, "install")
    if reason:
        return Flight(False, f"{reason}; {_give_up(s, way, place, weight, speeds)}")
    s.begin("wait")
    _leave(s, way, seat)
    s.hold(task.wait_s)
    s.begin("retrieve")
    found = find_tool(s)
    if _is_elsewhere(s, found, seat):
        _go_home(s, way, from_pipe=True)
        return Flight(False, "the tool is no longer on the pipe")
    by_hand = lead is not None and task.retrieve_by_hand
    _come(s, way, found, HAND_OVER if by_hand else None)
    s.senses.room = None
    if lead is not None and by_hand:
        weight, reason = retrieve_by_operator(s, lead, way.grip, found, weight, speeds)
    else:
        weight = take_up_again(s, way.grip, way.most_n, task.retries, speeds)
    if weight is None:
        s.begin("return")
        _leave(s, way, seat)
        _go_home(s, way, from_pipe=True)
        return Flight(False, f"{reason or 'the tool could not be retrieved'}: it stays on the pipe")
    returned = _carry_back(s, way, place, weight, speeds)
    if reason:
        return Flight(False, f"{reason}; {BECAME[returned]}")
    return Flight(returned, "" if returned else f"the tool: {BECAME[False]}")


def withdraw(s: Supervisor[ToolInstall], way: ToolPlan) -> None:
    """Draw the hooks down out of a handle and back off; a suspended load stays on the hooks.

    Hands that wait below the handle keep their posture while the platform backs off, in reverse of
    the approach: arms that moved beside the tool would hit it.
    """
    if float(np.max(s.vehicle.reference["load"])) > 0.0:
        return
    R = s.vehicle.reference["R_WB"]
    away = behind(np.zeros(3), math.atan2(R[1, 0], R[0, 0]))
    if _is_hooked(s, way.grip):
        s.arms.move_to(way.grip.q_low)
        s.until_arrived()
    else:
        away[2] = 0.0
    far = float(np.linalg.norm(away))
    back_off(s, away / far, far, BACKS_OFF)


def _carry_back(
    s: Supervisor, way: ToolPlan, place: Place, weight: float, speeds: tuple[float, float]
) -> bool:
    """Carry the tool back to `place` on the bench, fly home; returns whether it stands there."""
    s.begin("carry back")
    move_platform(s, way.to_pipe[-1, :3], way.seat.yaw, NEAR_SPEED)
    _follow(s, way.to_pipe[::-1], CALM_SPEED)
    s.begin("back to the bench")
    move_platform(s, find_platform(way.grip, place) + [0.0, 0.0, ABOVE], place.yaw, NEAR_SPEED)
    held = _is_held(s, way.grip)
    if held:
        must = "the tool would stay on the hooks"
        held = not put_down(s, way.grip, place, weight, speeds, "lower", must)
        s.begin("return")
    _leave(s, way, place)
    _go_home(s, way)
    return held


def _give_up(
    s: Supervisor, way: ToolPlan, place: Place, weight: float, speeds: tuple[float, float]
) -> str:
    """Carry the tool back if it is on the hooks after a failed installation, and fly home.

    `place` is the bench's. Returns the outcome for the tool.
    """
    if _is_held(s, way.grip):
        returned = _carry_back(s, way, place, weight, speeds)
        return BECAME[returned]
    s.begin("return")
    _leave(s, way, way.seat)
    _go_home(s, way, from_pipe=True)
    return "it stays where it is"


def _measure_seat(s: Supervisor, task: ToolInstall) -> Place:
    """Return the goal of the tool on the pipe that motion capture measures."""
    return find_seat(s.vehicle.world, task, *s.devices.surveyor.survey(PIPE))


def _come(
    s: Supervisor[ToolInstall], way: ToolPlan, place: Place, beside: Array | None = None
) -> None:
    """Approach a tool that stands at `place`, hands low; then move the hands below its handle.

    `beside` (3,) m, ahead, left, up, is an offset of their waiting position.
    """
    p = find_platform(way.grip, place)
    move_platform(s, behind(p, place.yaw), place.yaw, NEAR_SPEED)
    s.senses.room = _build_room(s, way, place)
    move_platform(s, p - [0.0, 0.0, DROP], place.yaw, NEAR_SPEED)
    lead_hands(s, way.grip, -LOW, 0.05, beside)
    s.wait(STEADY_S)


def _build_room(
    s: Supervisor[ToolInstall], way: ToolPlan, place: Place
) -> Callable[[], float] | None:
    """Return a function that measures by how much (m) a tool at `place` is farther than its limit.

    The limit is the least distance of the plan, in its wind, less UNPLANNED. The map has the tool
    on the bench; the geometry is the same at both places.
    """
    if s.surroundings is None:
        return None
    query, n = s.surroundings(), s.vehicle.n_joints
    keeps = way.clear - UNPLANNED
    at, there = find_platform(way.grip, way.bench), find_platform(way.grip, place)
    turn = rot_z(way.bench.yaw - place.yaw)

    def measure() -> float:
        est = s.senses.estimate
        p, R = at + turn @ (est.p_WB - there), turn @ est.R_WB
        return float(compute_clearance(query, p, R, np.array(est.q[:n])).distance) - keeps

    return measure


def _leave(s: Supervisor, way: ToolPlan, place: Place) -> None:
    """Draw back from a standing tool, hands low."""
    s.arms.move_to(way.grip.q_low)
    s.until_arrived()
    here = s.vehicle.reference["p_WB"] + [0.0, 0.0, DROP]  # for hands at the handle
    move_platform(s, behind(here, place.yaw), place.yaw, NEAR_SPEED)


def _is_elsewhere(s: Supervisor, place: Place, wanted: Place) -> bool:
    """Return whether the tool has fallen, or is too far from the place for which the path was
    checked."""
    far = float(np.linalg.norm(place.p_WO - wanted.p_WO)) > s.task.way_clearance_m
    return far or measure_tool(s)[1][2, 2] < math.cos(TILT_MAX)


def _is_hooked(s: Supervisor, grip: Grip) -> bool:
    """Return whether the handle may be in the cradles, within the uncertainty of the robot's
    position."""
    return min(compute_miss(s, grip, d) for d in (np.zeros(3), s.senses.doubt)) < 0.5 * LOW


def _is_held(s: Supervisor, grip: Grip) -> bool:
    """Return whether the tool is in the hands."""
    p, R = measure_tool(s)
    middle = np.mean(s.vehicle.read(Hands).p_WH[:2], axis=0)
    return float(np.linalg.norm(p + R @ grip.handle - middle)) < LOW


def _follow(s: Supervisor, points: Array, speed: float) -> None:
    """Fly along waypoints (n, 4) m, rad, at rest in each."""
    for point in points:
        here = s.vehicle.reference["p_WB"]
        if float(np.linalg.norm(point[:3] - here)) > 1e-3:
            move_platform(s, point[:3], float(point[3]), speed, CARRY_ACCELERATION)


def _go_home(s: Supervisor, way: ToolPlan, from_pipe: bool = False) -> None:
    """Fly back over the take-off point and lift the arms above the landing gear."""
    if from_pipe:
        here = s.vehicle.reference["p_WB"]
        high = np.array([here[0], here[1], way.to_pipe[-1, 2]])
        move_platform(s, high, way.seat.yaw, NEAR_SPEED)
        _follow(s, way.to_pipe[::-1], CALM_SPEED)
        back = behind(way.to_pipe[0, :3], way.bench.yaw)
        move_platform(s, back, way.bench.yaw, CALM_SPEED)
    _follow(s, way.to_bench[::-1], s.vehicle.limits.speed)
    s.begin("lift arms")
    s.arms.move_to(way.folded)
    s.until_arrived()
