"""Fly into a padded obstacle with the left hand or with the passive link (Suarez 2020, table 3).

The robot flies at a constant speed and has no information on the obstacle until it detects contact:
its reference continues for the reaction time after the contact, stops, and backs off later. This is
a flight rather than an object thrown at a hovering robot. The energy that arm, springs and link
absorb is then the robot's own at that speed, no projectile's mass has to be assumed, and the flight
law takes part.
"""

import math
import time
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.things import locate_thing, split_support
from skywright.errors import InputError
from skywright.missions.impact.task import Impact
from skywright.models.compliant_arms import find_hands, find_swing
from skywright.models.geometry import ClearanceQuery, compute_clearance
from skywright.models.rigid_body import compute_tip, posture
from skywright.models.things.pad import Pad
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.vehicle.interface import build_limits
from skywright.vehicle.moves import compute_move_s
from skywright.vehicle.rest_to_rest import ROW_PERIOD

SPEED_UP_S = 4.0  # s, about two periods of the passive link, to excite little swing
CRUISE_S = 3.0  # s, at constant speed before the contact
RETREAT_M = 0.5  # m before the contact, to which it backs off
RECOIL_S = 1.0  # s, stopped, before it backs off
REST_S = 1.0
SEARCH = 0.6  # m, range of the search around the expected contact
HIT_POSE_DEG = (-30.0, 0.0, 0.0, -60.0)  # upper arm leaning forward, forearm level
PARTS = {"arm": ("hand0", "tip", "pen", "holder"), "link": ("pendulum",)}
"""First words of the names of the parts that have to make contact."""


class ImpactPlan(NamedTuple):
    """Point of contact and the path to it."""

    ahead: Array  # (3,) direction of flight
    yaw: float
    q: Array  # (n_joints,) rad
    p_contact: Array  # (3,) m, platform at the contact
    p_start: Array  # (3,) m, platform before the run-up
    lever: float  # m, from the passive joint down to the contact point (part "link")
    run: Array  # (n, 4) rows of time s, distance m, speed m/s, acceleration m/s^2
    touched: str


def plan(setup: Setup[Impact]) -> MissionPlan[ImpactPlan]:
    """Compute where the chosen part touches first, and the run-up to it."""
    robot, world = setup.robot, setup.world
    task = setup.task
    pad = find_pad(world, task.pad)
    if robot.arm is None:
        raise InputError(f"robot {robot.name!r} has no arm; impact requires one")
    if task.part == "link" and robot.pendulum is None:
        raise InputError(f"robot {robot.name!r} has no passive link; valid mission.task.part: arm")
    began = time.perf_counter()
    face, R = locate_thing(world.things, pad)
    ahead, yaw = R[:, 0], math.atan2(R[1, 0], R[0, 0])
    R = rot_z(yaw)
    model = setup.model
    q = find_swing(model, build_hit_pose(robot))
    lever = 0.5 * robot.pendulum.length_m if robot.pendulum is not None else 0.0
    p_BX = find_hit_point(robot, model, q, task.part)
    query = _keep_pad(setup.clearance, world, pad)
    near, touched = _find_contact(query, face - R @ p_BX, ahead, R, q)
    run = _plan_run(task.speed_mps, task.reaction_s)
    contact_s = SPEED_UP_S + CRUISE_S
    length = float(np.interp(contact_s, run[:, 0], run[:, 1]))
    found = ImpactPlan(ahead, yaw, q, near, near - length * ahead, lever, run, touched)
    blocked = None
    if touched.split(" ")[0] not in PARTS[task.part] and not _is_forearm(robot, touched, task.part):
        blocked = f"{touched or 'no part'} would touch the pad first instead of the {task.part}"
    total = _sum_moves(setup, found)
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began, total, way=found,
    )  # fmt: skip


def _sum_moves(setup: Setup[Impact], found: ImpactPlan) -> float:
    """Return the duration (s) of the flights to the run-up, of the run, and home."""
    hover, limits, length = setup.hover, build_limits(setup.robot), float(found.run[-1, 1])
    away = float(np.linalg.norm(found.p_start - hover[:3]))
    turn = math.remainder(found.yaw - float(hover[3]), math.tau)
    before = float(found.ahead @ (found.p_contact - found.p_start)) - RETREAT_M
    ways = ((away, turn), (length - before, 0.0), (abs(before), 0.0), (away, 0.0))
    moves = sum(compute_move_s(distance, angle, limits) for distance, angle in ways)
    return moves + float(found.run[-1, 0])


