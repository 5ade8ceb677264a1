"""Fly a plan file of platform and joints through the vehicle layer, whoever planned it."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, NamedTuple

from skywright.description.loader import Description
from skywright.errors import InputError
from skywright.missions.follow_plan.task import FollowPlanMission
from skywright.missions.skills.plan_flight import find_closest, load_checked_plan
from skywright.models.rigid_body import build_body_model
from skywright.planning.motion.plan_file import PlanFile
from skywright.run.flight import Flight
from skywright.run.planning import MissionPlan
from skywright.vehicle.plan_table import build_plan_table

if TYPE_CHECKING:
    from skywright.run.supervisor import Supervisor

NEEDS = frozenset({"uav"})
LANDS = False

STEADY_S = 3.0  # s, of hovering before the plan
SETTLE_S = 2.0  # s, at its end


class FollowedPlan(NamedTuple):
    """What the mission keeps of the file."""

    file: PlanFile


def plan(d: Description) -> MissionPlan:
    """Read and check the file; a plan that touches something is refused."""
    assert isinstance(d.mission, FollowPlanMission)
    began = time.perf_counter()
    file = d.mission.task.plan_file
    if not file:
        raise InputError(
            "mission.task.plan_file is empty: name a plan file, or `skywright run --plan FILE`"
        )
    found = load_checked_plan(file, d)
    clearance, what = find_closest(found, d)
    table = build_plan_table(found, build_body_model(d.robot, d.world.gravity_mps2))
    blocked = None if clearance > 0.0 else f"{file}: {what} touch"
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began, float(found.t[-1]), clearance,
        math.nan, {"plan": table}, None, 0.0, 0.0, FollowedPlan(found),
    )  # fmt: skip


def fly(s: Supervisor) -> Flight:
    """Take the plan's first pose, follow it, settle. The flight ends hovering there."""
    table = s.plan.segments["plan"]
    n = s.vehicle.n_joints
    if n:
        s.begin("start pose")
        s.arms.move_to(table[0]["q"][:n])
        s.until_arrived()
    s.body.track(table[:1])
    s.wait(STEADY_S)
    s.begin("plan")
    s.body.track(table)
    s.until_arrived()
    s.begin("settle")
    s.wait(SETTLE_S)
    return Flight(True, "")
