"""The mission kind "tool-install"."""

from skywright.missions.tool_install.task import ToolInstall
from skywright.run.folder_kind import FolderKind


class ToolInstallKind(FolderKind[ToolInstall]):
    """Put an inspection tool onto a pipe and take it back."""

    task = ToolInstall
    needs = frozenset({"uav", "hands"})
    operated = True
