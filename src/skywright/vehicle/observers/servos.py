"""Load of the arm's servos relative to their stall torque, for the recording."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, InOut, Out, Output, Recorded, words
from skywright.vehicle.plant import SAMPLE_RATE


class ServoLoad(Output):
    """Largest ratio of servo torque to stall torque since the last sample."""

    load: float


class ServoObserver(Component):
    """Fills ServoLoad; torques are one physics step old."""

    side = "plant"
    slots = {"step": "observe", "clear": "peaks"}

    class Me(Record):
        n: int
        actuator: Annotated[Integers, MAX_JOINTS]
        stall: Annotated[Array, MAX_JOINTS]  # N m

    columns = (
        Recorded("servo_load", ServoLoad, "load", "", "torque of the busiest servo over its stall"),
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with servos have it."""
        if context.scene.model.actuator_forcelimited.any():
            yield cls("servo loads")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the servos: the only actuators of the scene with a force limit."""
        model = context.scene.model
        found = np.flatnonzero(model.actuator_forcelimited)
        me.n = len(found)
        me.actuator[: me.n] = found
        me.stall[: me.n] = model.actuator_forcerange[found, 1]

    def get_period(self, step: str, context: Any) -> float:
        """Peaks are reset once per sample."""
        return 1.0 / SAMPLE_RATE if step == "clear" else 0.0

    @staticmethod
    def step(me: Me, mj: MuJoCo, out: Out[ServoLoad]) -> None:
        torque = words(mj.actuator_force, mj.nu)
        for i in range(me.n):
            out.load = max(out.load, abs(torque[me.actuator[i]]) / me.stall[i])

    @staticmethod
    def clear(out: InOut[ServoLoad]) -> None:
        out.load = 0.0
