"""The spec of a mission: the common keys, and the task of its kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from skywright.core.find import find
from skywright.description.mission.spec import Mission, Task
from skywright.description.parts import type_parts
from skywright.errors import InputError


def find_mission_spec(kind: object, folders: Sequence[Path] = ()) -> tuple[str, type[Mission[Any]]]:
    """Return a kind's resolved name (the path of a file is absolute) and its missions' spec.

    Raises InputError where there is no such kind.
    """
    found = find("kind", kind, folders, "mission.kind")
    task = found.cls.task if hasattr(found.cls, "task") else None
    if not isinstance(task, type) or not issubclass(task, Task):
        raise InputError(f"mission.kind: {found.name!r} lacks a class of tasks: task = ...")
    mission: Any = Mission  # the task is known at run time only
    return found.name, mission[task]


def revive_mission(kind: str, values: Mapping[str, Any]) -> Mission[Any]:
    """Build a mission from what `Mission.__reduce__` wrote."""
    spec: Any = type_parts(find_mission_spec(kind)[1], "mission", {"mission": dict(values)})
    mission: Mission[Any] = spec.model_validate(values)
    return mission
