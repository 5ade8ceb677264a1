"""A flight computer whose control law fails: an error of the program, a number gone bad, a hang."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np

from skywright.core.record import Record
from skywright.vehicle.bus import Clock, WrenchCommand
from skywright.vehicle.component import Fault, InOut
from skywright.vehicle.ticker import StepFailed

AGAIN_S = 0.1  # s between two failures: a law is started again within it
HOWS: tuple[Literal["raises", "nan", "hangs"], ...] = ("raises", "nan", "hangs")


class Computer(Fault):
    """The control law `raises`, commands `nan`, or `hangs` until its watchdog stops it.

    It does so once, or with `again` also after each start.
    """

    slot = "derive"

    class Table(Fault.Table):
        """How it fails."""

        how: Literal["raises", "nan", "hangs"] = "raises"
        again: bool = False

    class Me(Record):
        start: float  # s
        nan: int  # 1: still to come
        again: int  # 1: and again

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the time."""
        me.start, me.nan, me.again = table.start_s, table.how == "nan", table.again
        self._next = table.start_s

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Fail when it is time; raises StepFailed."""
        how = self.table.how
        if t < self._next or how == "nan":
            return
        self._next = t + AGAIN_S if self.table.again else math.inf
        what = "raised an error" if how == "raises" else "did not return"
        raise StepFailed(f"the control law {what} at t = {t:.3f} s (plant.faults.{self.name})")

    def save(self) -> Any:
        """Return when it fails next."""
        return self._next

    def restore(self, saved: Any) -> None:
        """Go back to that."""
        self._next = float(saved)

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """In any way."""
        return {"how": HOWS[int(rng.integers(len(HOWS)))]}

    @staticmethod
    def step(me: Me, clock: Clock, cmd: InOut[WrenchCommand]) -> None:
        if me.nan == 1 and clock.t >= me.start and cmd.f_B[2] != 0.0:
            me.nan, me.start = me.again, clock.t + AGAIN_S
            cmd.f_B[2] = np.nan
