"""The mission kind "arm-test-bench"."""

from skywright.missions.arm_test_bench.task import BenchTask
from skywright.run.flight import Flown
from skywright.run.folder_kind import FolderKind
from skywright.run.kind import Figures


class ArmTestBenchKind(FolderKind[BenchTask]):
    """Press up a staircase of forces with the arm of a clamped platform."""

    task = BenchTask
    needs = frozenset({"arms", "whole_body", "probe"})
    flies = False

    def metrics(self, run: Flown[BenchTask, None]) -> dict[str, float]:
        from skywright.missions.bridge_contact.metrics import compute_bench_metrics

        return compute_bench_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.bridge_contact.figures import FIGURES

        return FIGURES
