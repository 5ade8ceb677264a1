"""Encoders on the shafts of velocity servos.

Speeds are differences of the quantised angles through a first-order filter, as servos report them.
Quantisation by a count d causes noise of d / (sqrt(12) tau) rms after a filter of time constant
tau. The filter is therefore as slow as the users of the speed tolerate: SEPARATION above the arm's
loop, where it costs 11 deg of phase, and no faster than the servo's own loop. For servos with
torque commands the law's loop replaces the servo's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos, takes_torque
from skywright.description.robot.spec import Robot
from skywright.models.compliant_arms import is_compliant
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Component, Out, Sensor, words
from skywright.vehicle.readings import Shafts

DEFAULT_COUNTS = 4096
"""Counts per turn if there is no servo."""
SEPARATION = 5.0
"""Ratio of the bandwidth of the speed filter to that of the arm's loop."""


class Encoders(Sensor):
    """Fills Shafts every control tick: quantised angles with a zero error, and their speeds."""

    class Me(Record):
        n: int
        qpos: Annotated[Integers, MAX_JOINTS]
        started: int
        share: float  # filter gain per tick, for a new angle difference
        before: Annotated[Array, MAX_JOINTS]  # rad, one tick ago
        lsb: Annotated[Array, MAX_JOINTS]  # rad
        offset: Annotated[Array, MAX_JOINTS]  # rad

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the joints, their resolution and their zeros."""
        index, n = context.scene.places, context.scene.n_joints
        me.n = n
        me.qpos[:n] = index.joint_qpos
        me.share = 1.0 - math.exp(-context.dt * compute_speed_bandwidth(context.robot))
        fill_encoders(me, context)

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo, out: Out[Shafts]) -> None:
        qpos = words(mj.qpos, mj.nq)
        for j in range(me.n):
            lsb = me.lsb[j]
            raw = qpos[me.qpos[j]] + me.offset[j]
            out.q[j] = lsb * math.floor(raw / lsb + 0.5)
            if me.started:
                out.qd[j] += me.share * ((out.q[j] - me.before[j]) / clock.dt - out.qd[j])
            me.before[j] = out.q[j]
        me.started = 1

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with velocity servos have them, also without an arm."""
        if not is_compliant(context.robot):
            yield cls("encoders")


def compute_speed_bandwidth(robot: Robot) -> float:
    """Return the bandwidth (rad/s) of the filter of the angle differences."""
    loop = SEPARATION * robot.control.arm_bandwidth_rad_s
    servos = [1.0 / servo.velocity_time_constant_s for _, servo in list_servos(robot)]
    if takes_torque(robot):
        return SEPARATION * min(servos)
    return min([w for w in (loop, *servos) if w > 0.0], default=SEPARATION)


def fill_encoders(me: Any, context: Any) -> None:
    """Fill `lsb` and `offset` of all joints."""
    robot, offset = context.robot, context.deviation.joint_offset
    servos = list_servos(robot)
    me.lsb[:] = 2.0 * math.pi / DEFAULT_COUNTS
    me.offset[: len(offset)] = offset
    for j, limb in enumerate(list_joints(robot)):
        if limb.servo >= 0:
            me.lsb[j] = 2.0 * math.pi / servos[limb.servo][1].encoder_counts
