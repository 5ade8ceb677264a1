"""A kind of mission that is a folder: its modules are found by their names."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from skywright.description.mission.spec import T
from skywright.run.flight import Flight, Flown
from skywright.run.kind import Figures, Measures, MissionKind
from skywright.run.metrics import compute_tracking

if TYPE_CHECKING:
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor
    from skywright.run.where import Where


class FolderKind(MissionKind[T, Any]):
    """A kind whose folder has `plan.py`, `fly.py`, `metrics.py` and `figures.py`.

    They define `plan(setup)`, `fly(s, way)` and optionally `withdraw(s, way)`,
    `compute_metrics(run)` with `MEASURES`, and `FIGURES`. They are imported when first needed. A
    folder without metrics is evaluated by its path tracking. An optional `duration.py` defines
    `compute_added_s(setup, plan)`.
    """

    @property
    def measures(self) -> Measures:
        return self._part("metrics").MEASURES if self._has_metrics else {}

    @property
    def where(self) -> Mapping[str, Where]:
        return self._part("metrics").WHERE if self._has_metrics else {}

    def plan(self, setup: Setup[T]) -> MissionPlan[Any]:
        return self._part("plan").plan(setup)

    def compute_added_s(self, setup: Setup[T], plan: MissionPlan[Any]) -> float:
        if not self._has("duration"):
            return super().compute_added_s(setup, plan)
        return float(self._part("duration").compute_added_s(setup, plan))

    def fly(self, s: Supervisor[T], way: Any) -> Flight:
        return self._part("fly").fly(s, way)

    def withdraw(self, s: Supervisor[T], way: Any) -> None:
        own = getattr(self._part("fly"), "withdraw", None)
        if own is None:
            super().withdraw(s, way)
        else:
            own(s, way)

    def metrics(self, run: Flown[T, Any]) -> dict[str, float]:
        if self._has_metrics:
            return self._part("metrics").compute_metrics(run)
        return compute_tracking(run)

    def figures(self) -> Figures:
        return self._part("figures").FIGURES

    @property
    def _has_metrics(self) -> bool:
        return self._has("metrics")

    def _has(self, name: str) -> bool:
        return find_spec(f"{self.__module__}.{name}") is not None

    def _part(self, name: str) -> Any:
        return import_module(f"{self.__module__}.{name}")
