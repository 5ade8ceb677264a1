"""The mission kind "flight-modes"."""

from skywright.missions.flight_modes.task import ModesTask
from skywright.run.folder_kind import FolderKind


class FlightModesKind(FolderKind[ModesTask]):
    """Fly the three modes of a platform with tilted rotors."""

    task = ModesTask
    needs = frozenset({"uav", "whole_body", "dynamics"})
