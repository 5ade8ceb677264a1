"""The mission kind "tool-install"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.tool_install.task import ToolInstall
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.missions.tool_install.plan import ToolPlan
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class ToolInstallKind(MissionKind[ToolInstall, "ToolPlan"]):
    """Put an inspection tool onto a pipe and take it back."""

    task = ToolInstall
    needs = frozenset({"uav", "hands"})
    operated = True

    @property
    def measures(self) -> Measures:
        from skywright.missions.tool_install.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[ToolInstall]) -> MissionPlan[ToolPlan]:
        from skywright.missions.tool_install.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[ToolInstall], way: ToolPlan) -> Flight:
        from skywright.missions.tool_install.fly import fly

        return fly(s, way)

    def withdraw(self, s: Supervisor[ToolInstall], way: ToolPlan) -> None:
        from skywright.missions.tool_install.fly import withdraw

        withdraw(s, way)

    def metrics(self, run: Flown[ToolInstall, ToolPlan]) -> dict[str, float]:
        from skywright.missions.tool_install.metrics import compute_tool_metrics

        return compute_tool_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.tool_install.figures import FIGURES

        return FIGURES