def build_hit_pose(robot: Robot) -> Array:
    """Return q (n_joints,) rad: level forearms for arms of four joints, otherwise the working
    posture."""
    q = posture(robot, "working")
    joints = list_joints(robot)
    for side in (0, 1):
        mine = [j for j, limb in enumerate(joints) if limb.side == side]
        turned = any(joints[j].link.is_turned for j in mine)
        if not turned and [joints[j].link.axis for j in mine] == list("yxzy"):
            q[mine] = np.radians(HIT_POSE_DEG)
    return q


def find_hit_point(robot: Robot, model: Any, q: Array, part: str) -> Array:
    """Return the point (3,) m in B that has to meet the pad's middle."""
    if part == "link":
        assert robot.pendulum is not None
        link = robot.pendulum
        s = 0.5 * link.length_m
        root = np.array([link.x_m or 0.0, link.y_m or 0.0, link.z_m or 0.0])
        return root - s * np.array([math.sin(q[0]), 0.0, math.cos(q[0])])
    hands = find_hands(model, q)
    return np.array(hands[0] if len(hands) else compute_tip(model, q)[0])


def find_pad(world: World, name: str | None) -> str:
    """Return the pad's name: that of the task, or the world's first."""
    if name is not None:
        world.find_thing(name, Pad)
        return name
    for found, thing in world.things.items():
        if isinstance(thing, Pad):
            return found
    raise InputError(
        f"world {world.name!r} has no pad: add a thing of kind 'pad', see world padded-bar"
    )


def _keep_pad(query: ClearanceQuery, world: World, pad: str) -> ClearanceQuery:
    """Restrict a query to the distance from the pad and its support."""
    on = world.find_thing(pad, Pad).on
    names = {pad} if on is None else {pad, split_support(world.things, on)[0]}
    wanted = {i for i, n in enumerate(query.names) if n in names}
    keep = np.array([int(b) in wanted for _, b in query.core.pairs])
    pairs = np.ascontiguousarray(query.core.pairs[keep])
    core = query.core._replace(pairs=pairs, n_world=len(pairs), probe=np.zeros(len(pairs)))
    return query._replace(core=core)


def _find_contact(
    query: ClearanceQuery, guess: Array, ahead: Array, R: Array, q: Array
) -> tuple[Array, str]:
    """Return the platform's position (3,) m at the first contact and the part that touches."""

    def gap(x: float) -> tuple[float, str]:
        found = compute_clearance(query, guess + x * ahead, R, q)
        return found.distance, query.names[found.robot_geom] if found.robot_geom >= 0 else ""

    free = -SEARCH
    for x in np.arange(-SEARCH, SEARCH, 0.01):
        if gap(x)[0] <= 0.0:
            break
        free = x
    else:
        return guess, ""
    low, high = free, free + 0.01
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gap(middle)[0] > 0.0 else (low, middle)
    return guess + low * ahead, gap(low)[1]


def _is_forearm(robot: Robot, name: str, part: str) -> bool:
    """Return whether a geometry is the left arm's last link."""
    mine = [limb.name for limb in list_joints(robot) if limb.side == 0]
    return part == "arm" and bool(mine) and name == f"{mine[-1]} shell"


def _plan_run(speed: float, reaction: float) -> Array:
    """Return rows of (time s, distance m, speed, acceleration): speed up, cruise, run on, stop."""
    u = np.linspace(0.0, 1.0, round(SPEED_UP_S / ROW_PERIOD) + 1)
    # the speed rises as 3 u^2 - 2 u^3
    rows = [
        np.column_stack([
            u * SPEED_UP_S, speed * SPEED_UP_S * (u**3 - 0.5 * u**4),
            speed * (3 * u**2 - 2 * u**3), speed * 6 * u * (1 - u) / SPEED_UP_S,
        ])
    ]  # fmt: skip
    t, x = SPEED_UP_S, 0.5 * speed * SPEED_UP_S
    on = CRUISE_S + reaction
    rows.append(np.array([[t + on, x + speed * on, speed, 0.0]]))
    rows.append(np.array([[t + on + ROW_PERIOD, x + speed * on, 0.0, 0.0]]))
    return np.concatenate(rows)
