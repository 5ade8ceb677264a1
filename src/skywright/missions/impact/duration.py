"""Time that an impact takes in addition to its planned motion."""

from skywright.missions.impact.fly import CALM_S
from skywright.missions.impact.plan import RECOIL_S, REST_S, ImpactPlan
from skywright.missions.impact.task import Impact
from skywright.models.rigid_body import posture
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.vehicle.arms_interface import compute_joints_s


def compute_added_s(setup: Setup[Impact], plan: MissionPlan[ImpactPlan]) -> float:
    """Return the time (s) in which the arms move to their pose, and of rests."""
    pose = compute_joints_s(plan.get_way().q - posture(setup.robot, "folded"))
    return pose + CALM_S + RECOIL_S + REST_S
