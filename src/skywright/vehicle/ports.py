"""The ports of a step, read from its annotations."""

from __future__ import annotations

import inspect
import sys
import types
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

from skywright.core.record import Record
from skywright.core.user_files import is_user_module
from skywright.errors import InputError
from skywright.vehicle.bus import Setpoint
from skywright.vehicle.component import SLOTS, Component, Draws
from skywright.vehicle.native import MAX_PORTS

FILL, CHANGE, READ = range(3)
"""Use of a port by a step; within a slot the rows of a port run in this order."""


class Port(NamedTuple):
    """A parameter of a step."""

    name: str
    record: type[Record]
    use: int  # FILL, CHANGE or READ
    optional: bool


class Step(NamedTuple):
    """A step of a component's instance."""

    component: Component
    name: str
    function: Callable[..., None]  # undecorated
    compiled: Any  # function that numba compiles
    slot: str
    ports: list[Port]

    @property
    def label(self) -> str:
        """Name in messages."""
        cls = type(self.component)
        return f"{self.component.name} ({cls.__qualname__}.{self.name}{name_file(cls)})"


def name_file(cls: type) -> str:
    """Return " in FILE" for a class of a user's file, else ""."""
    file = sys.modules[cls.__module__].__file__ if is_user_module(cls.__module__) else None
    return f" in {Path(file).name}" if file else ""


def list_steps(component: Component) -> list[Step]:
    """Return the steps of an instance.

    Raises InputError for a class without a step, an unknown slot, or a parameter that is not a
    port.
    """
    cls = type(component)
    slots = cls.slots or {"step": cls.slot}
    out = []
    for name, slot in slots.items():
        found = inspect.getattr_static(cls, name, None)
        if not isinstance(found, staticmethod):
            raise InputError(
                f"component {component.name!r}: {cls.__qualname__}{name_file(cls)} has no static "
                f"method {name!r}; "
                "a component has a step: @staticmethod def step(me: Me, ...)"
            )
        if slot not in SLOTS:
            raise InputError(
                f"component {component.name!r}: slot {slot!r} of {cls.__qualname__}.{name} is "
                f"unknown; valid: {', '.join(SLOTS)}"
            )
        function = getattr(found.__func__, "py_func", found.__func__)
        out.append(
            Step(component, name, function, found.__func__, slot, _read_ports(component, function))
        )
    return out


def _list_records(cls: Any) -> Mapping[str, type[Record]]:
    """Return the records that a component's class defines, by name; those of bases first."""
    return {
        name: value
        for base in reversed(cls.__mro__)
        for name, value in vars(base).items()
        if isinstance(value, type) and issubclass(value, Record)
    }


list_records: Callable[[Any], Mapping[str, type[Record]]] = cache(_list_records)
"""`_list_records`, cached: building a vehicle calls it some hundred times."""


def _read_ports(component: Component, function: Callable[..., None]) -> list[Port]:
    where = f"component {component.name!r}: {function.__qualname__}{name_file(type(component))}"
    try:
        hints = get_type_hints(
            function, localns=dict(list_records(type(component))), include_extras=True
        )
    except NameError as error:
        raise InputError(f"{where}: an annotation is unknown: {error}") from error
    out = []
    for name in inspect.signature(function).parameters:
        if name not in hints:
            raise InputError(
                f"{where}: parameter {name!r} has no annotation; the annotation selects the port"
            )
        hint, optional = hints[name], False
        if get_origin(hint) in (Union, types.UnionType):
            hints_ = [h for h in get_args(hint) if h is not type(None)]
            optional = len(hints_) < len(get_args(hint))
            hint = hints_[0]
        marks = [m for m in getattr(hint, "__metadata__", ()) if m in ("out", "inout")]
        kind = get_args(hint)[0] if marks else hint
        if not (isinstance(kind, type) and issubclass(kind, Record)):
            raise InputError(
                f"{where}: parameter {name!r} is {kind!r}; a port is a Record, such as Estimate"
            )
        use = READ if not marks else FILL if marks[0] == "out" else CHANGE
        own = list_records(type(component)).values()
        if kind is getattr(type(component), "Me", None) or (
            issubclass(kind, Setpoint) and kind in own
        ):
            use = FILL  # it belongs to the component
        out.append(Port(name, kind, READ if issubclass(kind, Draws) else use, optional))
    if len(out) > MAX_PORTS:
        raise InputError(f"{where} has {len(out)} ports; valid: at most {MAX_PORTS}")
    return out


def overrides(component: Component, method: str) -> bool:
    """Return whether the class of a component overrides a method of Component."""
    return getattr(type(component), method) is not getattr(Component, method)
