"""Insert the peg below a bar into a hole in flight, with the bar held by both hands.

The bar is suspended in the hooks of both arms, which support it only upward. The peg points down,
so that the bar's own weight presses it in: the hands reduce the weight that they carry by the force
of (31), and control the bar by (29), (30). Motion capture measures the hole to a millimetre. The
chamfer, the springs of the arms and repeated attempts tolerate the rest
(docs/howto/insert-a-bar.md).
"""

import math
import time
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.things import locate_thing
from skywright.errors import InputError
from skywright.missions.bar_insertion.motion import sum_moves
from skywright.missions.bar_insertion.task import BarInsertion
from skywright.missions.skills.hook_grip import build_grip, check_hooks, compute_hooks_apart
from skywright.missions.skills.operated import load_operator
from skywright.missions.skills.tool_handling import (
    LIFT,
    Grip,
    Place,
    find_platform,
)
from skywright.missions.skills.tool_motion import behind
from skywright.missions.skills.tool_pose import find_marker
from skywright.models.arm_inverse_kinematics import ArmChain, build_arm_chain
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.models.things.peg import Peg
from skywright.models.things.socket import Socket
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.vehicle.interface import build_limits

ROOM = 1.2  # largest weight that is fed forward, relative to the payload limit
HAND_ROOM = 0.03  # m, from a hand's hook to the crossbar's end
STEP = 0.05  # m, between clearance checks on the path


class InsertionPlan(NamedTuple):
    """Poses of things and robot as known before take-off."""

    grip: Grip
    chains: tuple[ArmChain, ArmChain]
    folded: Array  # (n_joints,) rad
    rack: Place
    socket: Place  # according to the world file, with the peg inserted
    home: Array  # (4,) m, rad
    most_n: float  # weight that may be lifted


def plan(setup: Setup[BarInsertion]) -> MissionPlan[InsertionPlan]:
    """Compute poses and check the straight paths; refuse infeasible requests with the reason."""
    robot, world, task, began = setup.robot, setup.world, setup.task, time.perf_counter()
    _check_input(robot, world, task)
    grip = build_grip(robot, world.find_thing(task.bar, Peg), world.gravity_mps2)
    places = [
        Place(p, math.atan2(R[1, 0], R[0, 0]))
        for p, R in (locate_thing(world.things, name) for name in (task.rack, task.socket))
    ]
    found = InsertionPlan(
        grip, (build_arm_chain(robot, 0), build_arm_chain(robot, 1)), posture(robot, "folded"),
        places[0], places[1], setup.hover,
        ROOM * task.payload_max_kg * world.gravity_mps2,
    )  # fmt: skip
    blocked = _find_misfit(robot, world, task)
    least = math.inf
    if blocked is None:
        least, blocked = _find_blocked_way(
            robot, world.drop_things(task.bar), found, task.near_clearance_m
        )
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began,
        sum_moves(found, build_limits(robot).speed), least, way=found,
        operator=load_operator(setup.task),
    )  # fmt: skip


def _check_input(robot: Robot, world: World, task: BarInsertion) -> None:
    """Raise InputError if robot or world do not suit this mission."""
    peg = world.find_thing(task.bar, Peg)
    blocks = [(name, world.find_thing(name, Socket)) for name in (task.rack, task.socket)]
    find_marker(world, task.bar)
    if not blocks[1][1].tracked:
        raise InputError(
            f"world {world.name!r}: motion capture must track the socket: "
            f"[world.things.{task.socket}] "
            "tracked = true"
        )
    check_hooks(robot, "bar-insertion")
    for name, block in blocks:
        if block.hole_m <= peg.side_m:
            raise InputError(
                f"world.things.{name}.hole_m = {block.hole_m:g}: the peg of side_m = "
                f"{peg.side_m:g} does not fit; valid: above {peg.side_m:g}"
            )
        if block.hole_m + 2.0 * block.chamfer_m >= peg.flange_m:
            raise InputError(
                f"world.things.{name}.hole_m = {block.hole_m:g}: the bar's flange of "
                f"{peg.flange_m:g} m would fall through; valid: below the flange, chamfer included"
            )
        if block.depth_m <= peg.length_m:
            raise InputError(
                f"world.things.{name}.depth_m = {block.depth_m:g}: the peg is {peg.length_m:g} m "
                f"long; valid: above {peg.length_m:g}"
            )
        z = float(locate_thing(world.things, name).p[2])
        if z <= block.depth_m:
            raise InputError(
                f"world.things.{name}.z_m = {z:g}: its hole would reach into the ground; valid: "
                f"above depth_m = {block.depth_m:g}"
            )


