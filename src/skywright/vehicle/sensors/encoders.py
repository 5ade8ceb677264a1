"""Encoders on the shafts of velocity servos."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.models.compliant_arms import is_compliant
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Out, Sensor, words
from skywright.vehicle.readings import Shafts

DEFAULT_COUNTS = 4096
"""Counts a turn where there is no servo."""


class Encoders(Sensor):
    """Fills Shafts every control tick: rounded angles with an error of their zero, exact speeds."""

    class Me(Record):
        n: int
        qpos: Annotated[Integers, MAX_JOINTS]
        dof: Annotated[Integers, MAX_JOINTS]
        lsb: Annotated[Array, MAX_JOINTS]  # rad
        offset: Annotated[Array, MAX_JOINTS]  # rad

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the joints, their resolution and their zeros."""
        index, n = context.scene.places, context.scene.n_joints
        me.n = n
        me.qpos[:n], me.dof[:n] = index.joint_qpos, index.joint_dof
        fill_encoders(me, context)

    @staticmethod
    def step(me: Me, mj: MuJoCo, out: Out[Shafts]) -> None:
        qpos, qvel = words(mj.qpos, mj.nq), words(mj.qvel, mj.nv)
        for j in range(me.n):
            lsb = me.lsb[j]
            raw = qpos[me.qpos[j]] + me.offset[j]
            out.q[j] = lsb * math.floor(raw / lsb + 0.5)
            out.qd[j] = qvel[me.dof[j]]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots whose servos take speeds have them, without an arm as well."""
        if not is_compliant(context.robot):
            yield cls("encoders")


def fill_encoders(me: Any, context: Any) -> None:
    """Fill `lsb` and `offset` of all joints."""
    robot, offset = context.robot, context.deviation.joint_offset
    servos = list_servos(robot)
    me.lsb[:] = 2.0 * math.pi / DEFAULT_COUNTS
    me.offset[: len(offset)] = offset
    for j, limb in enumerate(list_joints(robot)):
        if limb.servo >= 0:
            me.lsb[j] = 2.0 * math.pi / servos[limb.servo][1].encoder_counts
