"""Help for an operator who leads something into contact, along the axis of the contact only.

The robot applies it to the speed that the stick asks for. Levels, each with what it needs to know:

- `none`: the stick's speed as it is, equation (24);
- `slow`: near the place of the contact the speed into it is limited (the gap as surveyed);
- `guard`: the speed into the contact falls with the felt force and is zero at LIMIT of what is
  asked for; a force above it is backed off from;
- `hold`: from the first touch the robot leads the force to what is asked for. Pulling the stick
  back ends that.
"""

from __future__ import annotations

from typing import Literal

from skywright.vehicle.plant import MISSION_TICK

Level = Literal["none", "slow", "guard", "hold"]

SLOW_MPS = 0.006  # m/s, into the contact at its place and beyond
SLOW_RATE = 0.4  # 1/s: so much faster with each metre of the gap
LIMIT = 1.25  # of the force that is asked for, at which the guard stops
BACK_MPS = 0.02  # m/s, of the guard for a force that is twice its limit
TOUCH = 0.15  # of the force that is asked for: from there on it is held
HOLD_MPS_PER_N, HOLD_MPS = 0.006, 0.01
"""m/s for each N that the force is off, and at most: 0.9 rad/s on a contact of 150 N/m."""
PULL, PULL_S = 0.5, 0.3  # of the stick, and for so long (s): the operator takes the contact back
FREE_S = 1.0  # s without force, after which nothing is held any more


class Assistance:
    """One level of help during one contact."""

    def __init__(self, level: Level, asked: float) -> None:
        """`asked` (N) is the force that is to be reached."""
        self.level, self.asked = level, asked
        self.holding = False
        self._pulled = self._free = 0.0

    def step(self, axis: float, v_max: float, gap: float, force: float) -> float:
        """Return the speed (m/s) into the contact for one tick.

        `axis` (1) is the stick's part into it, `v_max` (m/s) that of a full stick, `gap` (m) how
        far the contact is away as surveyed, `force` (N) what is felt.
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
        """Whether the robot holds the force now."""
        self._pulled = self._pulled + MISSION_TICK if axis < -PULL else 0.0
        self._free = self._free + MISSION_TICK if force < TOUCH * self.asked else 0.0
        if self._pulled > PULL_S or self._free > FREE_S:
            self.holding = False
        elif self._free == 0.0:
            self.holding = True
        return self.holding
