"""Robot's measurements of battery and motors: charge, and rotor speeds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Record
from skywright.core.types import MAX_ROTORS
from skywright.models.rotors import compute_power, compute_watt_per_n15
from skywright.vehicle.component import Component, Out, Sensor
from skywright.vehicle.plant import RotorState
from skywright.vehicle.readings import Telemetry

PERIOD = 0.01
"""s, between readings."""


class FuelGauge(Sensor):
    """Integrates the energy used: power of the rotors and of the avionics; initially full."""

    class Me(Record):
        watt_per_n15: float
        avionics: float  # W
        energy: float  # J, of the full battery
        used: float  # J

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every robot has a battery, and motors that report their speed."""
        yield cls("fuel gauge")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the battery's data."""
        battery = context.robot.battery
        me.watt_per_n15 = compute_watt_per_n15(context.rotors, context.world.air_density_kg_m3)
        me.avionics, me.energy = battery.avionics_power_w, 3600.0 * battery.energy_wh

    def get_period(self, step: str, context: Any) -> float:
        """A hundred times a second."""
        return PERIOD

    @staticmethod
    def step(me: Me, rotors: RotorState, out: Out[Telemetry]) -> None:
        power = compute_power(rotors.thrust, rotors.n, me.watt_per_n15) + me.avionics
        me.used += power * PERIOD
        out.charge = max(1.0 - me.used / me.energy, 0.0)
        for i in range(MAX_ROTORS):
            out.speed[i] = rotors.speed[i]
