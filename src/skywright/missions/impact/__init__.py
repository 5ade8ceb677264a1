"""The mission kind "impact"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.impact.task import Impact
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.missions.impact.plan import ImpactPlan
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class ImpactKind(MissionKind[Impact, "ImpactPlan"]):
    """Fly into something padded with hand or link."""

    task = Impact
    needs = frozenset({"uav"})

    @property
    def measures(self) -> Measures:
        from skywright.missions.impact.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[Impact]) -> MissionPlan[ImpactPlan]:
        from skywright.missions.impact.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[Impact], way: ImpactPlan) -> Flight:
        from skywright.missions.impact.fly import fly

        return fly(s, way)

    def metrics(self, run: Flown[Impact, ImpactPlan]) -> dict[str, float]:
        from skywright.missions.impact.metrics import compute_impact_metrics

        return compute_impact_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.impact.figures import FIGURES

        return FIGURES
