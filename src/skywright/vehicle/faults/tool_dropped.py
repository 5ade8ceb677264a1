"""A carried thing slips off: for a moment its handle has no contacts."""

from __future__ import annotations

from typing import Any

import numpy as np

from skywright.core.spec import Positive
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.things._handled import Handled
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Fault


def list_handled(world: World) -> list[str]:
    """Return the names of the things that hooks can carry."""
    return [name for name, thing in world.things.items() if isinstance(thing, Handled)]


class ToolDropped(Fault):
    """The handle of a movable thing has no contacts for `for_s`, so that the robot drops it.

    A thing that stands on its base is not affected, because the base keeps its contacts.
    """

    class Table(Fault.Table):
        """The thing and the duration."""

        thing: str = "tool"
        for_s: Positive = 0.3

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Look up the geoms of the handle; raise InputError if there is no such thing."""
        self._model = model = context.scene.model
        if table.thing not in list_handled(context.world):
            raise InputError(
                f"plant.faults.{self.name}.thing: {table.thing!r} is not a thing with a "
                "handle; valid: "
                f"{', '.join(list_handled(context.world)) or 'none in this world'}"
            )
        names = [model.geom(g).name for g in range(model.ngeom)]
        self._geoms = [g for g, n in enumerate(names) if n == f"{table.thing} handle"]
        self._usual = [
            (int(model.geom_contype[g]), int(model.geom_conaffinity[g])) for g in self._geoms
        ]
        self._off = False

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Disable and re-enable the contacts of the handle."""
        off = self.table.start_s <= t < self.table.start_s + self.table.for_s
        if off != self._off:
            self._set(off)

    def _set(self, off: bool) -> None:
        for g, (kind, meets) in zip(self._geoms, self._usual, strict=True):
            self._model.geom_contype[g] = 0 if off else kind
            self._model.geom_conaffinity[g] = 0 if off else meets
        self._off = off

    def save(self) -> Any:
        """Return whether the handle is off."""
        return self._off

    def restore(self, saved: Any) -> None:
        """Restore the contacts of the handle."""
        self._set(bool(saved))

    @classmethod
    def draw_table(cls, rng: np.random.Generator, robot: Any, world: Any) -> dict[str, Any] | None:
        """Any thing with a handle; None in a world without one."""
        handled = list_handled(world)
        return {"thing": str(rng.choice(handled))} if handled else None

    @staticmethod
    def step(clock: Clock) -> None:
        """No action between mission ticks: a fall takes far longer than a tick."""
