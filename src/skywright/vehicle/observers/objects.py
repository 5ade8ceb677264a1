"""The world's movable things: their poses; and stuck ones that are pulled harder than they hold."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_OBJECTS
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Out, Output, Recorded, words
from skywright.vehicle.plant import SAMPLE_RATE


class Objects(Output):
    """Poses of the movable things, in the world's order."""

    p_WO: Annotated[Array, MAX_OBJECTS, 3]  # m
    q_WO: Annotated[Array, MAX_OBJECTS, 4]


class ObjectObserver(Component):
    """Fills Objects before a sample is recorded; lets go of what is pulled off after a tick."""

    slot, side = "derive", "plant"

    class Me(Record):
        n: int
        qpos: Annotated[Integers, MAX_OBJECTS]

    columns = tuple(
        column
        for i in range(MAX_OBJECTS)
        for column in (
            Recorded(f"object{i}_p_WO", Objects, "p_WO", "m", "thing", item=i, per="object"),
            Recorded(
                f"object{i}_q_WO", Objects, "q_WO", "", "thing, attitude", item=i, per="object"
            ),
        )
    )

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with movable things have one."""
        if len(context.scene.places.object_qpos):
            yield cls("objects")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the things, and the welds of those that are stuck."""
        found, model = context.scene.places.object_qpos, context.scene.model
        me.n = len(found)
        me.qpos[: me.n] = found
        self._sim = context.sim
        self._held = {
            name: (
                model.equality(f"hold {name}").id,
                int(model.sensor(f"touch {name}").adr[0]),
                thing.frees_at_n,
            )
            for name, thing in context.world.things.items()
            if thing.frees_at_n is not None
        }

    def get_period(self, step: str, context: Any) -> float:
        """Once a sample."""
        return 1.0 / SAMPLE_RATE

    def after_tick(self, t: float) -> None:
        """Free the stuck things that are pulled harder than they are held."""
        for name, (equality, address, force) in list(self._held.items()):
            pull = self._sim.sensordata[address : address + 3]
            if float(np.linalg.norm(pull)) > force:
                self._sim.data.eq_active[equality] = 0
                del self._held[name]

    def save(self) -> Any:
        """What is still stuck."""
        return dict(self._held)

    def restore(self, saved: Any) -> None:
        """Stick it again."""
        self._held = dict(saved)

    @staticmethod
    def step(me: Me, mj: MuJoCo, out: Out[Objects]) -> None:
        qpos = words(mj.qpos, mj.nq)
        for i in range(me.n):
            at = me.qpos[i]
            for a in range(3):
                out.p_WO[i, a] = qpos[at + a]
            for a in range(4):
                out.q_WO[i, a] = qpos[at + 3 + a]
