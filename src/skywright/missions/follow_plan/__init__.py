"""The mission kind "follow-plan"."""

from skywright.missions.follow_plan.task import FollowPlan
from skywright.run.folder_kind import FolderKind


class FollowPlanKind(FolderKind[FollowPlan]):
    """Fly a plan file from any planner."""

    task = FollowPlan
    needs = frozenset({"uav"})
    lands = False
