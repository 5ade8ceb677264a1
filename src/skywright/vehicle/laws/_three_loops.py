"""Laws after Tognon 2018: loops of position, attitude and arm."""

from __future__ import annotations

from typing import Any

from skywright.description.robot.spec import Robot
from skywright.vehicle.component import Law
from skywright.vehicle.loops import (
    ArmLoop,
    AttitudeGains,
    AttitudeLoop,
    LoopsTable,
    PositionLoop,
    fill_arm,
    fill_attitude,
    fill_position,
    get_attitude_gains,
)


class ThreeLoops(Law):
    """A law with position, attitude and arm loop."""

    Table = LoopsTable

    class Me(PositionLoop, AttitudeLoop, ArmLoop):
        """Gains and integrals of the three loops."""

    def get_attitude_loop(self, robot: Robot) -> AttitudeGains:
        """Return the gains of the loop in `attitude_torque`."""
        return get_attitude_gains(self.table, robot)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Compute the gains from the bandwidths."""
        fill_position(me, table, context)
        fill_attitude(me, table, context)
        fill_arm(me, table, context)
