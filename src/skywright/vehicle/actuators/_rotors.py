"""The rotors: lag of their speed, thrust, and the effect of nearby surfaces."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.record import Record
from skywright.models.rotors import step_rotor_speed
from skywright.vehicle.bus import Clock, MuJoCo, RotorDrive
from skywright.vehicle.component import Component, Out, Recorded, words
from skywright.vehicle.plant import RotorGain, RotorState


class Rotors(Component):
    """Fills RotorState and MuJoCo's first controls, one a rotor.

    Thrust is k_f w^2 at the end of the exact first-order lag, held until the next tick; errors of
    the rotor gains sit in the plant's actuator gears.
    """

    slot, side = "actuate", "plant"

    class Me(Record):
        n: int
        k_f: float  # N/(rad/s)^2
        tau: float  # s

    columns = (
        Recorded("rotor_thrust", RotorState, "thrust", "N", "nominal, in free air", per="rotor"),
        Recorded("rotor_speed", RotorState, "speed", "rad/s", per="rotor"),
    )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read lag and thrust coefficient."""
        rotors = context.rotors
        me.n, me.k_f, me.tau = len(rotors.thrust_min), rotors.k_f, rotors.time_constant

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        drive: RotorDrive,
        near: RotorGain | None,
        mj: MuJoCo,
        out: Out[RotorState],
    ) -> None:
        ctrl = words(mj.ctrl, mj.nu)
        out.n = me.n
        step_rotor_speed(out.speed, drive.speed, me.n, clock.dt, me.tau)
        for i in range(me.n):
            out.thrust[i] = me.k_f * out.speed[i] * out.speed[i]
            ctrl[i] = out.thrust[i]
            if near is not None:
                ctrl[i] *= near.gain[i]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every robot has them."""
        yield cls("rotors")
