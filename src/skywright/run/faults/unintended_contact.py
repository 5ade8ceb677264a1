"""A push where the robot means to touch nothing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skywright.core.spec import NonNegative
from skywright.run.faults._rule import Follow, Response, Rule

if TYPE_CHECKING:
    from skywright.run.faults._senses import Senses

USUAL_S = 2.0
"""s, lag of what counts as usual: wind and errors of the model."""
FREE_S = 2.0
"""s without contact before a force counts as unintended."""


class UnintendedContact(Rule):
    """The external force as estimated, less what it has been, over the robot's weight."""

    watches = (
        "estimated external force, less its mean of 2 s, over the weight, while nothing is "
        "to be touched"
    )
    unit = ""
    source = "above what gusts of 3 m/s and the hardest built-in manoeuvre show"
    every = 1

    class Table(Rule.Table):
        """Limit as a share of the weight."""

        limit: NonNegative = 0.25
        hold_s: NonNegative = 0.06
        response: Response = "come_home"

    def __init__(self, name: str, table: Any = None) -> None:
        super().__init__(name, table)
        self._usual, self._free = Follow(USUAL_S), 0.0

    def begin(self, v: Senses) -> None:
        self._free = v.t

    def look(self, v: Senses) -> float:
        from skywright.vehicle.arms.ports import Wrench
        from skywright.vehicle.bus import Body

        if v.engaged:
            self._free, self._usual = v.t, Follow(USUAL_S)
            return float("nan")
        wrench, body = v.get(Wrench), v.get(Body)
        f_W = np.array(v.estimate["f_ext_W"] if wrench is None else wrench.f_rest_W)
        off = math.hypot(*(f_W - self._usual.step(v.t, f_W)).tolist())
        if not v.t - self._free > FREE_S:
            return float("nan")
        return off / float(body.mass * body.gravity)
