"""Figures of a report on a flight along a plan file: only those of any flight."""

from skywright.missions.follow_plan.task import FollowPlan
from skywright.reports.explain import format_value
from skywright.run.kind import Figures
from skywright.run.result import RunResult


def describe(result: RunResult[FollowPlan, None]) -> str:
    """Return a sentence on the flight."""
    d = result.description
    seconds = format_value(result.metrics.get("transport.duration_s"))
    return f"{d.robot.name} in world {d.world.name} followed a plan for {seconds} s"


FIGURES = Figures(
    describe,
    phases={
        "start pose": "The arms move to their first posture of the plan; the robot hovers.",
        "plan": "Platform and arms follow the plan.",
        "settle": "The robot hovers at the end of the plan.",
    },
)
