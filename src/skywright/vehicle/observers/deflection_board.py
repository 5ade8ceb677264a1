"""The board that reads the deflection encoders at 200 Hz (Suarez 2020, section III-B).

It keeps what it read between two mission ticks, for whoever sends it on; a vehicle has one only
where somebody asks for it, and nothing else depends on it.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

from skywright.core.record import Array, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.vehicle.arms.ports import ArmModel, Deflections
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Component

RATE = 200.0  # Hz
ROWS = 16
"""Rows kept: four mission ticks."""


class Reading(NamedTuple):
    """The readings of the board at one time."""

    t: float  # s, mission time
    deflection: tuple[float, ...]  # rad, a joint each; 0 where there is no encoder


class DeflectionBoard(Component):
    """Keeps the newest deflections."""

    slot, side = "derive", "robot"

    class Me(Record):
        n: int  # rows since they were taken
        slot: int  # period that was read last
        t: Annotated[Array, ROWS]  # s
        deflection: Annotated[Array, ROWS, MAX_JOINTS]  # rad

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Initially there are no readings."""
        self._me, me.slot, self._joints = me, -1, len(list_joints(context.robot))

    def take(self) -> list[Reading]:
        """Return the readings since the last call, oldest first."""
        me, n = self._me, int(self._me.n)
        me.n = 0
        return [
            Reading(float(me.t[k]), tuple(me.deflection[k, : self._joints].tolist()))
            for k in range(n)
        ]

    @staticmethod
    def step(me: Me, clock: Clock, arm: ArmModel, sensed: Deflections) -> None:
        slot = math.floor(clock.t * RATE + 1e-6)
        if slot != me.slot and me.n < ROWS:
            me.slot = slot
            me.t[me.n] = clock.t
            for j in range(MAX_JOINTS):
                me.deflection[me.n, j] = sensed.deflection[j] if arm.sensed[j] > 0.0 else 0.0
            me.n += 1
