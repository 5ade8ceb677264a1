"""Press a sensor on a pipe from below with one hand (Suarez 2020, section VI-B).

Nine phases as in the paper: take off, arms to the operation pose, navigate, approach, hand to the
contact, force, retract, return, land; before the approach two checks of the robot itself: how well
the hand keeps a point in space, and how fast a swing of the passive link decays.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.core.types import TASK_FORCE, TASK_POSITION
from skywright.description.loader import Description
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.description.world.surface import build_cylinder
from skywright.errors import InputError
from skywright.missions.sensor_install.task import SensorInstall, SensorInstallMission
from skywright.missions.skills.moves import set_rest
from skywright.missions.skills.ways import (
    Way,
    build_surroundings,
    check_line,
    differs,
    fly_way,
    plan_way,
    reverse_way,
    slide_platform,
)
from skywright.models.compliant_arms import find_hands, find_swing, is_compliant
from skywright.models.floating import compute_floating
from skywright.models.rigid_body import (
    build_body_model,
    posture,
)
from skywright.models.tip_force import Loaded
from skywright.planning.motion.transit import Configuration
from skywright.run.flight import Flight
from skywright.run.planning import MissionPlan, build_limits, find_hover
from skywright.vehicle.rest_to_rest import quintic

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

Array = NDArray[np.float64]
Table = NDArray[Any]

NEEDS = frozenset({"uav", "hands"})

MARGIN = 0.1  # m, kept from everything on the way
BEHIND = 0.17  # m, from the pipe's surface to the axis of what carries the arms
NEAR_MARGIN = 0.02  # m, kept by what does not touch while the hand presses
CONTACT_N = 0.3  # N, estimated force at which the hand counts as touching
CONTACT_S = 0.1  # s, for which it has to be felt
SEARCH = 0.1  # m, how far beyond the expected surface the hand looks for it
RAMP_S, SETTLE_S = 3.0, 4.0  # until the force is judged
SWING_FORCE = 6.0  # N, of the push on the link
SWING_WAIT = 6.0  # s, watched from the link's turning back
CALM = 0.3  # of the limits of speed and acceleration, near the pipe
SLOW = 0.05  # of them, while the hand presses
TARE_S = 3.0  # s, over which the force in free air is called zero
PARK_S = 3.0  # s, of hovering before something is measured
WATCH_S = 2.0  # s, over which the hand's place is averaged: a period of the link
CORRECTION_MAX = 0.06  # m, of the platform for a hand that is not where it was planned
LOST_S = 1.0  # s without contact before pressing is given up
RISE = math.radians(15.0)  # of the forearm towards the hand: it must not touch beside the hand
STRETCHED_DEG = (-80.0, 0.0, 0.0, -20.0)  # shoulder pitch, roll, yaw, elbow: near the singularity


class InstallPlan(NamedTuple):
    """Where the robot will be; platform poses are those of the working pose of the arms."""

    contact: Array  # (3,) m, on the pipe
    yaw: float
    normal: Array  # (3,) direction of pressing
    q: Array  # (n_joints,) rad, operation pose, swing in equilibrium
    q_good: Array  # the same in the L pose
    p_far: Array  # (3,) m, platform behind and below
    p_below: Array  # below the pipe
    p_near: Array  # hand at the stand-off
    hover_hand: Array  # (3,) m, the left hand in the good pose at p_far
    home: Array  # (3,) m, hover
    folded: Array  # (n_joints,) rad
    swing_rad_s: float  # frequency of the link under a platform at rest, 0 without one
    to_far: Way  # from home
    to_below: Way  # from p_far


def plan(d: Description) -> MissionPlan:
    """Place the robot for the contact and find the ways there and back."""
    robot, world = d.robot, d.world
    assert isinstance(d.mission, SensorInstallMission)
    task = d.mission.task
    if world.pipe is None:
        raise InputError(f"world {world.name!r} has no pipe: give it a [world.pipe] table")
    if not is_compliant(robot):
        raise InputError(
            f"robot {robot.name!r} has no arm with position servos: sensor-install needs one, "
            "such as bimanual-longreach"
        )
    began = time.perf_counter()
    cylinder = build_cylinder(world.pipe)
    ahead = cylinder.R_WP[:, 0]
    yaw = math.atan2(ahead[1], ahead[0])
    up = cylinder.R_WP[:, 2]
    contact = cylinder.p_WP - cylinder.radius * up
    model = build_body_model(robot, world.gravity_mps2)
    q = find_swing(model, build_pose(robot, task.pose, cylinder.radius))
    q_good = find_swing(model, build_pose(robot, "L", cylinder.radius))
    R = rot_z(yaw)

    def place(hand: Array) -> Array:
        return hand - R @ find_hands(model, q)[0]

    low = contact - task.approach_below_m * up
    p_below = place(low)
    p_far = p_below - (robot.platform.diameter_m + 0.5) * R[:, 0]
    hover = find_hover(d)
    around = build_surroundings(robot, world, model, build_limits(robot).ground, MARGIN)
    rng = build_stream(d.mission.seed, "planner")
    home = Configuration(hover[:3], float(hover[3]), q_good)
    to_far, room_far, no_far = plan_way(around, home, Configuration(p_far, yaw, q_good), rng)
    far, below = Configuration(p_far, yaw, q), Configuration(p_below, yaw, q)
    to_below, room_below, no_below = plan_way(around, far, below, rng)
    found = InstallPlan(
        contact, yaw, up, q, q_good,
        p_far=p_far,
        p_below=p_below,
        p_near=place(contact - task.stand_off_m * up),
        hover_hand=p_far + R @ find_hands(model, q_good)[0],
        home=hover[:3],
        folded=posture(robot, "folded"),
        swing_rad_s=compute_swing_frequency(model, q, world.gravity_mps2),
        to_far=to_far,
        to_below=to_below,
    )  # fmt: skip
    legs = list_legs(found)
    least, blocked = min(room_far, room_below), None
    if no_far is not None or no_below is not None:
        blocked = f"navigate: {no_far}" if no_far is not None else f"navigate on: {no_below}"
    for name, a, b, pose, margin in (legs[0], legs[-1]):
        distance, what = check_line(around.query, a, b, R, pose)
        least = min(least, distance)
        if distance < margin and blocked is None:
            blocked = (
                f"{name}: {what} come within {max(distance, 0.0):.3f} m, {margin:.2f} m are kept"
            )
    most, joint = Loaded(robot, q, world.gravity_mps2).compute_push_limit(R.T @ up)
    if task.force_n > most and blocked is None:
        blocked = f"force: at {most:.2g} N the servo of {joint} stalls; asked: {task.force_n:g} N"
    speed = robot.control.speed_max_mps
    length = sum(float(np.linalg.norm(b - a)) for _, a, b, _, _ in legs)
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began,
        2.0 * 1.875 * length / speed + task.hold_s + task.hover_s, least, math.nan, {}, None,
        0.0, 0.0, found,
    )  # fmt: skip


def list_legs(way: InstallPlan) -> list[tuple[str, Array, Array, Array, float]]:
    """Return the straight flights to the stand-off: (phase, from, to, joints, margin kept)."""
    legs = [("arms to the operation pose", way.home, way.home, way.folded, MARGIN)]
    for name, there in (("navigate", way.to_far), ("navigate on", way.to_below)):
        corners = zip(there.p_WB, there.p_WB[1:], there.q[1:], strict=False)
        legs += [(name, a, b, q, MARGIN) for a, b, q in corners]
    return [*legs, ("approach", way.p_below, way.p_near, way.q, NEAR_MARGIN)]


def compute_swing_frequency(model: Table, q: Array, gravity: float) -> float:
    """Return the frequency (rad/s) of the passive first joint with the platform at rest, or 0."""
    if len(q) == 0 or model[0]["motor_speed_max"][0] > 0.0:
        return 0.0
    _, w = compute_floating(model, q, 0)
    return math.sqrt(gravity * float(np.linalg.norm(w["L_s"])) / float(w["M_ss"]))


def build_pose(robot: Robot, pose: str, radius: float) -> Array:
    """Return q (n_joints,) rad of the operation pose, the right arm held as the left.

    L: the forearm rises a little towards the hand. The upper arm hangs, or leans forward as far as
    the pipe's radius asks, so that what carries the arms stays clear of the pipe.
    """
    assert robot.arm is not None
    joints = list_joints(robot)
    q = posture(robot, "working")
    upper = max(limb.link.length_m for limb in joints if limb.side == 0)
    fore = math.cos(RISE) * [limb.link.length_m for limb in joints if limb.side == 0][-1]
    lean = math.asin(min(max((radius + BEHIND - fore) / upper, 0.0), 0.9))
    angles = np.array([-lean, 0.0, 0.0, lean - RISE - math.pi / 2])
    if pose == "stretched":
        angles = np.radians(STRETCHED_DEG)
    for side in range(robot.arm.sides):
        mine = [j for j, limb in enumerate(joints) if limb.side == side]
        if len(mine) != 4:
            raise InputError(
                f"robot {robot.name!r} has arms of {len(mine)} joints; sensor-install needs 4: "
                "shoulder pitch, roll, yaw and elbow"
            )
        q[mine] = angles
    return q


def fly(s: Supervisor) -> Flight:
    """Fly the phases between take-off and landing."""
    assert isinstance(s.mission, SensorInstallMission)
    task, way = s.mission.task, s.plan.task
    assert isinstance(way, InstallPlan)
    s.begin("arms to operation pose")
    s.arms.move_to(way.q_good)
    s.until_arrived()
    _tare(s)
    s.begin("navigate")
    fly_way(s, way.to_far, 1.0)
    s.wait(PARK_S)
    if task.swing_deg > 0.0 and s.vehicle.hands["swing"] >= 0:
        _check_swing(s, math.radians(task.swing_deg), way)
    if task.hover_s > 0.0:
        s.begin("hover check")
        s.body.track(_hold_hand(s, way.hover_hand, task))
        s.wait(task.hover_s)
    s.begin("navigate on")
    s.arms.move_to(way.q)
    s.until_arrived()
    fly_way(s, way.to_below, CALM)
    s.wait(PARK_S)
    here = _watch_hand(s)
    correction = _limit(way.contact - task.approach_below_m * way.normal - here, CORRECTION_MAX)
    s.begin("approach")
    s.body.track(_hold_hand(s, here, task))
    _move_with_hand(s, way.p_near + correction, way.contact - task.stand_off_m * way.normal)
    s.wait(PARK_S)
    if task.pose == "L":
        _tare(s)
    touched = _touch(s, task, way)
    held = touched and _press(s, task, way)
    s.begin("retract")
    s.body.track(_hold_hand(s, way.contact - task.approach_below_m * way.normal, task))
    s.wait(2.0)
    _move_with_hand(s, way.p_below, way.contact - task.approach_below_m * way.normal)
    s.arms.move_to(way.q)
    s.until_arrived()
    s.begin("return")
    fly_way(s, reverse_way(way.to_below), CALM)
    if differs(s, way.q_good):
        s.arms.move_to(way.q_good)
        s.until_arrived()
    fly_way(s, reverse_way(way.to_far), 1.0)
    s.arms.move_to(way.folded)
    s.until_arrived()
    if not touched:
        return Flight(False, "the hand found no surface")
    return Flight(held, "" if held else "contact was lost while pressing")


def _hold_hand(s: Supervisor, p: Array, task: SensorInstall) -> Table:
    """The platform stays; the left hand goes straight to p (3,) m and keeps it."""
    row = set_rest(s.vehicle.reference)
    row["task"][0], row["p_WH"][0] = TASK_POSITION, p
    row["v_WH"][0] = [task.hand_speed_mps, 0.0, 0.0]
    return row[None]


def _watch_hand(s: Supervisor) -> Array:
    """Where the left hand is (3,) m, in the mean over a swing of the link.

    The link hangs, and the springs give way, a little other than planned, and what the hand is off
    the platform has to move: 20 deg of bend in the elbow of a stretched arm are 8 mm of reach.
    """
    seen, end = [], s.vehicle.t + WATCH_S
    while s.vehicle.t < end - 1e-9:
        s.tick()
        seen.append(s.vehicle.hands["p_WH"][0])
    mean: Array = np.mean(seen, axis=0)
    return mean


def _limit(vector: Array, most: float) -> Array:
    return vector * min(1.0, most / max(float(np.linalg.norm(vector)), 1e-9))


def _move_with_hand(s: Supervisor, p: Array, hand: Array) -> None:
    """Move platform to p and the left hand to `hand` (3,) m at the same time, rest to rest."""
    table = slide_platform(s, p, CALM)
    first = table["p_WH"][0, 0].copy()
    shape, _, _ = quintic(table["t"] / table["t"][-1])
    table["p_WH"][:, 0] = first + shape[:, None] * (hand - first)
    s.body.track(table)
    s.until_arrived()


def _check_swing(s: Supervisor, angle: float, way: InstallPlan) -> None:
    """Push the link until it will turn back at `angle` (rad); watch from there.

    A push of tenths of a second: a slow pull would show how the platform comes back from having
    leant against it, not how a swing dies out. Of a pendulum, (q - rest)^2 + (q' / w)^2 is the
    square of the angle at which it will turn back.
    """
    s.begin("push the link")
    swing = int(s.vehicle.hands["swing"])
    rest, started = float(s.vehicle.estimate["q"][swing]), s.vehicle.t
    s.vehicle.push("pendulum", -SWING_FORCE * rot_z(way.yaw)[:, 0])
    away, rate = 0.0, 0.0
    while math.hypot(away, rate / way.swing_rad_s) < angle and s.vehicle.t < started + SWING_WAIT:
        s.tick()
        away = float(s.vehicle.estimate["q"][swing]) - rest
        rate = float(s.vehicle.estimate["qd"][swing])
    s.vehicle.push("pendulum", np.zeros(3))
    while rate * away > 0.0 and s.vehicle.t < started + SWING_WAIT:
        s.tick()
        rate = float(s.vehicle.estimate["qd"][swing])
    s.begin("swing check")
    s.wait(SWING_WAIT)


def _touch(s: Supervisor, task: SensorInstall, way: InstallPlan) -> bool:
    """Move the hand up until its force says contact."""
    s.begin("touch")
    start = s.vehicle.t
    goal = way.contact + SEARCH * way.normal
    row = set_rest(s.vehicle.reference)
    row["task"][0], row["v_WH"][0] = TASK_POSITION, [0.02, 0.0, 0.0]
    row["p_WH"][0] = goal
    s.body.track(row[None])
    patience = (task.stand_off_m + SEARCH) / 0.02 + 3.0
    free = start
    while s.vehicle.t - start < patience:
        t = s.tick().t
        if float(s.vehicle.hands["f_WH"][0] @ way.normal) < CONTACT_N:
            free = t
        elif t - free > CONTACT_S - 1e-9:
            s.end("done")
            return True
    s.end("failed")
    return False


def _press(s: Supervisor, task: SensorInstall, way: InstallPlan) -> bool:
    """Ramp the force up, settle, hold it; returns whether contact was kept to the end.

    With `leave_singularity` a stretched arm is answered: the platform moves to where the elbow
    comes to a right angle, while the hand goes on pressing.
    """
    row = set_rest(s.vehicle.reference)
    row["task"][0], row["p_WH"][0] = TASK_FORCE, s.vehicle.hands["p_WH"][0]
    row["v_WH"][0] = 0.0  # fed forward in this task
    table = np.repeat(row[None], 2)
    table["t"] = [0.0, RAMP_S]
    table["f_WH"][0, 0], table["f_WH"][1, 0] = CONTACT_N * way.normal, task.force_n * way.normal
    s.begin("press")
    s.body.track(table)
    if task.leave_singularity:
        s.tick()
        shift = s.arms.platform_shift("left")
        if np.any(shift != 0.0):
            s.begin("leave singularity")
            away = slide_platform(s, row["p_WB"] + shift, SLOW)
            away["f_WH"][:, 0] = np.linspace(table["f_WH"][0, 0], table["f_WH"][1, 0], len(away))
            s.body.track(away)
            s.until_arrived()
            table = away[-1:].copy()
            table["t"] = 0.0
            s.begin("press")
            s.body.track(table)
    if not _keep(s, RAMP_S + SETTLE_S, way):
        return False
    s.begin("force")
    return _keep(s, task.hold_s, way)


def _tare(s: Supervisor) -> None:
    """Call the force in free air zero, in a good pose: stretched, little torque is much force."""
    s.wait(1.0)
    s.arms.tare()
    s.wait(TARE_S)
    s.arms.tare(False)


def _keep(s: Supervisor, seconds: float, way: InstallPlan) -> bool:
    """Tick for a time; False when the estimated force was gone for too long."""
    end, felt = s.vehicle.t + seconds, s.vehicle.t
    while s.vehicle.t < end - 1e-9:
        t = s.tick().t
        if float(s.vehicle.hands["f_WH"][0] @ way.normal) > 0.1:
            felt = t
        elif t - felt > LOST_S:
            s.end("failed")
            return False
    return True