def _find_misfit(robot: Robot, world: World, task: BarInsertion) -> str | None:
    """Return why bar, socket and arms do not fit each other, or None."""
    peg = world.find_thing(task.bar, Peg)
    assert robot.arm is not None
    if peg.mass_kg > task.payload_max_kg:
        return (
            f"the bar weighs {peg.mass_kg:g} kg, more than the payload limit "
            f"(mission.task.payload_max_kg = {task.payload_max_kg:g})"
        )
    apart = compute_hooks_apart(robot)
    needed = apart + 2.0 * (robot.arm.hand.radius_m + HAND_ROOM)
    if peg.handle_length_m < needed:
        return (
            f"the hands are {apart:g} m apart; the crossbar of {peg.handle_length_m:g} m "
            f"is too short; valid: from {needed:.3f} m"
        )
    for name in (task.rack, task.socket):
        block = world.find_thing(name, Socket)
        width = max(block.width_m, peg.flange_m)
        room = apart - 2.0 * (robot.arm.hand.radius_m + HAND_ROOM)
        if width > room:
            return (
                f"the {name} is {width:g} m wide; between the hands there is room for {room:.3f} m"
            )
    return None


def _find_blocked_way(
    robot: Robot, world: World, way: InsertionPlan, keeps: float
) -> tuple[float, str | None]:
    """Check the straight paths: (least distance m, what is too close or None).

    The world is without the bar, because the hands touch it.
    """
    query = build_clearance(build_scene(robot, world), with_ground=True)
    grip = way.grip
    at = [find_platform(grip, place) for place in (way.rack, way.socket)]
    back = [behind(p, place.yaw) for p, place in zip(at, (way.rack, way.socket), strict=True)]
    up = np.array([0.0, 0.0, LIFT])
    legs = [
        ("to the rack", way.home[:3], float(way.home[3]), back[0], way.rack.yaw, grip.q_low),
        ("at the rack", back[0], way.rack.yaw, at[0], way.rack.yaw, grip.q_low),
        ("to the socket", at[0] + up, way.rack.yaw, at[1] + up, way.socket.yaw, grip.q),
        ("at the socket", at[1] + up, way.socket.yaw, at[1], way.socket.yaw, grip.q),
        ("away from the socket", at[1], way.socket.yaw, back[1], way.socket.yaw, grip.q_low),
        ("home", back[1], way.socket.yaw, way.home[:3], float(way.home[3]), grip.q_low),
    ]
    least = math.inf
    for name, a, yaw_a, b, yaw_b, q in legs:
        turn = math.remainder(yaw_b - yaw_a, 2.0 * math.pi)  # as `move_platform` turns
        for u in np.linspace(0.0, 1.0, max(math.ceil(float(np.linalg.norm(b - a)) / STEP), 1) + 1):
            found = compute_clearance(query, a + u * (b - a), rot_z(yaw_a + u * turn), q)
            least = min(least, found.distance)
            if found.distance < keeps:
                pair = f"{query.names[found.robot_geom]} and {query.names[found.other_geom]}"
                return least, (
                    f"{name}: {pair} come within {max(found.distance, 0.0):.3f} m; "
                    f"required clearance: {keeps:g} m (mission.task.near_clearance_m)"
                )
    return least, None
