"""A control link that loses packets or has a longer delay for a time."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from skywright.core.record import Record
from skywright.core.spec import Fraction, Positive
from skywright.core.types import MAX_ROTORS
from skywright.models.capability import MOTOR_TIMEOUT_S
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Fault, InOut, words
from skywright.vehicle.faults.localisation import FOR_GOOD
from skywright.vehicle.link import ControlLink
from skywright.vehicle.plant import RotorState

LATE_SHARE, DRAWN_DELAY_S = 0.5, (0.005, 0.015)
"""Share of delays among drawn faults, and their range (s each way): with 15 ms the OTHex's rotors
saturated for 141 s of a scan."""
MOST_DELAY_S = 0.2
"""s; the packets in transit still fit the buffer of the link (link.py: DEPTH)."""


class Link(Fault):
    """Packets are lost (default: all) or delayed by `delay_s`, from `start_s` on, for `for_s`.

    If all are lost, the motor controllers stop the motors after `motor_timeout_s`, as real ones do.
    """

    needs_link = True

    class Table(Fault.Table):
        """Duration, share of lost packets, added delay each way, and time until motors stop."""

        for_s: Positive = FOR_GOOD
        loss_fraction: Fraction = 1.0
        delay_s: Annotated[float, Field(ge=0.0, le=MOST_DELAY_S)] = 0.0
        motor_timeout_s: Positive = MOTOR_TIMEOUT_S

        @model_validator(mode="after")
        def _check_effect(self) -> Self:
            """Raise ValueError if the delay, or the whole fault, has no effect."""
            if self.delay_s > 0.0 and self.loss_fraction == 1.0:
                raise ValueError(
                    "delay_s has no effect with loss_fraction = 1 (the default), which loses every "
                    "packet: set loss_fraction to less, 0 for a delay alone"
                )
            if self.delay_s == 0.0 and self.loss_fraction == 0.0:
                raise ValueError(
                    "loss_fraction = 0 and delay_s = 0 leave the link as it is: set one of them"
                )
            return self

    class Me(Record):
        start: float  # s
        end: float  # s
        timeout: float  # s
        all: int  # 1: nothing arrives
        loss: int  # address of the link's loss
        usual_loss: float  # fraction of packets
        worst_loss: float
        delay: int  # address of the link's delay
        usual_delay: float  # s
        worst_delay: float  # s

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the link."""
        me.start, me.end = table.start_s, table.start_s + table.for_s
        me.timeout = table.motor_timeout_s
        me.all = table.loss_fraction == 1.0
        link, usual = context.records[ControlLink.Me, "link"], context.world.link
        fields = link.dtype.fields
        me.loss = link.ctypes.data + fields["loss"][1]
        me.usual_loss = usual.loss_fraction
        me.worst_loss = max(table.loss_fraction, usual.loss_fraction)
        me.delay = link.ctypes.data + fields["delay"][1]
        me.usual_delay, me.worst_delay = usual.delay_s, usual.delay_s + table.delay_s

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """A loss for a moment or for good, or a delay; None if the world has no link."""
        link = world.link
        if link.delay_s == 0.0 and link.jitter_s == 0.0 and link.loss_fraction == 0.0:
            return None
        if rng.random() < LATE_SHARE:
            later = float(rng.uniform(*DRAWN_DELAY_S))
            return {"loss_fraction": 0.0, "delay_s": later}
        return {"for_s": float(rng.choice([0.1, 0.3, FOR_GOOD]))}

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, rotors: InOut[RotorState]) -> None:
        bad = clock.t >= me.start and clock.t < me.end
        words(me.loss, 1)[0] = me.worst_loss if bad else me.usual_loss
        words(me.delay, 1)[0] = me.worst_delay if bad else me.usual_delay
        if bad and me.all == 1 and clock.t >= me.start + me.timeout:
            ctrl = words(mj.ctrl, mj.nu)
            for i in range(MAX_ROTORS):
                if i < rotors.n:
                    ctrl[i] = rotors.speed[i] = rotors.thrust[i] = 0.0
