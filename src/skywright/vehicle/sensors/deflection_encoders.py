"""Encoders on the springs of compliant joints: 14-bit magnetic encoders (Suarez 2020, III-B)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.models.compliant_arms import is_compliant
from skywright.vehicle.arms.ports import Deflections, PerJoint
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Component, Normal, Out, Sensor, words

RATE = 200.0  # Hz (Suarez 2020, section III-B)
ERROR = math.radians(0.2)  # rad, accuracy of the AS5047 (same source); varies with the angle
NOISE = math.radians(0.05)  # rad, 1 sigma
LSB = 2.0 * math.pi / 2**14  # rad


class DeflectionEncoders(Sensor):
    """Fills Deflections of joints that have an encoder on their spring."""

    class Me(Record):
        n: int
        flex: Annotated[Integers, MAX_JOINTS]  # -1: rigid
        on: Annotated[Integers, MAX_JOINTS]  # 1: has an encoder
        slot: int  # index of the period of the last reading
        wave: Annotated[Array, MAX_JOINTS]  # rad, phase of the error over a turn

    class Noise(Normal):
        stream = "deflection"
        raw: PerJoint

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield the encoders if the robot has compliant arms."""
        if is_compliant(context.robot):
            yield cls("deflection encoders")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the joints; draw the phases of their errors."""
        joints, me.n, me.slot = list_joints(context.robot), context.scene.n_joints, -1
        me.flex[: me.n] = context.scene.places.flex_qpos
        me.on[: me.n] = [limb.link.deflection_encoder for limb in joints]
        phases = context.stream("deflection").uniform(0.0, 2.0 * math.pi, me.n)
        me.wave[: me.n] = phases

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, noise: Noise, out: Out[Deflections]) -> None:
        qpos = words(mj.qpos, mj.nq)
        slot = math.floor(clock.t * RATE + 1e-6)
        fresh = slot != me.slot
        me.slot = slot
        for j in range(me.n):
            if me.on[j] and fresh:
                true = -qpos[me.flex[j]]
                raw = true + ERROR * (math.sin(true + me.wave[j]) - math.sin(me.wave[j]))
                raw += NOISE * noise.raw[j]
                out.deflection[j] = LSB * math.floor(raw / LSB + 0.5)
