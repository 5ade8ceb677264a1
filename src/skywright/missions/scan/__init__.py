"""The mission kind "scan"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.scan.task import Scan
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.inspection.weld import WeldResult
    from skywright.missions.scan.plan import ScanWay
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class ScanKind(MissionKind[Scan, "ScanWay"]):
    """Slide a probe along a pattern on a pipe and find the weld."""

    task = Scan
    needs = frozenset({"uav", "whole_body", "probe"})

    @property
    def measures(self) -> Measures:
        from skywright.missions.scan.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[Scan]) -> MissionPlan[ScanWay]:
        from skywright.missions.scan.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[Scan], way: ScanWay) -> Flight:
        from skywright.missions.scan.fly import fly

        return fly(s, way)

    def metrics(self, run: Flown[Scan, ScanWay]) -> dict[str, float]:
        from skywright.missions.scan.metrics import compute_scan_metrics

        return compute_scan_metrics(run)

    def result(self, run: Flown[Scan, ScanWay]) -> WeldResult | None:
        from skywright.missions.scan.metrics import process_weld

        return run.once(process_weld)

    def figures(self) -> Figures:
        from skywright.missions.scan.figures import FIGURES

        return FIGURES
