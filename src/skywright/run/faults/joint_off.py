"""A joint that does not follow: stuck, or without torque."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses


class JointOff(Rule):
    """Commanded less measured angle of the worst servo."""

    watches = "commanded less measured angle of a servo's shaft, the worst joint"
    unit = "rad"
    source = "twice what the servos lag behind in the fastest built-in moves"
    every = 10

    class Table(Rule.Table):
        """Limit (rad)."""

        limit: NonNegative = 0.2
        hold_s: NonNegative = 0.4
        response: Response = "come_home"

    def look(self, v: Senses) -> float:
        from skywright.vehicle.arms.ports import ArmModel
        from skywright.vehicle.bus import ServoDrive
        from skywright.vehicle.readings import Shafts

        n = v.vehicle.n_joints
        if n == 0:
            return float("nan")
        arm, drive, shafts = v.get(ArmModel), v.get(ServoDrive), v.get(Shafts)
        if arm is None and v.reference["press"] > 0.0:
            return float("nan")  # the joints do what the force loop asks for
        if arm is None:
            off = np.abs(v.reference["q"][:n] - v.estimate["q"][:n])
        else:
            off = np.abs(drive.motor[:n] - shafts.q[:n])
            if arm.swing >= 0:
                off[arm.swing] = 0.0  # it has no servo
        return float(np.max(off))
