"""Records of how a mission was flown."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from numpy.typing import NDArray

from skywright.description.mission.spec import T
from skywright.run.faults._rule import Acted
from skywright.run.kind import P

if TYPE_CHECKING:
    from skywright.run.planning import MissionPlan
    from skywright.run.setup import Setup

Samples = NDArray[Any]
R = TypeVar("R")

NO_TAKE_OFF = "no take-off: "
"""Beginning of the reason of a flight that ended on the ground, before it took off."""


class PhaseRecord(NamedTuple):
    """One phase as it was flown."""

    name: str
    start_s: float
    end_s: float
    outcome: str
    """ "done", "failed", "retry" (the mission tries again), "taken over" (by a pilot), "drawn back"
    (by an operator's order), "interrupted" (the run or its recording stopped in it)."""

    @property
    def is_interrupted(self) -> bool:
        """Whether it was ended before its work was done, by a pilot, an operator or a cut."""
        return self.outcome in ("taken over", "drawn back", "interrupted")


class Flight(NamedTuple):
    """Outcome of a flown mission."""

    completed: bool
    reason: str  # why it ended early, or ""
    acted: tuple[Acted, ...] = ()  # rules that ended the mission
    checklist: tuple[dict[str, Any], ...] = ()  # the pre-flight checks, as plain JSON


class Flown(Generic[T, P]):
    """A flight for evaluation: task, plan and recording."""

    def __init__(
        self,
        setup: Setup[T],
        plan: MissionPlan[P],
        samples: Samples,
        phases: list[PhaseRecord],
    ) -> None:
        """`samples` (n,) are those of the whole run (100 Hz)."""
        self.setup, self.plan, self.samples, self.phases = setup, plan, samples, phases
        self._found: dict[Callable[..., Any], Any] = {}

    @property
    def task(self) -> T:
        """The task of the mission's kind."""
        return self.setup.task

    @property
    def way(self) -> P:
        """The data that the kind keeps of its plan."""
        return self.plan.get_way()

    def once(self, compute: Callable[[Flown[T, P]], R]) -> R:
        """Return `compute(self)`; the result is cached."""
        if compute not in self._found:
            self._found[compute] = compute(self)
        found: R = self._found[compute]
        return found
