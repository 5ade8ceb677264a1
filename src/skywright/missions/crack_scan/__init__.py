"""The mission kind "crack-scan"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.missions.crack_scan.task import CrackScan
from skywright.run.folder_kind import FolderKind
from skywright.run.inspected import Inspected

if TYPE_CHECKING:
    from skywright.inspection.history.entries import Entries, Procedure
    from skywright.run.flight import Flown
    from skywright.run.setup import Setup


class CrackScanKind(FolderKind[CrackScan]):
    """Slide an eddy-current array over a pipe and report cracks."""

    task = CrackScan
    needs = frozenset({"uav", "whole_body", "probe"})

    def result(self, run: Flown[CrackScan, Any]) -> object:
        from skywright.missions.crack_scan.search import find_search

        return run.once(find_search)

    def describe(self, run: Flown[CrackScan, Any]) -> dict[str, Any]:
        from skywright.missions.crack_scan.search import describe_search, find_search

        found = run.once(find_search)
        return {} if found is None else describe_search(run, found)

    def inspected(self, run: Flown[CrackScan, Any]) -> Inspected:
        from skywright.missions.crack_scan.judge import find_inspected

        return find_inspected(run)

    def entries(self, run: Flown[CrackScan, Any]) -> Entries:
        from skywright.missions.crack_scan.entries import build_entries

        return build_entries(run)

    def procedure(self, setup: Setup[CrackScan]) -> Procedure:
        from skywright.missions.crack_scan.entries import build_procedure

        return build_procedure(setup)
