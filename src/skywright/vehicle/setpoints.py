"""Values that a mission sets of actuators, by the names under which they are recorded.

    vehicle.actuators["winch_speed"] = 0.2

A value holds until another one is set. It goes down a link like all that the robot is told.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skywright.errors import InputError, neighbours
from skywright.vehicle.arguments import check_number, check_vector
from skywright.vehicle.component import Component, Recorded

Array = NDArray[np.float64]


class Place(NamedTuple):
    """Position of a value in a record, and the component that declares it."""

    at: Array  # () or (n,), in the robot's record
    column: Recorded
    component: Component


def check_limits(component: Component, columns: Iterable[str]) -> None:
    """Raise InputError where `limits` of a component are not (least, most) of such `columns`.

    A limit of a mistyped name would hold nothing.
    """
    where, limits = f"component {component.name!r}: limits", component.limits
    if not isinstance(limits, Mapping):
        raise InputError(f"{where} = {limits!r}; valid: {{column: (least, most)}}")
    columns = list(columns)
    for name, span in limits.items():
        if name not in columns:
            raise InputError(
                f"{where}: {name!r} is no column of a Setpoint; valid: {', '.join(columns)}"
            )
        try:
            low, high = (float(x) for x in span)
        except (TypeError, ValueError):
            low = high = math.nan
        if not low <= high:
            raise InputError(f"{where}: {name!r} = {span!r}; valid: (least, most), two numbers")


class Actuators(Mapping[str, Array]):
    """The values that a mission may set, by column; reading one gives what was set last."""

    def __init__(self, places: Mapping[str, Place], lacks: str = "none") -> None:
        """`lacks` is what there is in place of actuators."""
        self._places, self._lacks = places, lacks

    def __getitem__(self, name: str) -> Array:
        return self._find(name).at.copy()

    def __setitem__(self, name: str, value: ArrayLike) -> None:
        self._find(name).at[...] = self.check(name, value)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def check(self, name: str, value: ArrayLike) -> Array:
        """Return a value as it would be set.

        Raises InputError for a name that is unknown, another number of values, one that is not
        finite, and one beyond the limits of its component.
        """
        at, column, component = self._find(name)
        size = at.size if at.shape else 0
        out = np.array(check_vector(name, value, size) if size else check_number(name, value))
        low, high = component.limits.get(column.name, (-math.inf, math.inf))
        if not np.all((low <= out) & (out <= high)):
            told = f"{out.tolist()} {column.unit}".strip()
            raise InputError(f"{name} = {told}; valid: {low:g} to {high:g}")
        return out

    def _find(self, name: str) -> Place:
        if name not in self._places:
            valid = neighbours(name, list(self._places)) or self._lacks
            raise InputError(f"actuator {name!r} is unknown; valid: {valid}")
        return self._places[name]
