"""Streams of hand references: points, velocities or forces, each of which ages.

The newest reference counts for 0.5 s. Then a hand that was led to a point or by a velocity stays
where it was led, and a force falls to zero over another 0.5 s while the hand stays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.types import TASK_FORCE, TASK_POSITION, TASK_VELOCITY
from skywright.vehicle.arms.ports import Hands, HandState
from skywright.vehicle.interface import Backend, Table

Array = NDArray[np.float64]

STALE_S, FALL_S = 0.5, 0.5
LEAST_N = 1e-3  # N, a direction and no force


class Told(NamedTuple):
    """A reference of a hand: a point "p" (m), a velocity "v" (m/s) or a force "f" (N), in W."""

    what: str
    value: Array
    speed: float | None = None  # m/s, to a point


class HandStream:
    """What hands were told, and when."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._told: dict[int, tuple[Told, float]] = {}
        self._stays: dict[int, Array] = {}

    def tell(self, hand: int, told: Told) -> None:
        """Take a new reference."""
        self._told[hand] = told, self._backend.t
        self._stays.pop(hand, None)

    def fill(self, table: Table) -> None:
        """Write the hands' tasks into rows."""
        b = self._backend
        for h, (told, heard) in self._told.items():
            age = b.t - heard
            stale = age > STALE_S + 1e-9
            if told.what == "f" and age <= STALE_S + FALL_S:
                share = min(max((STALE_S + FALL_S - age) / FALL_S, 0.0), 1.0)
                size = max(float(np.linalg.norm(told.value)), 1e-9)
                table["task"][:, h], table["gamma"][:, h] = TASK_FORCE, 1.0
                table["f_WH"][:, h] = told.value * max(share, LEAST_N / size)
            elif told.what == "p" and not stale:
                speed = told.speed or float(b.look(HandState).speed_hand)
                self._lead(table, h, told.value, speed)
            elif told.what == "v" and not stale:
                table["task"][:, h], table["v_WH"][:, h] = TASK_VELOCITY, told.value
                table["p_WH"][:, h] = b.look(HandState).p_ref[h]
            else:
                stays = self._stays.setdefault(h, self._find_rest(h, told))
                self._lead(table, h, stays, float(b.look(HandState).speed_hand))

    def _find_rest(self, h: int, told: Told) -> Array:
        """Return the position at which a hand without new references stays."""
        led = self._backend.look(HandState).p_ref[h]
        return np.array(self._backend.look(Hands).p_WH[h] if told.what == "f" else led)

    def _lead(self, table: Table, h: int, p: Array, speed: float) -> None:
        table["task"][:, h], table["p_WH"][:, h] = TASK_POSITION, p
        table["v_WH"][:, h] = [speed, 0.0, 0.0]
        table["f_WH"][:, h] = 0.0
