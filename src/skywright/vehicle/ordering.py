"""The order of a schedule's rows: by slot, and within a slot by the use of records."""

from __future__ import annotations

import graphlib
from collections.abc import Callable, Sequence
from typing import Any

from skywright.errors import InputError
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import SLOTS, Draws
from skywright.vehicle.ports import FILL, READ, Port, Step

Resolve = Callable[[Step, Port], Any]
"""Returns the key of the record of a step's port, None if the record is absent."""


def order_steps(steps: Sequence[Step], resolve: Resolve) -> list[Step]:
    """Return the steps in the order in which they run.

    Within a slot the step that fills a record comes first, then the step that changes it, then
    those that read it; remaining ties are ordered by name. Raises InputError if two steps fill or
    two steps change the same record in a slot, or for a cycle.
    """
    out: list[Step] = []
    for slot in SLOTS:
        mine = sorted(
            (s for s in steps if s.slot == slot), key=lambda s: (s.component.name, s.name)
        )
        uses = [_list_uses(s, resolve) for s in mine]
        graph: dict[int, set[int]] = {i: set() for i in range(len(mine))}
        for i, a in enumerate(uses):
            for j, b in enumerate(uses):
                if i == j:
                    continue
                if mine[i].component is mine[j].component:
                    if j < i:  # in the order of their class
                        graph[i].add(j)
                    continue
                for key in a.keys() & b.keys():
                    if b[key] < a[key]:
                        graph[i].add(j)
                    elif i < j and a[key] == b[key] < READ:
                        verb = "fill" if a[key] == FILL else "change"
                        raise InputError(
                            f"slot {slot!r}: {mine[i].label} and {mine[j].label} both {verb} "
                            f"{_name(key)}"
                        )
        try:
            out += [mine[i] for i in graphlib.TopologicalSorter(graph).static_order()]
        except graphlib.CycleError as error:
            circle = " < ".join(mine[i].label for i in error.args[1])
            raise InputError(
                f"slot {slot!r}: circular dependency, each reads the output of the next: {circle}"
            ) from None
    return out


def _list_uses(step: Step, resolve: Resolve) -> dict[Any, int]:
    """Return the use of each record by a step, except clock, MuJoCo's arrays and random numbers."""
    uses: dict[Any, int] = {}
    for port in step.ports:
        if port.record in (Clock, MuJoCo) or issubclass(port.record, Draws):
            continue
        key = resolve(step, port)
        if key is not None:
            uses[key] = min(port.use, uses.get(key, READ))
    return uses


def _name(key: Any) -> str:
    return str(key[0].__qualname__)
