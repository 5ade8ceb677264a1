"""The mission kind "scan"."""

from typing import Any

from skywright.inspection.history.entries import Entries
from skywright.missions.scan.task import Scan
from skywright.run.flight import Flown
from skywright.run.folder_kind import FolderKind
from skywright.run.inspected import Inspected


class ScanKind(FolderKind[Scan]):
    """Slide a probe along a pattern on a pipe and find the weld."""

    task = Scan
    needs = frozenset({"uav", "whole_body", "probe"})

    def result(self, run: Flown[Scan, Any]) -> object:
        from skywright.missions.scan.metrics import process_weld

        return run.once(process_weld)

    def describe(self, run: Flown[Scan, Any]) -> dict[str, Any]:
        from skywright.inspection.weld_data import describe_welds
        from skywright.missions.scan.coverage import describe_coverage
        from skywright.missions.scan.metrics import find_coverage, process_weld

        weld, coverage = run.once(process_weld), run.once(find_coverage)
        welds = describe_welds(weld) if weld is not None else {}
        return welds | (describe_coverage(coverage) if coverage is not None else {})

    def inspected(self, run: Flown[Scan, Any]) -> Inspected:
        from skywright.missions.scan.inspected import find_inspected

        return find_inspected(run)

    def entries(self, run: Flown[Scan, Any]) -> Entries:
        from skywright.missions.scan.entries import build_entries

        return build_entries(run)

    def list_waived(self, metrics: dict[str, float]) -> dict[str, str]:
        from skywright.missions.scan.welds import list_waived

        return list_waived(metrics)
