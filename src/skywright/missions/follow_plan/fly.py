"""Fly a plan file of platform and joints, from any planner, through the vehicle layer."""

from skywright.missions.follow_plan.task import FollowPlan
from skywright.run.flight import Flight
from skywright.run.supervisor import Supervisor

STEADY_S = 3.0  # s, of hover before the plan
SETTLE_S = 2.0  # s, at its end


def fly(s: Supervisor[FollowPlan], way: None) -> Flight:
    """Move to the plan's first pose, follow the plan, settle. The flight ends in hover there."""
    table = s.segments["plan"]
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
