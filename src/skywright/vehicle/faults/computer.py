"""A flight computer whose control law fails: an error of the program, a number gone bad, a hang."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from skywright.core.record import Record
from skywright.vehicle.bus import Clock, WrenchCommand
from skywright.vehicle.component import Fault, InOut
from skywright.vehicle.ticker import StepFailed

HOWS: tuple[Literal["raises", "nan", "hangs"], ...] = ("raises", "nan", "hangs")


class Computer(Fault):
    """The control law `raises`, commands `nan`, or `hangs` until its watchdog stops it."""

    slot = "derive"

    class Table(Fault.Table):
        """How it fails."""

        how: Literal["raises", "nan", "hangs"] = "raises"

    class Me(Record):
        start: float  # s
        nan: int  # 1: still to come

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the time."""
        me.start, me.nan = table.start_s, table.how == "nan"
        self._failed = False

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Fail once; raises StepFailed."""
        how = self.table.how
        if t < self.table.start_s or how == "nan" or self._failed:
            return
        self._failed = True
        what = "raised an error" if how == "raises" else "did not return"
        raise StepFailed(f"the control law {what} at t = {t:.3f} s (plant.faults.{self.name})")

    def save(self) -> Any:
        """Return whether it has failed."""
        return self._failed

    def restore(self, saved: Any) -> None:
        """Go back to that."""
        self._failed = bool(saved)

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """In any way."""
        return {"how": HOWS[int(rng.integers(len(HOWS)))]}

    @staticmethod
    def step(me: Me, clock: Clock, cmd: InOut[WrenchCommand]) -> None:
        if me.nan == 1 and clock.t >= me.start:
            me.nan = 0
            cmd.f_B[2] = np.nan
