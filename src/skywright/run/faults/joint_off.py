"""A joint that does not follow: stuck, or without torque."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses
    from skywright.run.supervisor import Supervisor


class JointOff(Rule):
    """Difference between the modelled and the measured angle of a servo, for the worst joint.

    The model of a position servo is (17) of Suarez 2020: a lag T_s and a speed limit, the no-load
    speed. The command alone is not a sufficient model: near the singularity of a stretched arm it
    moves at that speed, 0.35 rad ahead of a healthy servo.
    """

    watches = "difference between modelled and measured angle of a servo's shaft; the worst joint"
    unit = "rad"
    source = (
        "1.5 times the largest of the built-in missions (0.17 rad, wall-contact); a joint without "
        "torque falls through 0.5 rad in the next 0.15 s"
    )
    every = 2

    class Table(Rule.Table):
        """Limit (rad)."""

        limit: NonNegative = 0.25
        hold_s: NonNegative = 0.04
        response: Response = "come_home"

    def begin(self, v: Senses) -> None:
        from skywright.vehicle.arms.ports import ArmModel
        from skywright.vehicle.bus import Estimate, Reference, ServoDrive
        from skywright.vehicle.readings import Shafts

        n, arm = v.vehicle.n_joints, v.get(ArmModel)
        self._loose = arm is None  # while pressing, the force loop commands the joints
        told = v.place(Reference, "q") if self._loose else v.place(ServoDrive, "motor")
        seen = v.place(Estimate, "q") if self._loose else v.place(Shafts, "q")
        if n == 0 or told is None or seen is None:
            self._told = None
            return
        self._told, self._seen = told[:n], seen[:n]
        self._swing = -1 if arm is None else int(arm.swing)
        self._tau = 0.0 if arm is None else float(arm.servo_tau)
        self._speed = 0.0 if arm is None else float(arm.speed_max)
        self._model, self._held, self._t = self._seen.tolist(), self._told.tolist(), v.t

    def look(self, v: Senses) -> float:
        if self._told is None:
            return math.nan
        told = self._told.tolist()
        if not self._loose:
            dt, self._t = v.t - self._t, v.t
            gain, reach = 1.0 - math.exp(-dt / self._tau), self._speed * dt
            # a command is held for a period before it acts, and a reading has the same age
            model = zip(self._model, self._held, strict=True)
            self._model = [m + min(max((a - m) * gain, -reach), reach) for m, a in model]
            self._held, told = told, self._model
        off = [abs(a - b) for a, b in zip(told, self._seen.tolist(), strict=True)]
        if self._swing >= 0:
            off[self._swing] = 0.0  # it has no servo
        for j in v.stuck:
            off[j] = 0.0  # known: it must not hide the next one
        worst = max(off)
        self._off, self.part = off, off.index(worst) + 1
        if worst > self.table.limit and self._loose and v.told("press") > 0.0:
            return math.nan
        return worst

    def repair(self, s: Supervisor) -> Response:
        """Stop commanding each joint that is off: healthy joints would compensate for it."""
        s.senses.stuck |= {j for j, x in enumerate(self._off) if x > 0.5 * self.table.limit}
        return super().repair(s)
