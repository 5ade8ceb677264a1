"""Movable things of the world: their poses, and the release of stuck ones."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Integers, Record
from skywright.core.types import MAX_OBJECTS
from skywright.models.things._build import PULL
from skywright.vehicle.bus import MuJoCo
from skywright.vehicle.component import Component, Out, Output, Recorded, words
from skywright.vehicle.plant import SAMPLE_RATE


class Objects(Output):
    """Poses of the movable things, in the world's order."""

    p_WO: Annotated[Array, MAX_OBJECTS, 3]  # m
    q_WO: Annotated[Array, MAX_OBJECTS, 4]


class ObjectObserver(Component):
    """Fills Objects before a sample is recorded."""

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
        """Worlds with movable things have it."""
        if len(context.scene.places.object_qpos):
            yield cls("objects")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the things."""
        found = context.scene.places.object_qpos
        me.n = len(found)
        me.qpos[: me.n] = found

    def get_period(self, step: str, context: Any) -> float:
        """Once per sample."""
        return 1.0 / SAMPLE_RATE

    @staticmethod
    def step(me: Me, mj: MuJoCo, out: Out[Objects]) -> None:
        qpos = words(mj.qpos, mj.nq)
        for i in range(me.n):
            at = me.qpos[i]
            for a in range(3):
                out.p_WO[i, a] = qpos[at + a]
            for a in range(4):
                out.q_WO[i, a] = qpos[at + 3 + a]


class Holds(Component):
    """Releases stuck things if the mean pull over a mission tick exceeds their holding force.

    The mean is used because the impact of a first touch lasts about a millisecond and does not
    release a thing; whether a force at one instant contains it is chance.
    """

    slot, side = "fast", "plant"

    class Me(Record):
        n: int
        touch: Annotated[Integers, MAX_OBJECTS]  # addresses of the contact sensors
        steps: int  # physics steps that are summed
        sum_W: Annotated[Array, MAX_OBJECTS, 3]  # N, sum of the contact force on each

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Worlds with stuck things have it."""
        if any(thing.frees_at_n is not None for thing in context.world.things.values()):
            yield cls("holds")

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the sensors and the welds."""
        model, things = context.scene.model, context.world.things
        stuck = {n: t.frees_at_n for n, t in things.items() if t.frees_at_n is not None}
        self._me, self._sim = me, context.sim
        self._held = {
            i: (model.equality(f"hold {name}").id, force)
            for i, (name, force) in enumerate(stuck.items())
        }
        me.n = len(stuck)
        me.touch[: me.n] = [int(model.sensor(PULL + name).adr[0]) for name in stuck]

    @staticmethod
    def step(me: Me, mj: MuJoCo) -> None:
        sensordata = words(mj.sensordata, mj.nsensor)
        for i in range(me.n):
            for a in range(3):
                me.sum_W[i, a] += sensordata[me.touch[i] + a]
        me.steps += 1

    def after_tick(self, t: float) -> None:
        """Release the things whose mean pull exceeded their holding force."""
        me = self._me
        for i, (equality, force) in list(self._held.items()):
            if float(np.linalg.norm(me.sum_W[i])) > force * max(int(me.steps), 1):
                self._sim.data.eq_active[equality] = 0
                del self._held[i]
        me.sum_W[:] = 0.0
        me.steps = 0

    def save(self) -> Any:
        """Return the things that are still stuck."""
        return dict(self._held)

    def restore(self, saved: Any) -> None:
        """Restore the things that are still stuck."""
        self._held = dict(saved)
