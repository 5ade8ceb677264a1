"""The mission kind "impact"."""

from skywright.missions.impact.task import Impact
from skywright.run.folder_kind import FolderKind


class ImpactKind(FolderKind[Impact]):
    """Fly into a padded obstacle with hand or link."""

    task = Impact
    needs = frozenset({"uav", "dynamics"})
    devices = frozenset({"gauges"})
