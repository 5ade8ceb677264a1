"""Eddy-current instrument: signal at each sample, and contact from the lift-off signal."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.compiled import helper
from skywright.core.record import Array, Integers, Record
from skywright.models.eddy_current import (
    Instrument,
    ProbeSignal,
    build_probe_signal,
    ec_signal,
)
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import (
    Component,
    InOut,
    Normal,
    Out,
    Output,
    Recorded,
    table,
    words,
)
from skywright.vehicle.guard import CONTACT_LOST, CONTACT_MADE
from skywright.vehicle.plant import SAMPLE_RATE, Surface

LIFT_OFF_THRESHOLD = 15.0
"""Instrument units, limit of the lift-off signal in contact (Tognon 2018, section VII)."""


class EddyProbe(Component):
    """Reads the pipe under the tip once per sample; fires the guards for contact made and lost."""

    slot, side = "derive", "plant"

    class Me(Record):
        tables: int  # address of complex (tilt * gap, welds * blend)
        d_log_mu: int  # address of complex (tilt * gap,)
        texture: int  # address of (3, modes): ks, kc, phase
        welds: int  # address of (welds, 4)
        n: Annotated[Integers, 4]  # tilts * gaps, welds * blends, modes, welds
        numbers: Annotated[Array, 5]  # other numbers of ProbeSignal, in its order
        null: Annotated[Array, 2]  # assumed signal in contact
        lift_axis: Annotated[Array, 2]  # assumed direction contact -> air on the display

    class Noise(Normal):
        stream = "probe"
        re: float
        im: float

    class Reading(Output):
        ec: Annotated[Array, 2]  # instrument units
        in_contact: int  # 1: in contact, by the lift-off signal

    columns = (Recorded("ec", Reading, "ec", "", "eddy-current signal, in instrument units"),)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Tabulate the signal of the pipe and its welds, and draw the steel's texture."""
        world, phase = context.world, Instrument().phase
        signal = build_probe_signal(world.pipe, world.list_welds(), context.stream("texture"))
        me.tables = context.keep(np.ascontiguousarray(signal.table, np.complex128))
        me.d_log_mu = context.keep(np.ascontiguousarray(signal.d_log_mu, np.complex128))
        waves = np.stack([signal.texture_ks, signal.texture_kc, signal.texture_phase])
        me.texture = context.keep(np.ascontiguousarray(waves))
        me.welds = context.keep(np.ascontiguousarray(signal.welds))
        me.n[:] = [*signal.table.shape, waves.shape[1], len(signal.welds)]
        me.numbers[:] = [
            signal.nose, signal.radius, signal.footprint, signal.texture_amplitude, signal.noise,
        ]  # fmt: skip
        me.lift_axis[:] = [math.cos(phase), math.sin(phase)]

    def get_period(self, step: str, context: Any) -> float:
        """Return the sample period (s)."""
        return 1.0 / SAMPLE_RATE

    @staticmethod
    def step(
        me: Me, clock: InOut[Clock], surface: Surface, noise: Noise, out: Out[Reading]
    ) -> None:
        re, im = ec_signal(
            open_signal(me), surface.s, surface.c, surface.gap, surface.tilt, noise.re, noise.im
        )
        out.ec[0], out.ec[1] = re, im
        lift = me.lift_axis[0] * (re - me.null[0]) + me.lift_axis[1] * (im - me.null[1])
        touching = 1 if abs(lift) < LIFT_OFF_THRESHOLD else 0
        if touching and not out.in_contact:
            clock.fired |= clock.mask & CONTACT_MADE
        if out.in_contact and not touching:
            clock.fired |= clock.mask & CONTACT_LOST
        out.in_contact = touching

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield the instrument if the robot has a probe and the world a pipe."""
        if context.world.pipe is not None and context.robot.probe is not None:
            yield cls("eddy current")


@helper
def open_signal(me: Any) -> ProbeSignal:
    """Return views of the data that `ec_signal` needs."""
    q, modes = me.numbers, me.n[2]
    return ProbeSignal(
        table(me.tables, me.n[0], 2 * me.n[1]).view(np.complex128),
        words(me.d_log_mu, 2 * me.n[0]).view(np.complex128),
        q[0],
        table(me.welds, me.n[3], 4),
        q[1], q[2],
        words(me.texture, modes),
        words(me.texture + 8 * modes, modes),
        words(me.texture + 16 * modes, modes),
        q[3], q[4],
    )  # fmt: skip
