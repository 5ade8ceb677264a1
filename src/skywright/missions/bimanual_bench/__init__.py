"""The mission kind "bimanual-bench"."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.description.mission.spec import Requirement
from skywright.missions.bimanual_bench.task import JUDGED_BY, BimanualBench
from skywright.run.kind import Figures, Measures, MissionKind

if TYPE_CHECKING:
    from skywright.missions.bimanual_bench.plan import BenchPlan
    from skywright.run.flight import Flight, Flown
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor


class BimanualBenchKind(MissionKind[BimanualBench, "BenchPlan"]):
    """Trials of two compliant arms on a bench."""

    task = BimanualBench
    needs = frozenset({"hands"})
    flies = False

    @property
    def measures(self) -> Measures:
        from skywright.missions.bimanual_bench.metrics import MEASURES

        return MEASURES

    def plan(self, setup: Setup[BimanualBench]) -> MissionPlan[BenchPlan]:
        from skywright.missions.bimanual_bench.plan import plan

        return plan(setup)

    def fly(self, s: Supervisor[BimanualBench], way: BenchPlan) -> Flight:
        from skywright.missions.bimanual_bench.fly import fly

        return fly(s, way)

    def requirements(
        self, setup: Setup[BimanualBench], way: BenchPlan | None
    ) -> dict[str, Requirement]:
        """Ask nothing of trials that are not made."""
        left_out = tuple(
            name
            for trial, names in JUDGED_BY.items()
            if trial not in setup.task.trials
            for name in names
        )
        asked = super().requirements(setup, way)
        return {k: v for k, v in asked.items() if not k.startswith(left_out)}

    def metrics(self, run: Flown[BimanualBench, BenchPlan]) -> dict[str, float]:
        from skywright.missions.bimanual_bench.metrics import compute_bench_metrics

        return compute_bench_metrics(run)

    def figures(self) -> Figures:
        from skywright.missions.bimanual_bench.figures import FIGURES

        return FIGURES
