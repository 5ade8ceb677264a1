"""The mission kind "excitation"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.excitation.task import ExcitationTask
from skywright.run.kind import Figures, MissionKind

if TYPE_CHECKING:
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class ExcitationKind(MissionKind[ExcitationTask, None]):
    """Shake the robot, so that its parameters can be identified."""

    task = ExcitationTask
    needs = frozenset({"uav"})

    def plan(self, setup: Setup[ExcitationTask]) -> MissionPlan[None]:
        from skywright.missions.excitation.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[ExcitationTask], way: None) -> Flight:
        from skywright.missions.excitation.fly import fly

        return fly(s)

    def metrics(self, run: Flown[ExcitationTask, None]) -> dict[str, float]:
        from skywright.run.metrics import compute_tracking

        return compute_tracking(run)

    def figures(self) -> Figures:
        from skywright.missions.excitation.figures import FIGURES

        return FIGURES
