"""Encoders on the shafts of position servos, read at the servos' rate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.models.compliant_arms import count_command_ticks, is_compliant
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Component, Out, Sensor, words
from skywright.vehicle.readings import Shafts
from skywright.vehicle.sensors.encoders import fill_encoders


class ShaftEncoders(Sensor):
    """Fills the angles of Shafts: servos at their rate, passive joints at every tick; no speeds."""

    class Me(Record):
        n: int
        every: int  # control ticks between readings of a servo
        servo: Annotated[Integers, MAX_JOINTS]  # index of each joint's servo, -1: passive
        qpos: Annotated[Integers, MAX_JOINTS]
        lsb: Annotated[Array, MAX_JOINTS]  # rad
        offset: Annotated[Array, MAX_JOINTS]  # rad

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield the encoders if the robot has compliant arms."""
        if is_compliant(context.robot):
            yield cls("shaft encoders")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the joints, their resolution and their zeros."""
        me.n, me.every = context.scene.n_joints, count_command_ticks(context.robot)
        me.qpos[: me.n] = context.scene.places.joint_qpos
        me.servo[: me.n] = [limb.servo for limb in list_joints(context.robot)]
        fill_encoders(me, context)

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, out: Out[Shafts]) -> None:
        qpos = words(mj.qpos, mj.nq)
        for j in range(me.n):
            if me.servo[j] < 0 or clock.tick % me.every == 0:
                lsb = me.lsb[j]
                raw = qpos[me.qpos[j]] + me.offset[j]
                out.q[j] = lsb * math.floor(raw / lsb + 0.5)
