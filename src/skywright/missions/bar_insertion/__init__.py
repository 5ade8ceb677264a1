"""The mission kind "bar-insertion"."""

from skywright.missions.bar_insertion.task import BarInsertion
from skywright.run.folder_kind import FolderKind


class BarInsertionKind(FolderKind[BarInsertion]):
    """Insert a peg below a bar, held by two hands, into a hole."""

    task = BarInsertion
    needs = frozenset({"uav", "hands"})
    devices = frozenset({"surveyor"})
    operated = True
