"""The mission kind "tool-install"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.description.mission.spec import Requirement
from skywright.missions.tool_install.task import ToolInstall
from skywright.run.folder_kind import FolderKind

if TYPE_CHECKING:
    from skywright.run.setup import Setup


class ToolInstallKind(FolderKind[ToolInstall]):
    """Install an inspection tool on a pipe and retrieve it."""

    task = ToolInstall
    needs = frozenset({"uav", "hands"})
    devices = frozenset({"surveyor"})
    operated = True

    def requirements(self, setup: Setup[ToolInstall], way: Any) -> dict[str, Requirement]:
        """Leave out the requirements on the tracking of grasp points if the task omits it."""
        left_out = {"tip.hover": setup.task.hover_s == 0.0}
        return self.leave_out(super().requirements(setup, way), left_out)
