"""A battery that suddenly loses charge: an old or a cold battery, a failed cell."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.record import Record
from skywright.core.spec import Fraction
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Fault, words
from skywright.vehicle.sensors.fuel_gauge import FuelGauge


class Battery(Fault):
    """At `start_s` the remaining energy of the battery drops to at most `charge_fraction`."""

    class Table(Fault.Table):
        """The remaining charge."""

        charge_fraction: Fraction = 0.15

    class Me(Record):
        start: float  # s
        done: int
        used: int  # address of the gauge's energy used
        most: float  # J, used energy at which `charge_fraction` remains

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the fuel gauge."""
        gauge = context.records[FuelGauge.Me, "fuel gauge"]
        me.used = gauge.ctypes.data + gauge.dtype.fields["used"][1]
        energy = 3600.0 * context.robot.battery.energy_wh
        me.start, me.most = table.start_s, (1.0 - table.charge_fraction) * energy

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Below the usable charge, or almost empty."""
        return {"charge_fraction": float(rng.choice([0.04, 0.15]))}

    @staticmethod
    def step(me: Me, clock: Clock) -> None:
        if clock.t >= me.start and me.done == 0:
            used = words(me.used, 1)
            used[0] = max(used[0], me.most)
            me.done = 1
