"""Missions that fly a plan file: loading of the file and checks before the flight."""

import math
import os
from pathlib import Path

import numpy as np

from skywright.core.rotations import rot_z
from skywright.description.loader import Description, Sets, load_description, split_assignments
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.geometry import ClearanceQuery, compute_clearance
from skywright.models.rigid_body import joint_names
from skywright.planning.motion.plan_file import PlanFile, load_plan_file

TOLERANCE = 0.05  # fraction by which a plan may exceed a robot's limit
NEAR_M, NEAR_RAD = 0.05, 0.05  # largest distance of the plan's start from the mission's


def load_plan_description(
    file: str | os.PathLike[str],
    mission: str | os.PathLike[str] | None = None,
    robot: str | os.PathLike[str] | None = None,
    world: str | os.PathLike[str] | None = None,
    sets: Sets = (),
    seed: int | None = None,
) -> Description:
    """Load the mission that flies a plan file: `mission`, or by default "follow-plan".

    Without a mission, robot, world and start default to those of the plan. Raises InputError if the
    file is no plan or belongs to another robot.
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
    return load_description(mission, robot, world, {**more, **dict(given)}, seed)


def load_checked_plan(file: str, d: Description) -> PlanFile:
    """Load a plan file for a mission's robot and check it against limits and start.

    Raises InputError that states the violation.
    """
    robot = d.robot
    plan = load_plan_file(file, robot.name, joint_names(robot))
    _check_limits(file, plan, robot)
    m = d.mission
    start = np.array([m.start_x_m, m.start_y_m, m.hover_height_m])
    if float(np.linalg.norm(plan.pose[0, :3] - start)) > NEAR_M:
        p = ", ".join(f"{v:.2f}" for v in plan.pose[0, :3])
        raise InputError(
            f"{file}: the plan begins at ({p}) m, the mission hovers at "
            f"({start[0]:.2f}, {start[1]:.2f}, {start[2]:.2f}) m; set mission.start_x_m, start_y_m "
            "and hover_height_m"
        )
    return plan


def _check_limits(file: str, plan: PlanFile, robot: Robot) -> None:
    c = robot.control
    speed = float(np.max(np.linalg.norm(plan.rate[:, :3], axis=1)))
    if speed > (1.0 + TOLERANCE) * c.speed_max_mps:
        raise InputError(
            f"{file}: the speed of the plan is {speed:.2f} m/s; robot {robot.name!r} flies "
            f"at most {c.speed_max_mps:g} m/s (control.speed_max_mps)"
        )
    for j, limb in enumerate(list_joints(robot)):
        if limb.servo < 0:
            continue
        low, high = limb.link.reach
        q = plan.q[:, j]
        if np.min(q) < low - 1e-6 or np.max(q) > high + 1e-6:
            worst = float(np.min(q) if np.min(q) < low - 1e-6 else np.max(q))
            raise InputError(
                f"{file}: {limb.name} goes to {limb.link.describe(round(worst, 4))}; its range "
                f"is {limb.link.describe(low)} to {limb.link.describe(high)}"
            )


def find_closest(plan: PlanFile, query: ClearanceQuery) -> tuple[float, str]:
    """Return the smallest distance (m) of the planned poses to the world, and between what.

    Every row is checked; rows of a plan lie millimetres apart.
    """
    least, what = math.inf, ""
    for t, pose, q in zip(plan.t, plan.pose, plan.q, strict=True):
        found = compute_clearance(query, pose[:3], rot_z(float(pose[3])), q)
        if found.distance < least:
            least = found.distance
            names = [query.names[g] for g in (found.robot_geom, found.other_geom) if g >= 0]
            what = f"{' and '.join(names)} at t = {t:.2f} s"
    return least, what
