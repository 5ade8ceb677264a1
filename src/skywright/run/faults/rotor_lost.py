"""A rotor that has stopped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor

TURNING = 0.3
"""Share of the largest commanded speed; rotors commanded below it are not evaluated."""


class RotorLost(Rule):
    """Difference between the commanded and the reported speed of a rotor, as a share."""

    watches = "missing share of a rotor's commanded speed, as its motor controller reports it"
    unit = ""
    source = "a healthy rotor follows its command with a time constant of 0.05 s"
    from_take_off = True
    every = 1

    class Table(Rule.Table):
        """Limit as a share of the commanded speed that is missing."""

        limit: NonNegative = 0.9
        hold_s: NonNegative = 0.04
        response: Response = "land_here"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._asked: Any = None  # rad/s
        self._made: Any = None

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.bus import RotorDrive
        from skywright.vehicle.readings import Telemetry

        n = len(v.vehicle.rotors.axis)
        asked, made = v.place(RotorDrive, "speed"), v.place(Telemetry, "speed")
        if asked is not None and made is not None:
            self._asked, self._made = asked[:n], made[:n]

    def look(self, v: Senses) -> float:
        if self._asked is None:
            return float("nan")
        asked, made = self._asked.tolist(), self._made.tolist()
        most = max(asked)
        bound = 1.0 - min(made) / max(most, 1e-9)
        if bound < self.table.limit:  # all rotors turn
            return bound
        least = max(TURNING * most, 1e-9)
        missing = [1.0 - b / a if a > least else 0.0 for a, b in zip(asked, made, strict=True)]
        worst = max(missing)
        self.part = missing.index(worst) + 1
        return worst

    def explain(self, value: float) -> str:
        """State which rotor."""
        return f"rotor {self.part} stands still"

    def repair(self, s: Supervisor) -> Response:
        """Continue without that rotor if the others can hold the robot; else stop the motors."""
        left = s.vehicle.give_up_rotor(self.part - 1)
        if left is None:
            return "let_go"
        s.turns, s.R_hold = not left.holds_heading, left.R_WB
        return super().repair(s)
