"""Servos that take speed commands: MuJoCo integrates them to an angle and closes the loop."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.models.deviated_arm import list_true_servos
from skywright.models.servo_gains import compute_servo_gains
from skywright.vehicle.bus import MuJoCo, ServoDrive
from skywright.vehicle.component import Component, words


class VelocityServos(Component):
    """Writes MuJoCo's controls after those of the rotors.

    The integrated command of a stalled servo stops: otherwise the servo would jump when released. A
    turning servo without load lags its command by kv / kp times its speed: that is not a stall.
    """

    slot, side = "actuate", "plant"

    class Me(Record):
        n: int  # joints
        n_servos: int
        first: int  # control of the first servo
        servo: Annotated[Integers, MAX_JOINTS]  # of each joint, -1: passive
        qpos: Annotated[Integers, MAX_JOINTS]
        qvel: Annotated[Integers, MAX_JOINTS]
        motor_from_joint: Annotated[Array, MAX_JOINTS, MAX_JOINTS]  # inverse of the belt
        lag: Annotated[Array, MAX_JOINTS]  # rad, command ahead of a motor that stalls
        damping_s: Annotated[Array, MAX_JOINTS]  # s, kv / kp: by which one without load lags

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up joints, belt and stall torques."""
        robot, n = context.robot, context.scene.n_joints
        me.n, me.first = n, len(context.rotors.thrust_min)
        me.qpos[:n] = context.scene.places.joint_qpos
        me.qvel[:n] = context.scene.places.joint_dof
        servos = list_true_servos(robot, context.deviation)
        me.n_servos = k = len(servos)
        belt = np.eye(k) if robot.arm.belt is None else np.array(robot.arm.belt)
        for j, limb in enumerate(list_joints(robot)):
            me.servo[j] = limb.servo
            if limb.servo >= 0:
                me.motor_from_joint[:k, j] = np.linalg.inv(belt)[:, limb.servo]
        for j, (_, servo) in enumerate(servos):
            kp, kv = compute_servo_gains(robot, j, servo)
            me.lag[j], me.damping_s[j] = servo.stall_torque_nm / kp, kv / kp

    @staticmethod
    def step(me: Me, drive: ServoDrive, mj: MuJoCo) -> None:
        ctrl, act, qpos = words(mj.ctrl, mj.nu), words(mj.act, mj.na), words(mj.qpos, mj.nq)
        qvel = words(mj.qvel, mj.nv)
        for j in range(me.n):
            if me.servo[j] >= 0:
                ctrl[me.first + me.servo[j]] = drive.motor[j]
        for j in range(me.n_servos):
            ahead = act[j]
            for i in range(me.n):
                ahead -= me.motor_from_joint[j, i] * qpos[me.qpos[i]]
                ahead -= me.damping_s[j] * me.motor_from_joint[j, i] * qvel[me.qvel[i]]
            if abs(ahead) > me.lag[j] and ahead * ctrl[me.first + j] > 0.0:
                ctrl[me.first + j] = 0.0

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Arms whose servos take speeds have them."""
        if any(servo.mode == "velocity" for _, servo in list_servos(context.robot)):
            yield cls("velocity servos")
