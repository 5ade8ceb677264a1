"""Dispatches a plan file to a vehicle: way-points of the platform and joint references at 50 Hz.

As in Caballero 2018, section IV: the platform and the arms receive the planner's file as commands,
`set_pose` with its velocity and `set_joints`, on any back end that offers them.
"""

from __future__ import annotations

import os

import numpy as np

from skywright.core.arrays import Array
from skywright.errors import InputError
from skywright.models.rigid_body import joint_names
from skywright.planning.motion.plan_file import PlanFile, load_plan_file
from skywright.vehicle.commands import State
from skywright.vehicle.results import Result
from skywright.vehicle.uav import Uav

TICK = 0.02  # s


def dispatch_plan(uav: Uav, file: str | os.PathLike[str]) -> Result:
    """Fly to a plan's first row, follow the plan, and stop at its last row; returns the result.

    Raises InputError if the file is not a plan, or is a plan for another robot.
    """
    b = uav.backend
    plan = load_plan_file(file, b.robot.name, joint_names(b.robot))
    speed = float(np.max(np.linalg.norm(plan.rate[:, :3], axis=1)))
    if speed > b.limits.speed * 1.05:
        raise InputError(
            f"{os.fspath(file)}: the speed of the plan is {speed:.2f} m/s; the vehicle flies at "
            f"most {b.limits.speed:g} m/s"
        )
    result = uav.go_to(plan.pose[0, :3], plan.pose[0, 3], wait=True).result
    if result and plan.joints:
        result = uav.start_joints(plan.q[0])
    if not result:
        assert result is not None
        return result._replace(reason=f"on the way to the plan's start: {result.reason}")
    start = b.t
    while b.t - start < plan.t[-1] - 1e-9:
        result = _tell(uav, plan, b.t - start + TICK)
        if result:
            uav.tick()
        if not result or uav.state != State.FLYING_AUTO:
            why = result.reason or f"the state is {uav.state}"
            return Result(False, f"plan left at {b.t - start:.2f} s: {why}", b.t)
    result = uav.go_to(plan.pose[-1, :3], plan.pose[-1, 3], wait=True).result
    assert result is not None
    return result


def _tell(uav: Uav, plan: PlanFile, t: float) -> Result:
    """Send the references at time t (s); returns the first refusal."""
    pose, rate = _at(plan.t, plan.pose, t), _at(plan.t, plan.rate, t)
    result = uav.set_pose(pose[:3], float(pose[3]), rate[:3], float(rate[3])).result
    if result and plan.joints:
        result = uav.set_joints(_at(plan.t, plan.q, t)).result
    assert result is not None
    return result


def _at(t: Array, rows: Array, now: float) -> Array:
    """Interpolate rows (m, k) at a time (s)."""
    return np.array([np.interp(now, t, column) for column in rows.T])
