"""A flight's memory is free when its result is dropped, without waiting for Python's collector."""

from __future__ import annotations

import gc
import weakref
from types import SimpleNamespace
from typing import Any

from skywright.description.loader import load_description
from skywright.run.run import fly_and_evaluate


def test_a_flight_leaves_nothing_behind() -> None:
    """What held the vehicle kept MuJoCo's arena and the samples: 40 MB a flight in a loop."""
    sets = ["mission.task.points=[{ x_m = 0.1, y_m = 0.0, z_m = 1.0, hold_s = 0.1 }]"]
    left: list[weakref.ref[Any]] = []

    def keep(s: Any) -> None:
        left.extend([weakref.ref(s), weakref.ref(s.vehicle)])

    gc.collect()
    gc.disable()
    try:
        watching = SimpleNamespace(on_supervisor=keep, on_tick=lambda t, phase, vehicle: None)
        result = fly_and_evaluate(load_description("waypoints", sets=sets), [watching])
        assert len(result.samples) and len(left) == 2
        assert [r() for r in left] == [None, None]
    finally:
        gc.enable()
