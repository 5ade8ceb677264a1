"""A push from outside: an obstacle that is met, a bird, a hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.record import Record, Vec3
from skywright.core.spec import Positive
from skywright.errors import InputError
from skywright.models.fixed_body import list_moving
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import Fault, words

DRAWN_S, DRAWN_SHARE = 0.3, 0.5
"""s, and of the platform's weight: a bump that a mission draws."""


class Bump(Fault):
    """A force on a body, at its centre of mass, for `for_s`."""

    class Table(Fault.Table):
        """Which body, how long, and the force in W."""

        body: str = "platform"
        for_s: Positive = 0.3
        force_x_n: float = 0.0
        force_y_n: float = 0.0
        force_z_n: float = 0.0

    class Me(Record):
        start: float  # s
        end: float  # s
        body: int
        f_W: Vec3  # N

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the body; raises InputError if there is none of that name."""
        model = context.scene.model
        names = list_moving(model)
        if table.body not in names:
            raise InputError(
                f"plant.faults.{self.name}.body: unknown body {table.body!r}; valid: "
                f"{', '.join(names)}"
            )
        me.start, me.end = table.start_s, table.start_s + table.for_s
        me.body = model.body(table.body).id
        me.f_W[:] = [table.force_x_n, table.force_y_n, table.force_z_n]

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Half of the platform's weight from any side."""
        angle = float(rng.uniform(-np.pi, np.pi))
        force = DRAWN_SHARE * robot.platform.mass_kg * world.gravity_mps2
        return {
            "for_s": DRAWN_S,
            "force_x_n": force * float(np.cos(angle)),
            "force_y_n": force * float(np.sin(angle)),
        }

    @staticmethod
    def step(me: Me, clock: Clock, mj: MuJoCo) -> None:
        if me.start <= clock.t < me.end:
            xfrc = words(mj.xfrc, 6 * mj.nbody)
            for a in range(3):
                xfrc[6 * me.body + a] += me.f_W[a]
