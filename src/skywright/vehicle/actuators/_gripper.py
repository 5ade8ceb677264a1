"""Grippers: the commands of their motors, and the opening of their fingers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, ClassVar

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_HANDS
from skywright.description.robot.limbs import list_grippers
from skywright.models.gripper_body import find_grippers
from skywright.vehicle.bus import MuJoCo, Setpoint
from skywright.vehicle.component import Component, Out, Output, Recorded, words


class GripperState(Output):
    """Readings of the motors' encoders."""

    opening: Annotated[Array, MAX_HANDS]  # m, between the fingers


class GripperMotors(Component):
    """Writes MuJoCo's controls of the motors, and measures the opening; initially they open.

    The pad of a finger turned by the angle a from the parallel presses with the motor's torque over
    length_m cos(a); the drive compensates the cosine, by its encoder.
    """

    slots: ClassVar[dict[str, str]] = {"measure": "sense", "move": "actuate"}
    side = "plant"

    class Me(Record):
        n: int  # hands
        control: Annotated[Integers, MAX_HANDS]  # -1: no gripper
        fingers: Annotated[Integers, MAX_HANDS, 2]  # address in qpos
        open: float  # m, between open fingers; that turn: twice pivot_m less radius_m
        length: float  # m, of a finger that turns; 0: slides
        angle: float  # rad, of an open finger

    class Grip(Setpoint):
        """Commands of the motors."""

        force: Annotated[Array, MAX_HANDS]  # N, of each finger; negative: opening

    columns = (
        Recorded("opening", GripperState, "opening", "m", "between a gripper's fingers",
                 per="hand"),
        Recorded("grip", Grip, "force", "N", "command to a gripper's motor", per="hand"),
    )  # fmt: skip

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with a gripper have them."""
        if list_grippers(context.robot):
            yield cls("gripper motors")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up motors and fingers."""
        scene, hand = context.scene, context.robot.arm.hand
        me.n, me.open = len(scene.places.hand_sites), hand.opening_max_m
        if hand.finger == "turn":
            me.open, me.length = hand.opening(0.0), hand.length_m
            me.angle = math.radians(hand.open_deg)
        me.control[:] = -1
        for h, (motor, fingers) in find_grippers(scene.model, me.n).items():
            me.control[h], me.fingers[h] = motor, fingers
        most = context.robot.arm.hand.grip_force_n
        self.limits = {"grip": (-most, most)}
        for (record, _), view in context.records.items():  # at both ends of a link
            if record is self.Grip:
                view["force"] = -most

    @staticmethod
    def measure(me: Me, mj: MuJoCo, out: Out[GripperState]) -> None:
        qpos = words(mj.qpos, mj.nq)
        for h in range(me.n):
            if me.control[h] >= 0:
                closed = qpos[me.fingers[h, 0]] + qpos[me.fingers[h, 1]]
                if me.length > 0.0:
                    angle = me.angle - 0.5 * closed
                    out.opening[h] = me.open + 2.0 * me.length * math.sin(angle)
                else:
                    out.opening[h] = me.open - closed

    @staticmethod
    def move(me: Me, grip: Grip, mj: MuJoCo) -> None:
        ctrl, qpos = words(mj.ctrl, mj.nu), words(mj.qpos, mj.nq)
        for h in range(me.n):
            if me.control[h] >= 0:
                ctrl[me.control[h]] = grip.force[h]
                if me.length > 0.0:
                    closed = qpos[me.fingers[h, 0]] + qpos[me.fingers[h, 1]]
                    ctrl[me.control[h]] *= math.cos(me.angle - 0.5 * closed)
