"""Fly one planned segment of platform and arms from its first pose, and its duration."""

from typing import Any

from skywright.models.rigid_body import posture
from skywright.run.flight import Flight
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor
from skywright.vehicle.arms_interface import compute_joints_s


def fly_path(s: Supervisor[Any], name: str, steady_s: float, settle_s: float) -> Flight:
    """Bring the arms to the segment's first pose, hover `steady_s` (s), follow it, and settle."""
    table = s.segments[name]
    n = s.vehicle.n_joints
    if n:
        s.begin("start pose")
        s.arms.move_to(table[0]["q"][:n])
        s.until_arrived()
    s.body.track(table[:1])
    s.wait(steady_s)
    s.begin(name)
    s.body.track(table)
    s.until_arrived()
    s.begin("settle")
    s.wait(settle_s)
    return Flight(True, "")


def compute_path_added_s(
    setup: Setup[Any], plan: MissionPlan[Any], name: str, start: str, rests_s: float
) -> float:
    """Return the time (s) that `fly_path` adds to a plan's duration.

    The arms begin in the posture `start`; `rests_s` (s) is the sum of its two rests.
    """
    rest = posture(setup.robot, start)
    table = plan.segments[name]
    move = compute_joints_s(table[0]["q"][: len(rest)] - rest)
    led = float(table["t"][-1]) - plan.duration_s  # a table for a swinging link is longer
    return move + led + rests_s
