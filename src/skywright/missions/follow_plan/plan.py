"""Fly a plan file of platform and joints, from any planner, through the vehicle layer."""

import time

from skywright.errors import InputError
from skywright.missions.follow_plan.task import FollowPlan
from skywright.missions.skills.plan_flight import find_closest, load_checked_plan
from skywright.missions.skills.plan_table import build_plan_table
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def plan(setup: Setup[FollowPlan]) -> MissionPlan[None]:
    """Load and check the file; a plan with contact is refused."""
    began = time.perf_counter()
    d, file = setup.description, setup.task.plan_file
    if not file:
        raise InputError(
            "mission.task.plan_file is empty: name a plan file, or `skywright run --plan FILE`"
        )
    found = load_checked_plan(file, d)
    clearance, what = find_closest(found, setup)
    table = build_plan_table(found, setup.model)
    blocked = None if clearance > 0.0 else f"{file}: {what} touch"
    return MissionPlan(
        blocked is None, blocked, time.perf_counter() - began, float(found.t[-1]), clearance,
        segments={"plan": table}, file=found,
    )  # fmt: skip
