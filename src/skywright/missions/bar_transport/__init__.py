"""The mission kind "bar-transport"."""

from skywright.missions.bar_transport.task import BarTransport
from skywright.run.folder_kind import FolderKind


class BarTransportKind(FolderKind[BarTransport]):
    """Carry a bar through structures with both hands."""

    task = BarTransport
    needs = frozenset({"uav", "arms", "whole_body"})
    held = True
    lands = False
