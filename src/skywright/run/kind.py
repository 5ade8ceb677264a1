"""Base class of kinds of mission: task, planning, flight, evaluation and figures.

Each kind is one folder of `skywright.missions`, one class in a user's file, or one class of an
installed package (entry points `skywright.missions`); `core/find.py` finds it by its name. Either
the methods of the class import the modules that they need when they are called, or the class is a
`FolderKind` (folder_kind.py), whose folder has one module for each. A kind that is not used
therefore costs no import time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from skywright.core.find import find
from skywright.description.mission.spec import Requirement, T
from skywright.errors import InputError

if TYPE_CHECKING:
    from skywright.description.loader import Description
    from skywright.inspection.history.entries import Entries, Procedure
    from skywright.run.flight import Flight, Flown
    from skywright.run.inspected import Inspected
    from skywright.run.planning import MissionPlan
    from skywright.run.result import RunResult
    from skywright.run.setup import Setup
    from skywright.run.supervisor import Supervisor
    from skywright.run.where import Where
    from skywright.vehicle.interface import Backend

Measures = Mapping[str, tuple[str, str]]
"""Metric -> its unit and its meaning."""
P = TypeVar("P")
"""The data that a kind keeps of its plan; None if the segments are sufficient."""


class Chart(NamedTuple):
    """A figure of a report."""

    title: str
    caption: str
    draw: Callable[[RunResult[Any, Any]], Any]
    """From a run to a figure of matplotlib, or None if there is nothing to show."""


class Sketch(NamedTuple):
    """Geometry of a mission that is drawn beside robot and world."""

    name: str = ""  # in a legend
    points: NDArray[np.float64] = np.zeros((0, 3))  # m in W, way-points
    on_pipe: NDArray[np.float64] = np.zeros((0, 2))  # s (m) and phi (rad) of a path on the pipe
    label: str = ""  # of that path
    at_work: tuple[NDArray[np.float64], float] | None = None  # p (3,) m and heading (rad)


class Mark(NamedTuple):
    """A result drawn in 3-D: a position, or a line on the pipe's surface."""

    name: str  # in the legend; equal ones have one entry
    colour: tuple[int, int, int]
    p_W: NDArray[np.float64] | None = None  # (3,) m, centre of a ball
    on_pipe: NDArray[np.float64] = np.zeros((0, 2))  # s (m) and phi (rad) of a line
    size_m: float = 0.006  # radius of the ball, width of the line
    since_s: float = 0.0  # mission time from which it is shown


class Figures(NamedTuple):
    """Figures and descriptions of a kind of mission for its report."""

    describe: Callable[[RunResult[Any, Any]], str]
    """The work done, as the beginning of a sentence ("ROBOT in world W ...")."""
    charts: Mapping[str, Chart] = {}
    """Name -> figure, in the order of the page."""
    phases: Mapping[str, str] = {}
    """Phase -> its description in one sentence."""
    title: str = "Task"
    """Title of the report's section with these figures."""
    notes: Callable[[RunResult[Any, Any]], list[str]] = lambda _: []
    """Sentences above the figures."""
    sketch: Callable[[Description[Any], Any], Sketch] = lambda _, way: Sketch()
    """Geometry of the mission to draw, before a plan exists (None) and after."""
    marks: Callable[[RunResult[Any, Any]], list[Mark]] = lambda _: []
    """Results to draw in a replay."""
    judged: tuple[str, ...] = ()
    """Phases in which replay and live pages judge the probe's contact with a pipe."""


