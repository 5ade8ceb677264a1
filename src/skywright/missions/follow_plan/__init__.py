"""The mission kind "follow-plan"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.follow_plan.task import FollowPlan
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class FollowPlanKind(MissionKind[FollowPlan, None]):
    """Fly a plan file, whoever planned it."""

    task = FollowPlan
    needs = frozenset({"uav"})
    lands = False

    @property
    def measures(self) -> Measures:
        from skywright.missions.bar_transport.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[FollowPlan]) -> MissionPlan[None]:
        from skywright.missions.follow_plan.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[FollowPlan], way: None) -> Flight:
        from skywright.missions.follow_plan.fly import fly

        return fly(s)

    def metrics(self, run: Flown[FollowPlan, None]) -> dict[str, float]:
        from skywright.missions.bar_transport.metrics import compute_transport_metrics

        return compute_transport_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.follow_plan.figures import FIGURES

        return FIGURES
