"""The mission kind "bar-transport"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.bar_transport.task import BarTransport
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class BarTransportKind(MissionKind[BarTransport, None]):
    """Carry a bar through structures with both hands."""

    task = BarTransport
    needs = frozenset({"uav", "arms", "whole_body"})
    held = True
    lands = False

    @property
    def measures(self) -> Measures:
        from skywright.missions.bar_transport.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[BarTransport]) -> MissionPlan[None]:
        from skywright.missions.bar_transport.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[BarTransport], way: None) -> Flight:
        from skywright.missions.bar_transport.fly import fly

        return fly(s)

    def metrics(self, run: Flown[BarTransport, None]) -> dict[str, float]:
        from skywright.missions.bar_transport.metrics import compute_transport_metrics

        return compute_transport_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.bar_transport.figures import FIGURES

        return FIGURES
