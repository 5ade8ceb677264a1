"""Assistance for an operator who moves a tool or hand into contact, along the contact's axis only.

The robot applies it to the speed that the stick commands. Levels:

- `none`: the stick's speed, unchanged, equation (24);
- `slow`: the speed into the contact is limited near the contact; requires the surveyed gap;
- `guard`: the speed into the contact falls with the measured force and is zero at LIMIT times the
  requested force; above that the robot backs off;
- `hold`: from the first touch on the robot controls the force to the requested value. Pulling the
  stick back ends this.
"""

from __future__ import annotations

from typing import Literal

from skywright.vehicle.plant import MISSION_TICK

Level = Literal["none", "slow", "guard", "hold"]

SLOW_MPS = 0.006  # m/s, into the contact, at its surveyed place and beyond
SLOW_RATE = 0.4  # 1/s, increase of the speed limit with the gap
LIMIT = 1.25  # force at which the guard stops the motion, relative to the requested force
BACK_MPS = 0.02  # m/s, backwards, at a force of twice the guard's limit
TOUCH = 0.15  # force from which on it is held, relative to the requested force
HOLD_MPS_PER_N, HOLD_MPS = 0.006, 0.01
"""m/s per newton of force error, and its limit: 0.9 rad/s on a contact of 150 N/m."""
PULL, PULL_S = 0.5, 0.3  # deflection, and time (s), after which the operator has control again
FREE_S = 1.0  # s without force, after which holding ends


class Assistance:
    """One level of assistance during one contact."""

    def __init__(self, level: Level, asked: float) -> None:
        """`asked` (N) is the requested force."""
        self.level, self.asked = level, asked
        self.holding = False
        self._pulled = self._free = 0.0

    def step(self, axis: float, v_max: float, gap: float, force: float) -> float:
        """Return the speed (m/s) into the contact for one tick.

        `axis` is the stick's deflection into the contact (-1 to 1), `v_max` (m/s) the speed at full
        deflection, `gap` (m) the surveyed distance to the contact, `force` (N) the measured force.
        """
        v = v_max * axis
        if self.level == "slow":
            return min(v, SLOW_MPS + SLOW_RATE * max(gap, 0.0))
        if self.level == "guard":
            room = 1.0 - force / (LIMIT * self.asked)
            return min(v, (v_max if room > 0.0 else BACK_MPS) * max(room, -1.0))
        if self.level == "hold" and self._holds(axis, force):
            return min(max(HOLD_MPS_PER_N * (self.asked - force), -HOLD_MPS), HOLD_MPS)
        return v

    def _holds(self, axis: float, force: float) -> bool:
        """Return whether the robot controls the force in this tick."""
        self._pulled = self._pulled + MISSION_TICK if axis < -PULL else 0.0
        self._free = self._free + MISSION_TICK if force < TOUCH * self.asked else 0.0
        if self._pulled > PULL_S or self._free > FREE_S:
            self.holding = False
        elif self._free == 0.0:
            self.holding = True
        return self.holding
