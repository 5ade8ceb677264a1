"""Grippers: what the robot tells their motors, and how far apart their fingers are."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, ClassVar

from skywright.core.record import Array, Integers, Record
from skywright.core.types import HOLD, MAX_HANDS
from skywright.description.robot.limbs import list_grippers
from skywright.models.gripper_body import find_grippers
from skywright.vehicle.bus import GripDrive, MuJoCo
from skywright.vehicle.component import Component, Out, Output, Recorded, ReferenceBlock, words


class Grip(ReferenceBlock):
    """What grippers shall do; rows of a plan that tell nothing leave them as they are."""

    rules: ClassVar[dict[str, int]] = {"grip": HOLD}

    grip: Annotated[Array, MAX_HANDS]  # N, of each finger; negative: opening; 0: as told before


class GripperState(Output):
    """What the motors' encoders say."""

    opening: Annotated[Array, MAX_HANDS]  # m, between the fingers


class GripperDrive(Component):
    """Tells the motors what was last commanded, within what they can; at first they open."""

    slot = "allocate"

    class Me(Record):
        most: float  # N

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Robots with a gripper have one."""
        if list_grippers(context.robot):
            yield cls("grip")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Take the force; the motors begin by opening."""
        me.most = context.robot.arm.hand.grip_force_n
        for (record, _), view in context.records.items():
            if record is GripDrive:
                view["force"] = -me.most

    @staticmethod
    def step(me: Me, ref: Grip, drive: Out[GripDrive]) -> None:
        for h in range(MAX_HANDS):
            if ref.grip[h] != 0.0:
                drive.force[h] = min(max(ref.grip[h], -me.most), me.most)


class GripperMotors(Component):
    """Writes MuJoCo's controls of the motors, and measures the opening.

    The pad of a finger that turns by the angle a from the parallel presses with the motor's torque
    over length_m cos(a); the drive makes up for the cosine, by its encoder.
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

    columns = (
        Recorded("opening", GripperState, "opening", "m", "between a gripper's fingers",
                 per="hand"),
        Recorded("grip", GripDrive, "force", "N", "command to a gripper's motor", per="hand"),
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
    def move(me: Me, drive: GripDrive, mj: MuJoCo) -> None:
        ctrl, qpos = words(mj.ctrl, mj.nu), words(mj.qpos, mj.nq)
        for h in range(me.n):
            if me.control[h] >= 0:
                ctrl[me.control[h]] = drive.force[h]
                if me.length > 0.0:
                    closed = qpos[me.fingers[h, 0]] + qpos[me.fingers[h, 1]]
                    ctrl[me.control[h]] *= math.cos(me.angle - 0.5 * closed)
