"""A step of the robot's computer that raised, gave no finite number, or did not return."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor


class ComputerFailed(Rule):
    """Whether the law, the estimator or another step of the robot's computer failed.

    A watchdog starts a control law again once (vehicle/failed_step.py); the robot then lands.
    """

    watches = "whether the control law or the estimator raised, gave no finite number, or hung"
    unit = ""
    source = (
        "a control law that is started again lands the robot; after a second failure, or that of "
        "the estimator, nothing is left that could fly"
    )
    from_take_off = True
    answers_failed_computer = True
    every = 100  # where a step has failed, it looks at once

    class Table(Rule.Table):
        """Limit: 1 says that it failed. Where no step is left that could fly, it falls."""

        limit: NonNegative = 0.5
        hold_s: NonNegative = 0.0
        response: Literal["let_go"] = "let_go"

    def look(self, v: Senses) -> float:
        self._says = v.failure
        return 1.0 if v.failure else 0.0

    def repair(self, s: Supervisor) -> Response:
        """Land with a law that is started again; else fall."""
        if not s.senses.restarts:
            return super().repair(s)
        s.senses.failure = ""
        return "land_here"

    def explain(self, value: float) -> str:
        """Say which step."""
        return f"the robot's computer failed ({self._says})"
