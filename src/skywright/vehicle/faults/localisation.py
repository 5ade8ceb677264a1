"""Loss of external localisation: motion capture, total station or satellites."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.record import Record
from skywright.core.spec import Positive
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Fault, InOut
from skywright.vehicle.readings import Fix, MocapSample

FOR_GOOD = 1e5
"""s, longer than any flight, and the largest time in a description."""


class Localisation(Fault):
    """No position of the platform is measured from `start_s` on, for `for_s`."""

    slot = "sense"

    class Table(Fault.Table):
        """Duration."""

        for_s: Positive = FOR_GOOD

    class Me(Record):
        start: float  # s
        end: float  # s

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the times."""
        me.start, me.end = table.start_s, table.start_s + table.for_s

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """For half a second, for five seconds, or for good."""
        return {"for_s": float(rng.choice([0.5, 5.0, FOR_GOOD]))}

    @staticmethod
    def step(
        me: Me, clock: Clock, mocap: InOut[MocapSample] | None, fix: InOut[Fix] | None
    ) -> None:
        if clock.t < me.start or clock.t >= me.end:
            return
        if mocap is not None:
            mocap.fresh = 0.0
        if fix is not None:
            fix.fresh = 0.0
