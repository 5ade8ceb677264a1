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

    def requirements(self, setup: Setup[SensorInstall], way: Any) -> dict[str, Requirement]:
        """Ask for no distance from the singularity in a pose that is at it."""
        asked = super().requirements(setup, way)
        return {
            k: v
            for k, v in asked.items()
            if not k.startswith("arm.lever") or setup.task.pose == "L"
        }
