"""Missions that fly a plan file: loading of the file and checks before the flight."""

import itertools
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.loader import Description, Sets, load_description, split_assignments
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_limits
from skywright.errors import InputError
from skywright.models.geometry import compute_area_clearance, compute_clearance
from skywright.models.rigid_body import build_body_model, joint_names
from skywright.models.self_contact import find_self_contact
from skywright.planning.motion.plan_file import PlanFile, load_plan_file, name_files
from skywright.planning.motion.space import compute_reach
from skywright.planning.motion.transit import TOUCH_Q
from skywright.run.setup import Setup
from skywright.vehicle.drives import TURN_MAX

TOLERANCE = 0.05  # fraction by which a plan may exceed a robot's limit
NEAR_M, NEAR_RAD = 0.05, 0.05  # largest distance of the plan's start from the mission's
RESOLUTION = 0.005  # m, motion of a point between two poses that are checked for contact
PRECISION = 0.05  # fraction by which the smallest distance found may exceed the true one


def load_plan_description(
    file: str | os.PathLike[str],
    mission: str | os.PathLike[str] | None = None,
    robot: str | os.PathLike[str] | None = None,
    world: str | os.PathLike[str] | None = None,
    sets: Sets = (),
    seed: int | None = None,
) -> Description:
    """Load the mission that flies a plan file: `mission`, or by default "follow-plan".

    Without a mission, robot, world and start default to those of the plan; in the plan's world, so
    do random structures. Raises InputError if the file is no plan or belongs to another robot.
    """
    plan = load_plan_file(file)
    given = split_assignments(sets)
    more: dict[str, object] = {"mission.task.plan_file": str(Path(file).resolve())}
    if mission is None:
        x, y, z, yaw = (float(v) for v in plan.pose[0])
        more |= {
            "mission.start_x_m": x, "mission.start_y_m": y, "mission.hover_height_m": z,
            "mission.start_yaw_deg": math.degrees(yaw),
        }  # fmt: skip
        mission, robot, world = "follow-plan", robot or plan.robot, world or plan.world
    elif not hasattr(load_description(mission).mission.task, "plan_file"):
        raise InputError(
            f"mission {os.fspath(mission)!r} cannot fly a plan file; valid: bar-transport, "
            "follow-plan (used by --plan alone)"
        )
    d = load_description(mission, robot, world, {**more, **dict(given)}, seed)
    chosen = d.world.name != plan.world or "world.scenario_seed" in dict(given)
    if plan.scenario_seed is None or chosen:
        return d
    more |= {"world.scenario_seed": plan.scenario_seed, "world.difficulty": plan.difficulty}
    return load_description(mission, robot, world, {**more, **dict(given)}, seed)


def load_checked_plan(file: str, d: Description) -> PlanFile:
    """Load a plan file for a mission's robot and check it against limits and start.

    Raises InputError that states the violation.
    """
    robot = d.robot
    plan = load_plan_file(file, robot.name, joint_names(robot))
    _check_platform(file, plan, robot)
    _check_joints(file, plan, robot)
    m = d.mission
    start = np.array([m.start_x_m, m.start_y_m, m.hover_height_m])
    if float(np.linalg.norm(plan.pose[0, :3] - start)) > NEAR_M:
        p = ", ".join(f"{v:.2f}" for v in plan.pose[0, :3])
        raise InputError(
            f"{file}: the plan begins at ({p}) m, the mission hovers at "
            f"({start[0]:.2f}, {start[1]:.2f}, {start[2]:.2f}) m; set mission.start_x_m, start_y_m "
            "and hover_height_m"
        )
    yaw = math.degrees(plan.pose[0, 3])
    if math.radians(abs(math.remainder(yaw - m.start_yaw_deg, 360.0))) > NEAR_RAD:
        raise InputError(
            f"{file}: the plan begins with a heading of {yaw:.1f} deg, the mission with "
            f"{m.start_yaw_deg:g} deg; set mission.start_yaw_deg"
        )
    return plan


def _check_platform(file: str, plan: PlanFile, robot: Robot) -> None:
    """Raise InputError if the platform is faster, or accelerates more, than the robot may."""
    c, name = robot.control, robot.name
    v, a = plan.rate[:, :3], plan.acceleration[:, :3]
    speed = np.linalg.norm(v, axis=1)
    if np.max(speed) > (1.0 + TOLERANCE) * c.speed_max_mps:
        raise InputError(
            f"{_find_line(file, speed)}the speed of the plan is {np.max(speed):.2f} m/s; robot "
            f"{name!r} flies at most {c.speed_max_mps:g} m/s (control.speed_max_mps)"
        )
    turn = np.abs(plan.rate[:, 3])
    if np.max(turn) > (1.0 + TOLERANCE) * TURN_MAX:
        raise InputError(
            f"{_find_line(file, turn)}yaw_rate_rad_s is {np.max(turn):.2f} rad/s; valid: at most "
            f"{TURN_MAX:g} rad/s"
        )
    most = (1.0 + TOLERANCE) * c.acceleration_max_mps2
    stated = np.linalg.norm(a, axis=1)
    steps = np.diff(plan.t)
    change = np.linalg.norm(np.diff(v, axis=0), axis=1)
    mean = np.where(change > most * steps + 2e-3, change / steps, 0.0)  # 2 mm/s: rounded rows
    for what, found in (("its columns", stated), ("the step of its velocity", [0.0, *mean])):
        if np.max(found) > most:
            raise InputError(
                f"{_find_line(file, np.asarray(found))}the acceleration by {what} is "
                f"{np.max(found):.2f} m/s^2; robot {name!r} accelerates by at most "
                f"{c.acceleration_max_mps2:g} m/s^2 (control.acceleration_max_mps2)"
            )


