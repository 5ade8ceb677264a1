"""Carry a long bar through pipe structures with both hands (Caballero et al. 2018).

Platform and arms are planned together, and the plan is flown unchanged. The flight begins in the
air: the robot is held at the first pose of the plan, with the bar in its closed grippers, and
released. It ends in hover at the goal. Take-off, landing and handing over the bar are not part of
it.
"""

import math
import time

from skywright.description.loader import Description
from skywright.description.robot.limbs import list_joints, list_limbs
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import World
from skywright.errors import InfeasibleError, InputError
from skywright.missions.bar_transport.task import BarTransport
from skywright.missions.skills.plan_flight import find_closest, load_checked_plan
from skywright.missions.skills.plan_table import build_plan_table
from skywright.models.rigid_body import compute_hands_apart, posture
from skywright.planning.motion.plan_file import PlanFile
from skywright.planning.motion.transport import Transport, TransportProblem, build_transport
from skywright.planning.motion.transport_plan import (
    build_time_limits,
    plan_transport,
)
from skywright.run.planning import MissionPlan, refuse
from skywright.run.setup import Setup


def plan(setup: Setup[BarTransport]) -> MissionPlan[None]:
    """Plan platform and arms together, from hover at the start to hover at the goal."""
    began = time.perf_counter()
    d, task = setup.description, setup.task
    problem = build_problem(d)
    limits = build_time_limits(d.robot, problem)._replace(swing=math.radians(task.swing_plan_deg))
    if task.plan_file:
        return _take_plan(setup, load_checked_plan(task.plan_file, d), began)
    try:
        found = plan_transport(
            drop_bar(d.robot), problem, d.mission.seed, duration=task.duration_s,
            slices=task.planner_slices, limits=limits,
        )  # fmt: skip
    except InfeasibleError as error:
        return refuse(str(error), time.perf_counter() - began)
    return _take_plan(setup, found.file, began)


def _take_plan(setup: Setup[BarTransport], file: PlanFile, began: float) -> MissionPlan[None]:
    """Build the mission's plan from a plan file; a plan with contact is refused."""
    clearance, what = find_closest(file, setup)
    table = build_plan_table(file, setup.model)
    return MissionPlan(
        clearance > 0.0, None if clearance > 0.0 else f"the plan: {what} touch",
        time.perf_counter() - began, float(file.t[-1]), clearance,
        segments={"transport": table}, file=file,
    )  # fmt: skip


def drop_bar(robot: Robot) -> Robot:
    """Return the robot with empty hands: the planner adds the bar."""
    assert robot.arm is not None
    return robot.model_copy(update={"arm": robot.arm.model_copy(update={"bar": None})})


def build_problem(d: Description[BarTransport]) -> TransportProblem:
    """Return the planner's problem of a mission.

    Raises InputError if robot, world or mission do not suit a planar transport.
    """
    robot, world, m, task = d.robot, d.world, d.mission, d.mission.task
    joints = [(j.side, j.link.axis, j.link.passive) for j in list_joints(robot)]
    turned = any(limb.link.is_turned for limb in list_limbs(robot))
    if turned or joints != [(-1, "y", True), *[(0, "y", False)] * 2, *[(1, "y", False)] * 2]:
        raise InputError(
            f"robot {robot.name!r} cannot carry a bar: bar-transport requires a passive "
            "pitch joint and two arms of shoulder and elbow pitch, such as ars-lrm"
        )
    if m.start_y_m != 0.0 or m.start_yaw_deg != 0.0:
        raise InputError(
            "the transport is planned in the plane y = 0: mission.start_y_m and "
            f"mission.start_yaw_deg must be 0, not {m.start_y_m:g} and {m.start_yaw_deg:g}"
        )
    _check_localisation(world, task.margin_m)
    pose = posture(robot, "working")[1:3]
    if task.bar_length_m > 0.0 and robot.arm is not None:
        least = compute_hands_apart(robot)
        if task.bar_length_m < least:
            raise InputError(
                f"mission.task.bar_length_m = {task.bar_length_m:g}: the hands of {robot.name!r} "
                f"are {least:g} m apart; valid: 0 for no bar, or above that"
            )
    transport = Transport(
        start=(m.start_x_m, m.hover_height_m, float(pose[0]), float(pose[1])),
        goal=(task.goal_x_m, task.goal_z_m, float(pose[0]), float(pose[1])),
        margin=task.margin_m, margin_self=2.0 * m.self_clearance_m,
        bar_length=task.bar_length_m, bar_radius=0.5 * task.bar_diameter_m,
        bar_mass=task.bar_mass_kg, p1=task.p1, p2=task.p2,
    )  # fmt: skip
    return build_transport(drop_bar(robot), world, transport)


def _check_localisation(world: World, margin: float) -> None:
    """Raise InputError if the localisation is too inaccurate for the margin to the pipes.

    Two standard deviations of the fixes may take half of the margin; the other half is for tracking
    errors.
    """
    if world.localisation != "gnss" or not (get_structures(world).tubes or world.things):
        return
    error = world.gnss.position_error_m
    if 2.0 * error > 0.5 * margin:
        raise InputError(
            f"world.gnss.fix = {world.gnss.fix!r}: its error of {error:.2f} m (1 sigma), "
            f"or {2.0 * error:.2f} m (2 sigma), exceeds half of the plan's margin, "
            f"mission.task.margin_m = {margin:g}; valid: at most {0.25 * margin:.3f} m (1 "
            "sigma), such as 'rtk', or world.localisation = 'mocap'"
        )
