"""The mission kind "flight-modes"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.flight_modes.task import ModesTask
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.missions.flight_modes.plan import ModesPlan
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class FlightModesKind(MissionKind[ModesTask, "ModesPlan"]):
    """Fly the three modes of a platform with tilted rotors."""

    task = ModesTask
    needs = frozenset({"uav", "whole_body"})

    @property
    def measures(self) -> Measures:
        from skywright.missions.flight_modes.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[ModesTask]) -> MissionPlan[ModesPlan]:
        from skywright.missions.flight_modes.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[ModesTask], way: ModesPlan) -> Flight:
        from skywright.missions.flight_modes.fly import fly

        return fly(s, way)

    def metrics(self, run: Flown[ModesTask, ModesPlan]) -> dict[str, float]:
        from skywright.missions.flight_modes.metrics import compute_modes_metrics

        return compute_modes_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.flight_modes.figures import FIGURES

        return FIGURES
