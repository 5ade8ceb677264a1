"""Time that a flight along a plan file takes in addition to its planned motion."""

from skywright.missions.follow_plan.fly import SETTLE_S, STEADY_S
from skywright.missions.follow_plan.task import FollowPlan
from skywright.missions.skills.planned_path import compute_path_added_s
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup


def compute_added_s(setup: Setup[FollowPlan], plan: MissionPlan[None]) -> float:
    """Return the time (s) in which the arms move to the first pose, of hover and of settling."""
    return compute_path_added_s(setup, plan, "plan", "folded", STEADY_S + SETTLE_S)
