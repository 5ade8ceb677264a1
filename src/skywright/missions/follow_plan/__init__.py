"""The mission kind "follow-plan"."""

from skywright.missions.follow_plan.task import FollowPlan
from skywright.run.flight import Flown
from skywright.run.folder_kind import FolderKind
from skywright.run.kind import Measures


class FollowPlanKind(FolderKind[FollowPlan]):
    """Fly a plan file, whoever planned it."""

    task = FollowPlan
    needs = frozenset({"uav"})
    lands = False

    @property
    def measures(self) -> Measures:
        from skywright.missions.bar_transport.metrics import MEASURES

        return MEASURES

    def metrics(self, run: Flown[FollowPlan, None]) -> dict[str, float]:
        from skywright.missions.bar_transport.metrics import compute_metrics

        return compute_metrics(run)
