"""A rotor that stands still."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

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

    class Table(Rule.Table):
        """Limit as a share of the commanded speed that is missing."""

        limit: float = 0.9
        hold_s: NonNegative = 0.04
        response: Response = "land_here"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self.rotor = 0

    def look(self, v: Senses) -> float:
        from skywright.vehicle.bus import RotorDrive
        from skywright.vehicle.sensors.fuel_gauge import Telemetry

        told, seen = v.get(RotorDrive), v.get(Telemetry)
        if told is None or seen is None or v.reference["active"] < 0.5:
            return float("nan")
        turning = told.speed > TURNING * np.max(told.speed)
        missing = np.where(turning, 1.0 - seen.speed / np.maximum(told.speed, 1e-9), 0.0)
        self.rotor = int(np.argmax(missing)) + 1
        return float(np.max(missing))

    def explain(self, value: float) -> str:
        """Say which rotor."""
        return f"rotor {self.rotor} stands still"

    def repair(self, s: Supervisor) -> Response:
        """Fly on without that rotor, where the others can."""
        return "land_here" if s.vehicle.give_up_rotor(self.rotor - 1) else "let_go"
