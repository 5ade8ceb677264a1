"""A battery that suddenly holds less: an old or a cold one, a cell that fails."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.record import Record
from skywright.core.spec import Fraction
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Fault, words
from skywright.vehicle.sensors.fuel_gauge import FuelGauge


class Battery(Fault):
    """From `start_s` on `charge_fraction` of the battery's energy is left, if there was more."""

    class Table(Fault.Table):
        """What is left."""

        charge_fraction: Fraction = 0.15

    class Me(Record):
        start: float  # s
        done: int
        used: int  # address of the gauge's energy used
        most: float  # J

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Find the gauge."""
        gauge = context.records[FuelGauge.Me, "fuel gauge"]
        me.used = gauge.ctypes.data + gauge.dtype.fields["used"][1]
        energy = 3600.0 * context.robot.battery.energy_wh
        me.start, me.most = table.start_s, (1.0 - table.charge_fraction) * energy

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Under what may be used, or all but empty."""
        return {"charge_fraction": float(rng.choice([0.04, 0.15]))}

    @staticmethod
    def step(me: Me, clock: Clock) -> None:
        if clock.t >= me.start and me.done == 0:
            used = words(me.used, 1)
            used[0] = max(used[0], me.most)
            me.done = 1
