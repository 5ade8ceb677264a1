"""Servos that take torque commands, by their current loops."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, list_servos, takes_torque
from skywright.vehicle.bus import MuJoCo, ServoDrive
from skywright.vehicle.component import Component, words


class TorqueServos(Component):
    """Writes MuJoCo's controls after those of the rotors.

    The available torque of a motor decreases linearly with its speed, from the stall torque to zero
    at the no-load speed. The current loop, of some milliseconds at most, is modelled as ideal.
    """

    slot, side = "actuate", "plant"

    class Me(Record):
        n: int  # servos
        first: int  # control of the first servo
        joints: int
        joint: Annotated[Integers, MAX_JOINTS]  # of each servo
        qvel: Annotated[Integers, MAX_JOINTS]  # of each joint
        motor_from_joint: Annotated[Array, MAX_JOINTS, MAX_JOINTS]  # inverse of the belt
        stall: Annotated[Array, MAX_JOINTS]  # N m
        speed: Annotated[Array, MAX_JOINTS]  # rad/s, no load

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up joints, belt, stall torques and no-load speeds."""
        robot, servos = context.robot, list_servos(context.robot)
        me.n, me.joints = len(servos), context.scene.n_joints
        me.first = len(context.rotors.thrust_min)
        me.qvel[: me.joints] = context.scene.places.joint_dof
        belt = np.eye(me.n) if robot.arm.belt is None else np.array(robot.arm.belt)
        for j, limb in enumerate(list_joints(robot)):
            if limb.servo >= 0:
                me.joint[limb.servo] = j
                me.motor_from_joint[: me.n, j] = np.linalg.inv(belt)[:, limb.servo]
        for i, (_, servo) in enumerate(servos):
            me.stall[i], me.speed[i] = servo.stall_torque_nm, servo.no_load_speed_rad_s

    @staticmethod
    def step(me: Me, drive: ServoDrive, mj: MuJoCo) -> None:
        ctrl, qvel = words(mj.ctrl, mj.nu), words(mj.qvel, mj.nv)
        for i in range(me.n):
            speed = 0.0
            for j in range(me.joints):
                speed += me.motor_from_joint[i, j] * qvel[me.qvel[j]]
            most = me.stall[i] * min(max(1.0 - speed / me.speed[i], 0.0), 1.0)
            least = -me.stall[i] * min(max(1.0 + speed / me.speed[i], 0.0), 1.0)
            ctrl[me.first + i] = min(max(drive.motor[me.joint[i]], least), most)

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Arms whose servos take torques have them."""
        if takes_torque(context.robot):
            yield cls("torque servos")
