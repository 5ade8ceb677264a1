"""What a mission of the kind "follow-plan" may say."""

from __future__ import annotations

from skywright.core.spec import Spec
from skywright.description.mission.spec import Mission


class FollowPlan(Spec):
    """Fly a plan file as it is; the flight starts over its first row."""

    plan_file: str = ""  # NAME.csv or NAME.toml, see docs/howto/plan-a-transport.md


class FollowPlanMission(Mission):
    """A mission of the kind "follow-plan"."""

    task: FollowPlan = FollowPlan()
