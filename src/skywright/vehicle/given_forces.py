"""External forces begin anew in each tick, from those that somebody asked for; effects add."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from skywright.core.record import Array, Record
from skywright.errors import InputError
from skywright.models.fixed_body import list_moving
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, words


class GivenForces(Component):
    """The one row that clears MuJoCo's external forces."""

    slot, side = "clear", "plant"

    class Me(Record):
        given: int  # address of (nbody, 6) N, N m

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Initially no body is pushed."""
        self._model = context.scene.model
        self.given: Array = np.zeros((self._model.nbody, 6))
        me.given = context.keep(self.given)

    def push(self, body: str, f_W: Array) -> None:
        """Apply a force (3,) N to a body of the robot, at its centre of mass, until told otherwise.

        Raises InputError for an unknown body.
        """
        names = list_moving(self._model)
        if body not in names:
            raise InputError(f"unknown body {body!r}; valid: {', '.join(names)}")
        self.given[self._model.body(body).id, :3] = f_W

    def save(self) -> Any:
        """Return the present forces."""
        return self.given.copy()

    def restore(self, saved: Any) -> None:
        """Push that again."""
        self.given[:] = saved

    @staticmethod
    def step(me: Me, mj: MuJoCo) -> None:
        given, xfrc = words(me.given, 6 * mj.nbody), words(mj.xfrc, 6 * mj.nbody)
        for i in range(6 * mj.nbody):
            xfrc[i] = given[i]

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every vehicle has them."""
        yield cls("given forces")
