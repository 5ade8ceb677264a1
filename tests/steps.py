"""A component's step, compiled, on records of one's own: to test it without a vehicle."""

from __future__ import annotations

import inspect
from collections.abc import Collection
from typing import Any

import numpy as np
from numba import njit

from skywright.vehicle.component import Component
from skywright.vehicle.ports import list_steps


class Stepped:
    """A step and its records, each as an attribute of its parameter's name; call it to run."""

    def __init__(self, component: Component, absent: Collection[str] = ()) -> None:
        """`absent` are the optional ports that nothing fills."""
        step = list_steps(component)[0]
        self._ports = [p for p in step.ports if p.name not in absent]
        names = [p.name for p in step.ports]
        arguments = ", ".join("None" if n in absent else f"{n}[0]" for n in names)
        source = f"def run({', '.join(p.name for p in self._ports)}):\n    step({arguments})\n"
        scope: dict[str, Any] = {"step": njit(error_model="numpy")(step.function)}
        exec(source, scope)
        self._run = njit(error_model="numpy")(scope["run"])
        self._arrays = [np.zeros(1, p.record.dtype) for p in self._ports]
        for port, array in zip(self._ports, self._arrays, strict=True):
            setattr(self, port.name, array[0])
        assert inspect.isfunction(step.function)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)

    def __call__(self) -> None:
        """Run one tick."""
        self._run(*self._arrays)
