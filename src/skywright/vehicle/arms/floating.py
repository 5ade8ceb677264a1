"""Response of the platform while a joint without a servo swings freely."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.description.robot.limbs import list_joints
from skywright.models.body_records import BodyModel, Kinematics
from skywright.models.floating import fill_floating
from skywright.vehicle.arms.ports import Floating, Wrench
from skywright.vehicle.bus import Body
from skywright.vehicle.component import Component, Out


class FloatingBody(Component):
    """Fills Floating each tick, for a law that reads it."""

    slot = "control"

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield one where the platform's law has such a port."""
        if {Floating, Wrench} & context.asked:
            yield cls("floating")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Find the joint."""
        context.records[Floating, ""]["swing"] = find_free_joint(context.robot)

    @staticmethod
    def step(model: BodyModel, kin: Kinematics, body: Body, out: Out[Floating]) -> None:
        fill_floating(model, kin, body, out)


def find_free_joint(robot: Any) -> int:
    """Return the index in q of the joint without a servo, -1 for none."""
    free = [j for j, limb in enumerate(list_joints(robot)) if limb.servo < 0]
    return free[-1] if free else -1
