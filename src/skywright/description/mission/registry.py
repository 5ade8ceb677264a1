"""Kinds of missions by name: one module each (missions/kinds), imported when needed."""

from __future__ import annotations

import importlib
from typing import Any

from skywright.description.mission.spec import KINDS, TASKS, Mission


def load_kind(name: str) -> Any:
    """Return the module of a kind of mission (missions/kinds/__init__.py says what it holds)."""
    return importlib.import_module(KINDS[name])


def find_mission_spec(name: object) -> type[Mission]:
    """Return the spec of missions of a kind; the common one where the kind is unknown."""
    if not isinstance(name, str) or name not in TASKS:
        return Mission
    module, _, cls = TASKS[name].partition(":")
    spec: type[Mission] = getattr(importlib.import_module(module), cls)
    return spec
