"""The mission kind "sensor-install"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.sensor_install.task import SensorInstall
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.missions.sensor_install.plan import InstallPlan
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class SensorInstallKind(MissionKind[SensorInstall, "InstallPlan"]):
    """Press a sensor on a pipe from below."""

    task = SensorInstall
    needs = frozenset({"uav", "hands"})

    @property
    def measures(self) -> Measures:
        from skywright.missions.sensor_install.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[SensorInstall]) -> MissionPlan[InstallPlan]:
        from skywright.missions.sensor_install.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[SensorInstall], way: InstallPlan) -> Flight:
        from skywright.missions.sensor_install.fly import fly

        return fly(s, way)

    def metrics(self, run: Flown[SensorInstall, InstallPlan]) -> dict[str, float]:
        from skywright.missions.sensor_install.metrics import compute_install_metrics

        return compute_install_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.sensor_install.figures import FIGURES

        return FIGURES
