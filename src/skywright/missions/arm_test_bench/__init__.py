"""The mission kind "arm-test-bench"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.missions.arm_test_bench.task import BenchTask
from skywright.run.kind import Figures, MissionKind

if TYPE_CHECKING:
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class ArmTestBenchKind(MissionKind[BenchTask, None]):
    """Press up a staircase of forces with the arm of a clamped platform."""

    task = BenchTask
    needs = frozenset({"arms", "whole_body", "probe"})
    flies = False

    def plan(self, setup: Setup[BenchTask]) -> MissionPlan[None]:
        from skywright.missions.arm_test_bench.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[BenchTask], way: None) -> Flight:
        from skywright.missions.arm_test_bench.fly import fly

        return fly(s)

    def metrics(self, run: Flown[BenchTask, None]) -> dict[str, float]:
        from skywright.missions.bridge_contact.metrics import compute_bench_metrics

        return compute_bench_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.bridge_contact.figures import FIGURES

        return FIGURES
