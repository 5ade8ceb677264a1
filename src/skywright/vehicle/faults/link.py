"""A control link that carries nothing for a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.record import Record
from skywright.core.spec import Positive
from skywright.core.types import MAX_ROTORS
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Fault, InOut, words
from skywright.vehicle.faults.localisation import FOR_GOOD
from skywright.vehicle.link import ControlLink
from skywright.vehicle.plant import RotorState

ALL_LOST = 2.0
"""A share that no draw exceeds."""


class Link(Fault):
    """Every packet is lost from `start_s` on, for `for_s`.

    The motors' controllers stop them where no command came for `motor_timeout_s`, as real ones do.
    """

    needs_link = True

    class Table(Fault.Table):
        """How long, and when motors stop."""

        for_s: Positive = FOR_GOOD
        motor_timeout_s: Positive = 0.5

    class Me(Record):
        start: float  # s
        end: float  # s
        timeout: float  # s
        loss: int  # address of the link's loss
        usual: float  # of packets

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Find the link."""
        me.start, me.end = table.start_s, table.start_s + table.for_s
        me.timeout = table.motor_timeout_s
        link = context.records[ControlLink.Me, "link"]
        fields = link.dtype.fields
        me.loss = link.ctypes.data + fields["loss"][1]
        me.usual = context.world.link.loss_fraction

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Where the world has a link: for a moment, or for good."""
        link = world.link
        if link.delay_s == 0.0 and link.jitter_s == 0.0 and link.loss_fraction == 0.0:
            return None
        return {"for_s": float(rng.choice([0.1, 0.3, FOR_GOOD]))}

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, rotors: InOut[RotorState]) -> None:
        lost = clock.t >= me.start and clock.t < me.end
        words(me.loss, 1)[0] = ALL_LOST if lost else me.usual
        if lost and clock.t >= me.start + me.timeout:
            ctrl = words(mj.ctrl, mj.nu)
            for i in range(MAX_ROTORS):
                if i < rotors.n:
                    ctrl[i] = rotors.speed[i] = rotors.thrust[i] = 0.0
