"""Shaft angles to the position servos."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skywright.core.find import find
from skywright.core.record import Record
from skywright.models.compliant_arms import is_compliant
from skywright.vehicle.arms.joints import fill_home
from skywright.vehicle.bus import ServoDrive, ShaftCommand
from skywright.vehicle.component import Component, Out


class PositionDrive(Component):
    """Converts the command of the arms' law to commands of the servos."""

    slot = "allocate"

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Yield the drive, and the law that commands it."""
        if is_compliant(context.robot):
            kind = context.robot.control.arms_law or "compliant"
            found = find("arms_law", kind, key="robot.control.arms_law")
            yield found.cls("arms_law")
            yield cls("drive")

    class Me(Record):
        n_joints: int

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Count the joints; the servos hold where they stand."""
        me.n_joints = context.model["n_joints"]
        for (record, _), view in context.records.items():
            if record is ServoDrive:
                fill_home(view["motor"], context)

    @staticmethod
    def step(me: Me, cmd: ShaftCommand, drive: Out[ServoDrive]) -> None:
        for j in range(me.n_joints):
            drive.motor[j] = cmd.theta[j]
