"""The mission kind "scan"."""

from typing import Any

from skywright.missions.scan.task import Scan
from skywright.run.flight import Flown
from skywright.run.folder_kind import FolderKind


class ScanKind(FolderKind[Scan]):
    """Slide a probe along a pattern on a pipe and find the weld."""

    task = Scan
    needs = frozenset({"uav", "whole_body", "probe"})

    def result(self, run: Flown[Scan, Any]) -> object:
        from skywright.missions.scan.metrics import process_weld

        return run.once(process_weld)
