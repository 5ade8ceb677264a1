"""A step of the robot's computer that raised, gave no finite number, or did not return."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor


class ComputerFailed(Rule):
    """Whether the law, the estimator or another step of the robot's computer failed."""

    watches = "whether the control law or the estimator raised, gave no finite number, or hung"
    unit = ""
    source = "nothing is left that could fly: the motors' controllers stop without commands"
    from_take_off = True

    class Table(Rule.Table):
        """Limit: 1 says that it failed."""

        limit: NonNegative = 0.5
        hold_s: NonNegative = 0.0
        response: Response = "let_go"

    def look(self, v: Senses) -> float:
        self._says = v.failure
        return 1.0 if v.failure else 0.0

    def explain(self, value: float) -> str:
        """Say which step."""
        return f"the robot's computer failed ({self._says})"

    def repair(self, s: Supervisor) -> Response:
        """Fall, whatever the table says: no step is left that could fly."""
        return "let_go"
