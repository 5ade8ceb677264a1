"""The mission kind "arm-test-bench"."""

from skywright.missions.arm_test_bench.task import BenchTask
from skywright.run.folder_kind import FolderKind


class ArmTestBenchKind(FolderKind[BenchTask]):
    """Press a staircase of forces with the arm of a clamped platform."""

    task = BenchTask
    needs = frozenset({"arms", "whole_body", "probe"})
    flies = False