class MissionKind(ABC, Generic[T, P]):
    """A kind of mission with tasks T and plans P."""

    group: ClassVar[str] = "kind"
    task: type[T]
    """The spec of `mission.task`."""
    needs: ClassVar[frozenset[str]]
    """What a back end must offer (vehicle/interface.py)."""
    devices: ClassVar[frozenset[str]] = frozenset()
    """Devices other than the robot that the flight uses (vehicle/devices.py)."""
    flies: ClassVar[bool] = True
    """Whether the robot leaves the ground; if not, `fly` executes the whole mission."""
    lands: ClassVar[bool] = True
    """Whether the flight ends with a landing; otherwise it ends where `fly` returns."""
    held: ClassVar[bool] = False
    """Whether the robot is held in the air at the start and then released."""
    operated: ClassVar[bool] = False
    """Whether an operator may use the stick; the task then has `operator` and `stick_speed_mps`."""

    @property
    def measures(self) -> Measures:
        """The metrics of this kind only; run/names.py has those that kinds share."""
        return {}

    @property
    def where(self) -> Mapping[str, Where]:
        """Where these metrics are measured, by name or by prefix of the name ("force.")."""
        return {}

    @abstractmethod
    def plan(self, setup: Setup[T]) -> MissionPlan[P]:
        """Plan the mission; `blocked_by` of the plan states why a request is infeasible.

        Raises InputError if robot or world lack a part that the mission requires.
        """

    def compute_added_s(self, setup: Setup[T], plan: MissionPlan[P]) -> float:
        """Return the time (s) that `fly` adds to the `duration_s` of a feasible plan.

        For example touches and waits. Repeated attempts and operators are not included. By default
        0.
        """
        return 0.0

    def check_vehicle(self, vehicle: Backend, task: T) -> None:
        """Raise InputError if the vehicle lacks what the task requires; called before take-off."""

    @abstractmethod
    def fly(self, s: Supervisor[T], way: P) -> Flight:
        """Fly the phases between take-off and landing; `s.segments` are those of the plan."""

    def withdraw(self, s: Supervisor[T], way: P) -> None:
        """Retreat, after a fault, from the object that the robot touches or grasps.

        By default 0.25 m along the normal of that object, with the arm's posture unchanged.
        """
        from skywright.run.faults._response import retract

        retract(s)

    def requirements(self, setup: Setup[T], way: P | None) -> dict[str, Requirement]:
        """Return the requirements of a run, by metric: by default those of the mission file.

        They may depend on the task, and on the plan (None: there is none yet).
        """
        return setup.description.mission.requirements

    @staticmethod
    def leave_out(
        asked: dict[str, Requirement], left_out: dict[str, bool]
    ) -> dict[str, Requirement]:
        """Return the requirements except those whose names begin with a true key of `left_out`."""
        skipped = tuple(name for name, out in left_out.items() if out)
        return {k: v for k, v in asked.items() if not k.startswith(skipped)}

    @abstractmethod
    def metrics(self, run: Flown[T, P]) -> dict[str, float]:
        """Compute the metrics of a flight; parts that were not reached have no metrics.

        Raises InputError if the samples are insufficient (a flight that ended early).
        """

    def result(self, run: Flown[T, P]) -> object:
        """Return results that are not metrics (`RunResult.details`)."""
        return None

    def describe(self, run: Flown[T, P]) -> dict[str, Any]:
        """Return the results as plain JSON: `result` in metrics.json."""
        return {}

    def inspected(self, run: Flown[T, P]) -> Inspected | None:
        """Return the detection results for the true flaws; None if the flight searched for none.

        Also for a flight that ended early: a flaw that was not reached was not found.
        """
        return None

    def entries(self, run: Flown[T, P]) -> Entries:
        """Return the readings and indications of a flight, for the database (`--records`).

        They use on-board data only, never the truth. None by default.
        """
        from skywright.inspection.history.entries import Entries

        return Entries()

    def procedure(self, setup: Setup[T]) -> Procedure | None:
        """Return the procedure of the inspection, for the database; None by default."""
        return None

    def list_waived(self, metrics: dict[str, float]) -> dict[str, str]:
        """Return the requirements that do not apply to the task, each with the reason.

        They are not evaluated: for example a line's error if there is no weld.
        """
        return {}

    @abstractmethod
    def figures(self) -> Figures:
        """Return the figures and descriptions of the report."""


def load_kind(name: str) -> MissionKind[Any, Any]:
    """Return a kind of mission by its name, or by `file.py:Class` with an absolute path.

    Raises InputError if it does not exist or is incomplete.
    """
    cls = find("kind", name, key="mission.kind").cls
    if not issubclass(cls, MissionKind):
        raise InputError(f"mission.kind: {name!r}: class {cls.__name__} is not a MissionKind")
    lacks = [n for n in ("task", "needs") if not hasattr(cls, n)]
    lacks += sorted(cls.__abstractmethods__)
    if lacks:
        raise InputError(f"mission.kind: {name!r} lacks {', '.join(lacks)}")
    kind: MissionKind[Any, Any] = cls()
    return kind
