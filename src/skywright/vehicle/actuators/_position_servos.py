"""Servos that take angle commands at their own rate and follow them with a lag."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints
from skywright.models.compliant_arms import count_command_ticks, is_compliant
from skywright.models.deviated_arm import list_true_servos
from skywright.models.servo_gains import compute_servo_lag
from skywright.vehicle.arms.joints import fill_home
from skywright.vehicle.arms.truth import ServoState
from skywright.vehicle.bus import Clock, MuJoCo, ServoDrive
from skywright.vehicle.component import Component, Out, Recorded, words


class PositionServos(Component):
    """Writes MuJoCo's controls after those of the rotors, and ServoState.

    A command is quantised and held; the motion has a first-order lag, limited to the no-load speed:
    theta + T_s theta_dot = theta_ref (Suarez 2020, 17).
    """

    slot, side = "actuate", "plant"

    class Me(Record):
        n: int  # joints
        first: int  # control of the first servo
        every: int  # control ticks between commands
        servo: Annotated[Integers, MAX_JOINTS]  # of each joint, -1: passive
        lsb: Annotated[Array, MAX_JOINTS]  # rad, of a command; 0: exact
        speed: Annotated[Array, MAX_JOINTS]  # rad/s
        tau: Annotated[Array, MAX_JOINTS]  # s, lag, before the inner loop's

    columns = (
        Recorded("cmd_theta", ServoState, "held", "rad", "commanded shaft angles", per="joint"),
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with compliant arms have them."""
        if is_compliant(context.robot):
            yield cls("position servos")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the servos' data."""
        robot, servos = context.robot, list_true_servos(context.robot, context.deviation)
        me.n, me.first = context.scene.n_joints, len(context.rotors.thrust_min)
        me.every = count_command_ticks(robot)
        for j, limb in enumerate(list_joints(robot)):
            me.servo[j] = limb.servo
            if limb.servo >= 0:
                servo = servos[limb.servo][1]
                me.lsb[j] = math.radians(servo.resolution_deg)
                me.speed[j], me.tau[j] = servo.no_load_speed_rad_s, compute_servo_lag(servo)

        state = context.records[ServoState, ""]
        for angles in (state["held"], state["now"]):
            fill_home(angles, context)

    @staticmethod
    def step(me: Me, clock: Clock, drive: ServoDrive, mj: MuJoCo, out: Out[ServoState]) -> None:
        ctrl = words(mj.ctrl, mj.nu)
        for j in range(me.n):
            if me.servo[j] < 0:
                continue
            if clock.tick % me.every == 0:
                lsb = me.lsb[j]
                cmd = drive.motor[j]
                out.held[j] = lsb * math.floor(cmd / lsb + 0.5) if lsb > 0.0 else cmd
            reach = me.speed[j] * clock.dt
            step = (out.held[j] - out.now[j]) * (1.0 - math.exp(-clock.dt / me.tau[j]))
            out.now[j] += min(max(step, -reach), reach)
            ctrl[me.first + me.servo[j]] = out.now[j]
