"""Time that a transport takes in addition to its planned motion."""

from skywright.missions.bar_transport.fly import SETTLE_S, STEADY_S
from skywright.missions.bar_transport.task import BarTransport
from skywright.models.rigid_body import posture
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.vehicle.arms_interface import compute_joints_s


def compute_added_s(setup: Setup[BarTransport], plan: MissionPlan[None]) -> float:
    """Return the time (s) in which the arms move to the first pose, of hover and of settling."""
    rest = posture(setup.robot, "working")
    table = plan.segments["transport"]
    move = compute_joints_s(table[0]["q"][: len(rest)] - rest)
    led = float(table["t"][-1]) - plan.duration_s  # a table for a swinging link is longer
    return move + STEADY_S + led + SETTLE_S
