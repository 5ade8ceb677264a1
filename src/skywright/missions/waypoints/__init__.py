"""The mission kind "waypoints"."""

from skywright.missions.waypoints.task import Waypoints
from skywright.run.folder_kind import FolderKind


class WaypointsKind(FolderKind[Waypoints]):
    """Fly through way-points."""

    task = Waypoints
    needs = frozenset({"uav"})
