"""The mission kind "excitation"."""

from skywright.missions.excitation.task import ExcitationTask
from skywright.run.folder_kind import FolderKind


class ExcitationKind(FolderKind[ExcitationTask]):
    """Excite the robot's dynamics, so that its parameters can be identified."""

    task = ExcitationTask
    needs = frozenset({"uav", "dynamics"})
