"""The mission kind "sensor-install"."""

from skywright.missions.sensor_install.task import SensorInstall
from skywright.run.folder_kind import FolderKind


class SensorInstallKind(FolderKind[SensorInstall]):
    """Press a sensor on a pipe from below."""

    task = SensorInstall
    needs = frozenset({"uav", "hands"})
