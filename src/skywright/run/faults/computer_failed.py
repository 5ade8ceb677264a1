"""A step of the robot's computer that raised, returned a non-finite number, or did not return."""

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

    watches = "1 if the control law or the estimator raised, returned a non-finite number, or hung"
    unit = ""
    source = (
        "a restarted control law lands the robot; after a second failure, or a failure of the "
        "estimator, nothing can control the robot"
    )
    from_take_off = True
    answers_failed_computer = overrides_pilot = True
    every = 100  # after a failure of a step it is evaluated at once

    class Table(Rule.Table):
        """Limit; the value is 1 after a failure. Without a working law the motors are stopped."""

        limit: NonNegative = 0.5
        hold_s: NonNegative = 0.0
        response: Literal["let_go"] = "let_go"

    def look(self, v: Senses) -> float:
        self._says = v.failure
        return 1.0 if v.failure else 0.0

    def repair(self, s: Supervisor) -> Response:
        """Land with a restarted law; if there is none, stop the motors."""
        if not s.senses.restarts:
            return super().repair(s)
        s.senses.failure = ""
        return "land_here"

    def explain(self, value: float) -> str:
        """State which step failed."""
        return f"the robot's computer failed ({self._says})"
