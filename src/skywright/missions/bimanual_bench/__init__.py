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
    flies = False

    def requirements(self, setup: Setup[BimanualBench], way: Any) -> dict[str, Requirement]:
        """Ask nothing of trials that are not made."""
        left_out = tuple(
            name
            for trial, names in JUDGED_BY.items()
            if trial not in setup.task.trials
            for name in names
        )
        asked = super().requirements(setup, way)
        return {k: v for k, v in asked.items() if not k.startswith(left_out)}
