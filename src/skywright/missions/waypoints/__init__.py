"""The mission kind "waypoints"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.waypoints.task import Waypoints
from skywright.run.kind import Figures, MissionKind

if TYPE_CHECKING:
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class WaypointsKind(MissionKind[Waypoints, None]):
    """Fly through way-points."""

    task = Waypoints
    needs = frozenset({"uav"})

    def plan(self, setup: Setup[Waypoints]) -> MissionPlan[None]:
        from skywright.missions.waypoints.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[Waypoints], way: None) -> Flight:
        from skywright.missions.waypoints.fly import fly

        return fly(s)

    def metrics(self, run: Flown[Waypoints, None]) -> dict[str, float]:
        from skywright.run.metrics import compute_tracking

        return compute_tracking(run)

    def figures(self) -> Figures:
        from skywright.missions.waypoints.figures import FIGURES

        return FIGURES
