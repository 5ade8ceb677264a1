"""Fly a plan file of platform and joints, from any planner, through the vehicle layer."""

from skywright.missions.follow_plan.task import FollowPlan
from skywright.missions.skills.planned_path import fly_path
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

STEADY_S = 3.0  # s, of hover before the plan
SETTLE_S = 2.0  # s, at its end


def fly(s: Supervisor[FollowPlan], way: None) -> Flight:
    """Move to the plan's first pose, follow the plan, settle. The flight ends in hover there."""
    return fly_path(s, "plan", STEADY_S, SETTLE_S)
