"""The mission kind "bimanual-bench"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.description.mission.spec import Requirement
from skywright.missions.bimanual_bench.task import JUDGED_BY, BimanualBench
from skywright.run.folder_kind import FolderKind

if TYPE_CHECKING:
    from skywright.run.setup import Setup


class BimanualBenchKind(FolderKind[BimanualBench]):
    """Trials of two compliant arms on a bench."""

    task = BimanualBench
    needs = frozenset({"hands"})
    devices = frozenset({"bench"})
    flies = False

    def requirements(self, setup: Setup[BimanualBench], way: Any) -> dict[str, Requirement]:
        """Leave out the requirements of trials that the task omits."""
        task = setup.task
        left_out = {
            name: trial not in task.trials for trial, names in JUDGED_BY.items() for name in names
        }
        left_out["bench.drift_off"] = task.drift_m == 0.0
        return self.leave_out(super().requirements(setup, way), left_out)
