"""The mission kind "sensor-install"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.description.mission.spec import Requirement
from skywright.missions.sensor_install.task import SensorInstall
from skywright.run.folder_kind import FolderKind

if TYPE_CHECKING:
    from skywright.run.setup import Setup


class SensorInstallKind(FolderKind[SensorInstall]):
    """Press a sensor on a pipe from below."""

    task = SensorInstall
    needs = frozenset({"uav", "hands"})
    devices = frozenset({"helper"})
    operated = True

    def requirements(self, setup: Setup[SensorInstall], way: Any) -> dict[str, Requirement]:
        """Leave out the requirements of checks that the task omits.

        In a pose at the singularity, leave out the requirement on the distance from it.
        """
        task, pendulum = setup.task, setup.robot.pendulum
        left_out = {
            "arm.lever": task.pose != "L",
            "tip.hover": task.hover_s == 0.0,
            "swing.": task.swing_deg == 0.0 or pendulum is None,
        }
        return self.leave_out(super().requirements(setup, way), left_out)

    def list_waived(self, metrics: dict[str, float]) -> dict[str, str]:
        """Waive the requirements on the force control if an operator controlled the force."""
        waived = super().list_waived(metrics)
        if "operator.time_s" in metrics:
            why = "an operator led the force"
            waived |= dict.fromkeys(("force.mean_error_n", "force.rms_error_n"), why)
        return waived
