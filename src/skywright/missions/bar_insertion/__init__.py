"""The mission kind "bar-insertion"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.bar_insertion.task import BarInsertion
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.missions.bar_insertion.plan import InsertionPlan
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class BarInsertionKind(MissionKind[BarInsertion, "InsertionPlan"]):
    """Put a peg below a bar, held by two hands, into a hole."""

    task = BarInsertion
    needs = frozenset({"uav", "hands"})

    @property
    def measures(self) -> Measures:
        from skywright.missions.bar_insertion.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[BarInsertion]) -> MissionPlan[InsertionPlan]:
        from skywright.missions.bar_insertion.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[BarInsertion], way: InsertionPlan) -> Flight:
        from skywright.missions.bar_insertion.fly import fly

        return fly(s, way)

    def metrics(self, run: Flown[BarInsertion, InsertionPlan]) -> dict[str, float]:
        from skywright.missions.bar_insertion.metrics import compute_insertion_metrics

        return compute_insertion_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.bar_insertion.figures import FIGURES

        return FIGURES
