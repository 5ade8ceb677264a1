"""A joint whose servo is stuck where it is, or has no torque any more."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_joints, takes_torque
from skywright.errors import InputError
from skywright.models.compliant_arms import is_compliant
from skywright.models.servo_gains import compute_servo_gains
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Fault, words

TERMS = 3
"""Terms of MuJoCo's affine gain and bias of an actuator."""


class Joint(Fault):
    """`stuck`: the servo holds its angle; `dead`: it makes no torque, only friction is left."""

    class Table(Fault.Table):
        """Which joint, counted from 1 in the order of the recording's `q`, and what is wrong."""

        joint: int = Field(default=1, ge=1)
        how: Literal["stuck", "dead"] = "stuck"

    class Me(Record):
        start: float  # s
        ctrl: int  # of the servo
        dead: int
        speeds: int  # 1: the servo takes speeds
        began: int
        torques: int  # 1: torques, so that a PD around the angle at the start holds it
        n: int  # joints
        angle: Annotated[Integers, MAX_JOINTS]  # addresses in qpos
        motor: Annotated[Array, MAX_JOINTS]  # the motor's angle a radian of each joint
        kp: float  # N m/rad
        kv: float  # N m s/rad
        held: float  # its command at the start
        gain: int  # address of the actuator's gain
        bias: int

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the servo; raises InputError for a joint without one."""
        limbs, model = list_joints(context.robot), context.scene.model
        driven = [j + 1 for j, limb in enumerate(limbs) if limb.servo >= 0]
        if table.joint not in driven:
            raise InputError(
                f"plant.faults.{self.name}.joint is {table.joint}; joints with a servo of "
                f"{context.robot.name!r}: {', '.join(map(str, driven)) or 'none'}"
            )
        me.start, me.dead = table.start_s, table.how == "dead"
        me.speeds = not is_compliant(context.robot)
        me.torques = takes_torque(context.robot)
        me.n = len(limbs)
        me.angle[: me.n] = context.scene.places.joint_qpos
        me.motor[: me.n] = context.model["belt_inv"][table.joint - 1, : me.n]
        me.kp, me.kv = compute_servo_gains(context.robot, limbs[table.joint - 1].servo)
        me.ctrl = len(context.rotors.thrust_min) + limbs[table.joint - 1].servo
        self._terms = model.actuator_gainprm[me.ctrl], model.actuator_biasprm[me.ctrl]
        me.gain, me.bias = (terms.ctypes.data for terms in self._terms)

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Any joint with a servo; None without one."""
        driven = [j + 1 for j, limb in enumerate(list_joints(robot)) if limb.servo >= 0]
        if not driven:
            return None
        return {"joint": int(rng.choice(driven)), "how": str(rng.choice(["stuck", "dead"]))}

    def save(self) -> Any:
        """Return the actuator's gain and bias."""
        return [terms.copy() for terms in self._terms]

    def restore(self, saved: Any) -> None:
        """Put them back."""
        for terms, were in zip(self._terms, saved, strict=True):
            terms[:] = were

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo) -> None:
        if clock.t < me.start:
            return
        ctrl = words(mj.ctrl, mj.nu)
        if me.began == 0:
            me.began, me.held = 1, ctrl[me.ctrl]
            if me.torques == 1:
                qpos = words(mj.qpos, mj.nq)
                me.held = 0.0
                for j in range(me.n):
                    me.held += me.motor[j] * qpos[me.angle[j]]
        gain, bias = words(me.gain, TERMS), words(me.bias, TERMS)
        if me.dead == 1:
            for k in range(TERMS):
                gain[k] = bias[k] = 0.0
        elif me.torques == 1:
            gain[0], bias[0], bias[1], bias[2] = 0.0, me.kp * me.held, -me.kp, -me.kv
        else:
            ctrl[me.ctrl] = 0.0 if me.speeds == 1 else me.held
