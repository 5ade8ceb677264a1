"""The line of an exception for which compiled code states no place."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.vehicle.failed_line import NO_LINE, find_line


class Mine:
    """A component of a user."""


def build_assembly(step: Callable[[Any], None], component: object) -> Any:
    arena = np.zeros(3, np.uint8)
    return SimpleNamespace(
        steps=[SimpleNamespace(component=component)], arena=arena, run_python=lambda _: step(arena)
    )


def raise_late(arena: Any) -> None:
    arena[:] = 7
    arena[5] = 1


def test_the_line_is_that_of_a_second_run_which_changes_no_record() -> None:
    assembly = build_assembly(raise_late, Mine())
    line = raise_late.__code__.co_firstlineno + 2
    assert find_line(assembly, 0, IndexError()).endswith(f"test_failed_line.py:{line}")
    assert not assembly.arena.any()


@pytest.mark.parametrize("error", [IndexError, ValueError])
def test_a_second_run_that_raises_nothing_or_another_exception_names_the_key(
    error: type[Exception],
) -> None:
    step = raise_late if error is ValueError else (lambda arena: arena.fill(7))
    assembly = build_assembly(step, Mine())
    assert find_line(assembly, 0, error()) == NO_LINE
    assert not assembly.arena.any()


def test_a_built_in_step_does_not_run_again() -> None:
    component = type("Built", (), {"__module__": "skywright.vehicle.laws.servo"})()
    assert find_line(build_assembly(raise_late, component), 0, IndexError()) == ""
