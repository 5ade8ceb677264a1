"""The saved state of a vehicle."""

from __future__ import annotations

from typing import Any, NamedTuple

from skywright.vehicle.assembly import State
from skywright.vehicle.failed_step import WatchdogState
from skywright.vehicle.interface import Table


class Saved(NamedTuple):
    """A saved vehicle; see SimulatedVehicle.save."""

    assembly: State
    physics: Any
    table: Table
    table_start: float
    parts: dict[str, Any]  # by name of a component
    watchdog: WatchdogState
    order: str
