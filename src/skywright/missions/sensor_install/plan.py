"""Press a sensor on a pipe from below with one hand (Suarez 2020, section VI-B).

Nine phases as in the paper: take off, arms to the operation pose, navigate, approach, hand to the
contact, force, retract, return, land. Two tests precede the approach: how accurately the hand holds
a point in space, and how fast a swing of the passive link decays.
"""

import math
import time
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Table
from skywright.core.rotations import rot_z
from skywright.core.streams import build_stream
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.description.world.surface import level_axes
from skywright.errors import InputError
from skywright.missions.sensor_install.motion import sum_moves
from skywright.missions.sensor_install.surveyed import InstallSurvey, plan_survey
from skywright.missions.sensor_install.task import SensorInstall
from skywright.missions.skills.operated import load_operator
from skywright.missions.skills.surveyed import is_surveyed
from skywright.missions.skills.ways import (
    Way,
    build_surroundings,
    check_line,
    plan_way,
)
from skywright.models.compliant_arms import find_hands, find_swing, is_compliant
from skywright.models.floating import compute_floating
from skywright.models.geometry import ClearanceQuery
from skywright.models.rigid_body import (
    posture,
)
from skywright.models.tip_force import Loaded
from skywright.planning.motion.transit import Configuration
from skywright.run.gust_limits import find_exceeded_motion
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

BEHIND = 0.17  # m, from the pipe's surface to the axis of the body that carries the arms
RISE = math.radians(15.0)  # slope of the forearm: only the hand may touch
SWING_DECAYED = math.radians(1.0)  # from rest
IDLE_DEG = (0.0, 15.0, 30.0, 45.0)  # angles by which the idle forearm may be lowered
STRETCHED_DEG = (-80.0, 0.0, 0.0, -20.0)  # shoulder pitch, roll, yaw, elbow: near the singularity


class InstallPlan(NamedTuple):
    """Poses and paths of the robot; platform poses are those for the arms' operation pose."""

    contact: Array  # (3,) m, on the pipe
    yaw: float
    normal: Array  # (3,) direction of pressing
    q: Array  # (n_joints,) rad, operation pose, swing in equilibrium
    q_good: Array  # the same in the L pose
    q_survey: Array  # while the other hand touches the pipe in the survey
    p_far: Array  # (3,) m, platform behind and below
    p_below: Array  # below the pipe
    p_near: Array  # hand at the stand-off
    hover_hand: Array  # (3,) m, the left hand in the good pose at p_far
    home: Array  # (3,) m, hover
    folded: Array  # (n_joints,) rad
    swing_rad_s: float  # frequency of the link under a platform at rest; 0 without a link
    to_far: Way  # from home
    to_below: Way  # from p_far
    survey: InstallSurvey | None = None


def plan(setup: Setup[SensorInstall]) -> MissionPlan[InstallPlan]:
    """Compute the robot's poses for the contact and the paths there and back."""
    d, robot, world = setup.description, setup.robot, setup.world
    task = setup.task
    if setup.cylinder is None:
        raise InputError(f"world {world.name!r} has no pipe: add a [world.pipe] table")
    if not is_compliant(robot):
        raise InputError(
            f"robot {robot.name!r} has no arm with position servos: sensor-install "
            "requires one, see bimanual-longreach"
        )
    began = time.perf_counter()
    cylinder = setup.cylinder
    ahead, _, up = level_axes(cylinder.R_WP).T
    yaw = math.atan2(ahead[1], ahead[0])
    contact = cylinder.p_WP - cylinder.radius * up
    model = setup.model
    R = rot_z(yaw)
    around = build_surroundings(setup, task.way_clearance_m, "mission.task.way_clearance_m")
    q = _choose_pose(setup, around.query, contact, R, up, cylinder.radius)
    q_good = find_swing(model, build_pose(robot, "L", cylinder.radius))
    q_survey, survey = q_good, None
    if is_surveyed(setup):
        q_survey, survey = _choose_survey(setup, around.query, yaw)

    def place(hand: Array) -> Array:
        return hand - R @ find_hands(model, q)[0]

    low = contact - task.approach_below_m * up
    p_below = place(low)
    p_far = p_below - (robot.platform.diameter_m + 0.5) * R[:, 0]
    hover = setup.hover
    rng = build_stream(d.mission.seed, "planner")
    home = Configuration(hover[:3], float(hover[3]), q_good)
    to_far, room_far, no_far = plan_way(around, home, Configuration(p_far, yaw, q_good), rng)
    far, below = Configuration(p_far, yaw, q), Configuration(p_below, yaw, q)
    to_below, room_below, no_below = plan_way(around, far, below, rng)
    found = InstallPlan(
        contact, yaw, up, q, q_good, q_survey,
        p_far=p_far,
        p_below=p_below,
        p_near=place(contact - task.stand_off_m * up),
        hover_hand=p_far + R @ find_hands(model, q_good)[0],
        home=hover[:3],
        folded=posture(robot, "folded"),
        swing_rad_s=compute_swing_frequency(model, q, world.gravity_mps2),
        to_far=to_far,
        to_below=to_below,
        survey=survey,
    )  # fmt: skip
    legs = list_legs(found)
    keys = ("way_clearance_m", "near_clearance_m")
    least, blocked = min(room_far, room_below), None
    if no_far is not None or no_below is not None:
        blocked = f"navigate: {no_far}" if no_far is not None else f"navigate on: {no_below}"
    for key, (name, a, b, pose) in zip(keys, (legs[0], legs[-1]), strict=True):
        distance, what = check_line(around.query, a, b, R, pose)
        least = min(least, distance)
        if distance < getattr(task, key) and blocked is None:
            blocked = (
                f"{name}: {what} come within {max(distance, 0.0):.3f} m; required "
                f"clearance: {getattr(task, key):g} m (mission.task.{key})"
            )
    most, joint = Loaded(robot, q, world.gravity_mps2).compute_push_limit(R.T @ up)
    if task.force_n > most and blocked is None:
        blocked = (
            f"force: at {most:.2g} N the servo of {joint} stalls; requested: {task.force_n:g} N"
        )
    if blocked is None:
        blocked = _find_gusts(setup, yaw)
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began,
        sum_moves(setup, found), least, way=found,
        operator=load_operator(task),
    )  # fmt: skip


