"""Which components a vehicle has: those that robot and world ask for, and those that are named."""

from __future__ import annotations

import importlib
import pkgutil
from functools import lru_cache
from typing import Any

from skywright import vehicle
from skywright.vehicle.component import Component, Context

BY_KIND = ("laws", "estimators", "faults")
"""Packages whose components are named in a description (core/find.py)."""


def list_wanted(context: Context) -> list[Component]:
    """Return the built-in components that robot and world require by tables of their own."""
    return [c for cls in list_built_in() for c in cls.wanted(context)]


@lru_cache
def list_built_in() -> tuple[type[Component], ...]:
    """Return the classes in this package that say themselves when they are wanted."""
    found: dict[type[Component], None] = {}
    for module in _import_all(vehicle.__path__, vehicle.__name__ + "."):
        for cls in vars(module).values():
            if isinstance(cls, type) and issubclass(cls, Component) and _says(cls):
                found[cls] = None
    return tuple(found)


def _says(cls: type[Component]) -> bool:
    own: Any = cls.wanted
    default: Any = Component.wanted
    return own.__func__ is not default.__func__ and not cls.__name__.startswith("_")


def _import_all(path: Any, prefix: str) -> list[Any]:
    modules = []
    for info in sorted(pkgutil.iter_modules(path, prefix), key=lambda m: m.name):
        if info.name.rpartition(".")[2] in BY_KIND:
            continue
        module = importlib.import_module(info.name)
        modules.append(module)
        if info.ispkg:
            modules += _import_all(module.__path__, info.name + ".")
    return modules
