"""Flights that end early: an interrupt may come at any time, and what was flown is judged."""

from __future__ import annotations

import contextlib
import warnings
from typing import Any

from skywright.description.loader import Description
from skywright.errors import InputError, SimulationError
from skywright.run.flight import Flown
from skywright.run.kind import load_kind
from skywright.run.metrics import compute_common_metrics
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup


class Until:
    """Ends a flight where a phase begins."""

    def __init__(self, phase: str) -> None:
        self.phase = phase

    def on_plan(self, plan: Any, description: Any) -> None:
        pass

    def on_tick(self, t: float, phase: str, vehicle: Any) -> None:
        if phase == self.phase:
            raise SimulationError(f"{phase} is not asked for")

    def close(self) -> None:
        pass


def fly_until(phase: str, description: Description) -> RunResult:
    """Fly until a phase begins, and evaluate that: what a test asks is known by then."""
    result = fly_and_evaluate(description, [Until(phase)])
    assert result.reason == f"{phase} is not asked for"
    return result


def check_cuts(result: RunResult) -> None:
    """Judge the flight as if it had ended with each phase's first samples, and in its middle."""
    s, setup = result.samples, Setup(result.description)
    kind = load_kind(result.description.mission.kind)
    for k, phase in enumerate(result.phases):
        for end in (phase.start_s, phase.start_s + 0.011, 0.5 * (phase.start_s + phase.end_s)):
            cut = s[s["t"] <= end]
            if not len(cut):
                continue
            last = phase._replace(end_s=end, outcome="interrupted")
            phases = [*result.phases[:k], last]
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                compute_common_metrics(cut, phases)
                with contextlib.suppress(InputError):  # that there is too little to judge
                    kind.metrics(Flown(setup, result.plan, cut, phases))