def _find_gusts(setup: Setup[SensorInstall], yaw: float) -> str | None:
    """Return why gusts move platform or link by more than the requirements allow, or None."""
    asked = setup.description.mission.requirements
    place, decay = asked.get("platform.excursion_m"), asked.get("swing.decay_s")
    told = find_exceeded_motion(
        setup, yaw, math.inf if place is None else place.limit,
        0.0 if decay is None else math.radians(setup.task.swing_deg), SWING_DECAYED,
        math.inf if decay is None else decay.limit, setup.task.swing_sigmas,
    )  # fmt: skip
    return None if told is None else f"wind: {told}"


def list_legs(way: InstallPlan) -> list[tuple[str, Array, Array, Array]]:
    """Return the straight flights to the stand-off: (phase, from, to, joints)."""
    legs = [("arms to the operation pose", way.home, way.home, way.folded)]
    for name, there in (("navigate", way.to_far), ("navigate on", way.to_below)):
        corners = zip(there.p_WB, there.p_WB[1:], there.q[1:], strict=False)
        legs += [(name, a, b, q) for a, b, q in corners]
    return [*legs, ("approach", way.p_below, way.p_near, way.q)]


def compute_swing_frequency(model: Table, q: Array, gravity: float) -> float:
    """Return the frequency (rad/s) of the passive first joint with the platform at rest, or 0."""
    if len(q) == 0 or model[0]["motor_speed_max"][0] > 0.0:
        return 0.0
    _, w = compute_floating(model, q, 0)
    return math.sqrt(gravity * float(np.linalg.norm(w["L_s"])) / float(w["M_ss"]))


def _choose_pose(
    setup: Setup[SensorInstall], query: ClearanceQuery, contact: Array, R: Array, up: Array,
    radius: float,
) -> Array:  # fmt: skip
    """Return the operation pose (n_joints,) rad whose idle hand stays clear of the pipe.

    Below an inclined or thick pipe the idle hand must be lower.
    """
    task, q = setup.task, np.empty(0)
    for lower in np.radians(IDLE_DEG):
        q = find_swing(setup.model, build_pose(setup.robot, task.pose, radius, lower))
        hand = R @ find_hands(setup.model, q)[0]
        ends = [contact - below * up - hand for below in (task.approach_below_m, task.stand_off_m)]
        if check_line(query, ends[0], ends[1], R, q)[0] >= task.near_clearance_m:
            return q
    return q


def _choose_survey(
    setup: Setup[SensorInstall], query: ClearanceQuery, yaw: float
) -> tuple[Array, InstallSurvey]:
    """Return the pose (n_joints,) rad in which the right hand touches the pipe, and the survey.

    The left hand is idle. It is lowered if the pipe, within its map error, could reach it.
    """
    cylinder, R = setup.cylinder, rot_z(yaw)
    assert cylinder is not None
    for lower in np.radians(IDLE_DEG):
        pose = build_pose(setup.robot, "L", cylinder.radius, lower, idle=0)
        q = find_swing(setup.model, pose)
        survey = plan_survey(setup, q, yaw)
        ends = [survey.start(i) for i in range(len(survey.travels))]
        room = min(check_line(query, p, p, R, q)[0] for p, _ in ends)
        if room >= setup.task.near_clearance_m + survey.error:
            break
    return q, survey


def build_pose(robot: Robot, pose: str, radius: float, lower: float = 0.0, idle: int = 1) -> Array:
    """Return q (n_joints,) rad of the operation pose, equal for both arms.

    `lower` (rad) rotates the forearm of the arm `idle` (0 left, 1 right) down from there.

    L: the forearm rises a little towards the hand. The upper arm points down, or leans forward as
    far as the pipe's radius requires to keep the body that carries the arms clear of the pipe.
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
                f"robot {robot.name!r} has arms of {len(mine)} joints; sensor-install "
                "requires 4: shoulder pitch, roll, yaw and elbow"
            )
        q[mine] = angles
        q[mine[-1]] += lower if side == idle else 0.0
    return q
