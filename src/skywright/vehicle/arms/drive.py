"""Shaft angles to the position servos."""

from __future__ import annotations

from typing import Any

from skywright.core.record import Record
from skywright.vehicle.arms.joints import ArmComponent
from skywright.vehicle.bus import ServoDrive, ShaftCommand
from skywright.vehicle.component import Out


class PositionDrive(ArmComponent):
    """Tells the servos what the arms' law commands."""

    slot = "allocate"

    class Me(Record):
        n_joints: int

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Count the joints."""
        me.n_joints = context.model["n_joints"]

    @staticmethod
    def step(me: Me, cmd: ShaftCommand, drive: Out[ServoDrive]) -> None:
        for j in range(me.n_joints):
            drive.motor[j] = cmd.theta[j]
