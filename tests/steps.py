"""A component's step, compiled, on records of one's own: to test it without a vehicle."""

from __future__ import annotations

import inspect
from collections.abc import Collection
from functools import cache
from typing import Any

import numpy as np
from numba import njit

from skywright.core.compiled import COMPILE
from skywright.vehicle.component import Component
from skywright.vehicle.ports import list_steps


@cache  # compiling takes seconds
def _compile(step: Any, names: tuple[str, ...], absent: frozenset[str]) -> Any:
    given = ", ".join(n for n in names if n not in absent)
    arguments = ", ".join("None" if n in absent else f"{n}[0]" for n in names)
    scope: dict[str, Any] = {"step": njit(**COMPILE)(step)}  # kept on the disk
    exec(f"def run({given}):\n    step({arguments})\n", scope)
    return njit(error_model="numpy")(scope["run"])


class Stepped:
    """A step and its records, each as an attribute of its parameter's name; call it to run."""

    def __init__(self, component: Component, absent: Collection[str] = ()) -> None:
        """`absent` are the optional ports that nothing fills."""
        step = list_steps(component)[0]
        self._ports = [p for p in step.ports if p.name not in absent]
        self._run = _compile(step.function, tuple(p.name for p in step.ports), frozenset(absent))
        self._arrays = [np.zeros(1, p.record.dtype) for p in self._ports]
        for port, array in zip(self._ports, self._arrays, strict=True):
            setattr(self, port.name, array[0])
        assert inspect.isfunction(step.function)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    def __call__(self) -> None:
        """Run one tick."""
        self._run(*self._arrays)
