"""A flight computer whose control law fails: a program error, a NaN, a hang."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from skywright.core.record import Record
from skywright.vehicle.bus import Clock, WrenchCommand
from skywright.vehicle.component import Fault, InOut
from skywright.vehicle.ticker import StepFailed

AGAIN_S = 0.1  # s between two failures, longer than the restart of a law
HOWS: tuple[Literal["raises", "nan", "hangs"], ...] = ("raises", "nan", "hangs")


class Computer(Fault):
    """The control law `raises`, commands `nan`, or `hangs` until its watchdog stops it.

    It fails once or, with `again`, also after each restart.
    """

    slot = "derive"

    class Table(Fault.Table):
        """Kind of the failure, and whether it repeats."""

        how: Literal["raises", "nan", "hangs"] = "raises"
        again: bool = False

    class Me(Record):
        start: float  # s
        nan: int  # 1: a NaN is due
        again: int  # 1: repeatedly

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the table."""
        me.start, me.nan, me.again = table.start_s, table.how == "nan", table.again
        self._next = table.start_s

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Raise StepFailed when the failure is due."""
        how = self.table.how
        if t < self._next or how == "nan":
            return
        self._next = t + AGAIN_S if self.table.again else math.inf
        what = "raised an error" if how == "raises" else "did not return"
        raise StepFailed(f"the control law {what} at t = {t:.3f} s (plant.faults.{self.name})")

    def save(self) -> Any:
        """Return the time of the next failure."""
        return self._next

    def restore(self, saved: Any) -> None:
        """Restore the time of the next failure."""
        self._next = float(saved)

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Any kind of failure."""
        return {"how": HOWS[int(rng.integers(len(HOWS)))]}

    @staticmethod
    def step(me: Me, clock: Clock, cmd: InOut[WrenchCommand]) -> None:
        if me.nan == 1 and clock.t >= me.start and cmd.f_B[2] != 0.0:
            me.nan, me.start = me.again, clock.t + AGAIN_S
            cmd.f_B[2] = np.nan
