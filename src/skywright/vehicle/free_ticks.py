"""Mission ticks that need no Python, so that one compiled call runs those of several vehicles.

Python between two ticks costs more than its own time, because caches are cold after 0.5 ms of
compiled code. `SimulatedVehicle.tick` needs Python only to draw random numbers, to deliver samples,
and for components with `before_tick` or `after_tick`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from skywright.errors import SimulationError
from skywright.vehicle.assembly import BLOCK, FAST_BLOCK
from skywright.vehicle.bus import Clock
from skywright.vehicle.failed_step import explain_not_finite
from skywright.vehicle.plant import MISSION_TICK
from skywright.vehicle.ports import overrides
from skywright.vehicle.recorder import Recorder
from skywright.vehicle.simulated import SimulatedVehicle
from skywright.vehicle.streams import StreamRecorder


def is_free(vehicle: SimulatedVehicle) -> bool:
    """Return whether a vehicle has ticks without Python: see count_free_ticks."""
    if vehicle.interactive or not math.isclose(vehicle.n_ticks * vehicle.dt, MISSION_TICK):
        return False  # else the control ticks of a mission tick differ in number
    return not any(
        isinstance(c, StreamRecorder) or overrides(c, "before_tick") or overrides(c, "after_tick")
        for c in vehicle.assembly.components
    )


def count_free_ticks(vehicle: SimulatedVehicle) -> int:
    """Return the number of mission ticks until a vehicle that `is_free` needs Python again."""
    if vehicle.watchdog.is_pending:
        return 0
    clock, n = vehicle.assembly.get(Clock), vehicle.n_ticks
    drawn = (BLOCK - int(clock["block"])) // n
    drawn_fast = (FAST_BLOCK - int(clock["fast"])) // (n * vehicle.n_steps)
    return max(min(drawn, drawn_fast, vehicle.find(Recorder).count_free_ticks()), 0)


def build_call(vehicle: SimulatedVehicle) -> NDArray[np.int64]:
    """Return the argument of schedule.run_mission_tick, (CALL,), which runs a free tick."""
    return np.array(vehicle.ticker.build_call(vehicle.n_ticks), np.int64)


def explain(vehicle: SimulatedVehicle) -> SimulationError:
    """Return the error that `vehicle.tick` raises for a free tick that failed."""
    try:
        vehicle.ticker.check()
    except SimulationError as error:
        return error
    return explain_not_finite(vehicle.assembly, vehicle.law, vehicle.t)