def _check_joints(file: str, plan: PlanFile, robot: Robot) -> None:
    """Raise InputError if a joint leaves its range, or a servo is faster than without load."""
    model = build_body_model(robot)[0]
    n = len(plan.joints)
    speed = np.abs(plan.qd @ model["belt_inv"][:n, :n].T)
    for j, limb in enumerate(list_joints(robot)):
        if limb.servo < 0:
            continue
        low, high = limb.link.reach
        q, most = plan.q[:, j], float(model["motor_speed_max"][j])
        beyond = np.maximum(low - q, q - high)
        if np.max(beyond) > 1e-6:
            worst = round(float(q[np.argmax(beyond)]), 4)
            raise InputError(
                f"{_find_line(file, beyond)}{limb.name} goes to {limb.link.describe(worst)}; its "
                f"range is {limb.link.describe(low)} to {limb.link.describe(high)}"
            )
        if np.max(speed[:, j]) > most:
            unit = "m/s" if limb.link.joint == "slide" else "rad/s"
            raise InputError(
                f"{_find_line(file, speed[:, j])}the servo of {limb.name} moves at "
                f"{np.max(speed[:, j]):.2f} {unit}; without load it moves at {most:g} {unit} "
                "(no_load_speed_rad_s)"
            )


def _find_line(file: str, values: Array) -> str:
    """Return "FILE: line N, " of the row with the largest of the values (m,)."""
    return f"{name_files(file)[0]}: line {int(np.argmax(values)) + 2}, "


def find_closest(plan: PlanFile, setup: Setup[Any]) -> tuple[float, str]:
    """Return the smallest distance (m) of the planned motion to the world, and between what.

    The limits of the world's area count. Between rows the platform's position and all angles are
    linear, as in flight. Two poses are halved until no point of the robot moves by more than
    `RESOLUTION` between them, unless the distances at both exclude contact and one that is smaller
    by more than `PRECISION`: a distance changes at most by as much as the points move. Parts of the
    robot that touch count as a distance of 0.
    """
    scene, query = setup.planning_scene, setup.clearance
    limits = get_limits(setup.world)
    reach = float(np.max(compute_reach(scene.tree, scene.robot)[0] + scene.robot.radius))
    rows = np.column_stack([plan.pose, plan.q])
    best = (math.inf, "")

    def measure(t: float, row: Array) -> float:
        nonlocal best
        found = compute_clearance(query, row[:3], rot_z(float(row[3])), row[4:])
        room = math.inf if limits is None else compute_area_clearance(query, setup.scene, limits)
        distance = min(found.distance, room)
        if distance < best[0]:
            names = [query.names[g] for g in (found.robot_geom, found.other_geom) if g >= 0]
            if room < found.distance:
                names = ["the robot", "the limits of world.area"]
            best = distance, f"{' and '.join(names)} at t = {t:.2f} s"
        return distance

    ways = [measure(t, row) for t, row in zip(plan.t, rows, strict=True)]
    spans = [
        (*two, *at, *distances)
        for two, at, distances in zip(
            itertools.pairwise(plan.t), itertools.pairwise(rows), itertools.pairwise(ways),
            strict=True,
        )
    ]  # fmt: skip
    while spans:
        t0, t1, a, b, d0, d1 = spans.pop()
        moved = float(np.linalg.norm(b[:3] - a[:3]) + reach * np.sum(np.abs(b[3:] - a[3:])))
        smallest = 0.5 * (d0 + d1 - moved)  # that the span may have
        if moved <= RESOLUTION or smallest >= min(best[0], (1.0 - PRECISION) * best[0]):
            continue
        t, row = 0.5 * (t0 + t1), 0.5 * (a + b)
        d = measure(t, row)
        spans += [(t0, t, a, row, d0, d), (t, t1, row, b, d, d1)]
    touch = _find_own_contact(plan, setup) if best[0] > 0.0 else ""
    return (0.0, touch) if touch else best


def _find_own_contact(plan: PlanFile, setup: Setup[Any]) -> str:
    """Return "NAME and NAME at t = T s" of parts of the robot that touch, "" if none do.

    The postures checked are `TOUCH_Q` apart in the sum of the joints' motions.
    """
    if not plan.joints:
        return ""
    steps = np.sum(np.abs(np.diff(plan.q, axis=0)), axis=1)
    turned = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, turned[-1], math.ceil(turned[-1] / TOUCH_Q) + 1)
    q = np.column_stack([np.interp(at, turned, joint) for joint in plan.q.T])
    contacts = setup.planning_scene.contacts
    touch = find_self_contact(contacts, q)
    if not touch:
        return ""
    first = next(i for i, row in enumerate(q) if find_self_contact(contacts, row[None]))
    return f"{touch} at t = {np.interp(at[first], turned, plan.t):.2f} s"
