"""The result of a run, and its form in metrics.json."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.loader import Description
from skywright.description.mission.spec import T
from skywright.run.backends import PHYSICS
from skywright.run.faults._rule import Acted
from skywright.run.flight import PhaseRecord
from skywright.run.inspected import Inspected
from skywright.run.kind import P
from skywright.run.planning import MissionPlan
from skywright.run.requirements import Verdict
from skywright.run.versions import collect_versions


class RunResult(NamedTuple, Generic[T, P]):
    """A finished run; `samples` holds the columns that components declare (100 Hz)."""

    description: Description[T]
    plan: MissionPlan[P]
    samples: NDArray[Any]
    phases: list[PhaseRecord]
    outcome: str  # succeeded, failed, aborted, interrupted, diverged
    reason: str
    metrics: dict[str, float]
    requirements: list[Verdict]
    timing: dict[str, float]
    details: Any
    """Results of the mission's kind that are not metrics; of a scan a WeldResult, or None."""
    directory: Path
    acted: tuple[Acted, ...] = ()
    """Rules that ended the mission, in the order in which they acted."""
    found: dict[str, Any] = {}
    """The results, as plain JSON."""
    waived: dict[str, str] = {}
    """Requirements that do not apply to the task, each with the reason."""
    command: str = ""  # command line that started the run, or ""
    backend: str = PHYSICS  # back end that flew it
    checklist: tuple[dict[str, Any], ...] = ()  # what Checked.to_json returns
    inspected: Inspected | None = None
    """Detection results for the flaws of the true world; None: the kind searches for none."""

    def __repr__(self) -> str:
        return f"<RunResult {self.directory}: {self.outcome}>"

    @property
    def exit_code(self) -> int:
        """Exit code of the command-line contract."""
        return {"succeeded": 0, "diverged": 3}.get(self.outcome, 1)

    def to_json(self) -> dict[str, Any]:
        """Return the content of metrics.json."""
        d = self.description
        return {
            "mission": d.mission.name,
            "robot": d.robot.name,
            "world": d.world.name,
            "seed": d.mission.seed,
            "backend": self.backend,
            "command": self.command,
            "outcome": self.outcome,
            "reason": self.reason,
            "requirements": [r._asdict() for r in self.requirements],
            "waived": self.waived,
            "result": self.found,
            "inspected": None if self.inspected is None else self.inspected.to_json(),
            "metrics": {k: v if np.isfinite(v) else None for k, v in self.metrics.items()},
            "phases": [p._asdict() for p in self.phases],
            "faults": [a._asdict() for a in self.acted],
            "checklist": list(self.checklist),
            "timing": self.timing,
            "versions": collect_versions(),
        }
