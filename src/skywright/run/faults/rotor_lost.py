"""A rotor that stands still."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor

TURNING = 0.3
"""Of the largest speed: what is commanded below it says nothing."""


class RotorLost(Rule):
    """What a motor's electronics tell of its speed, against what it is told."""

    watches = "speed of a rotor by its motor's electronics, against the commanded one"
    unit = ""
    source = "a rotor that turns lags by its time constant, 0.05 s"
    from_take_off = True
    every = 1

    class Table(Rule.Table):
        """Limit as a share of the commanded speed that is missing."""

        limit: NonNegative = 0.9
        hold_s: NonNegative = 0.04
        response: Response = "land_here"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._speeds: Any = None  # rad/s, asked for and made; the vehicle's own arrays
        self.rotor = 0

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.bus import RotorDrive
        from skywright.vehicle.sensors.fuel_gauge import Telemetry

        told, seen, n = v.get(RotorDrive), v.get(Telemetry), len(v.vehicle.rotors.axis)
        self._speeds = None if told is None or seen is None else (told.speed[:n], seen.speed[:n])

    def look(self, v: Senses) -> float:
        if self._speeds is None:
            return float("nan")
        asked, made = self._speeds[0].tolist(), self._speeds[1].tolist()
        least = max(TURNING * max(asked), 1e-9)
        missing = [1.0 - b / a if a > least else 0.0 for a, b in zip(asked, made, strict=True)]
        worst = max(missing)
        self.rotor = missing.index(worst) + 1
        return worst

    def explain(self, value: float) -> str:
        """Say which rotor."""
        return f"rotor {self.rotor} stands still"

    def repair(self, s: Supervisor) -> Response:
        """Fly on without that rotor, where the others can; else fall."""
        can = s.vehicle.give_up_rotor(self.rotor - 1)
        return super().repair(s) if can else "let_go"
