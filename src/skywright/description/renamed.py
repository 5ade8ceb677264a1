"""Renamed keys: files and assignments that use the old name still load.

RENAMED has one line per key or table. The use of an old name prints the new one on standard error,
once per file.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from skywright.core import toml_files
from skywright.core.bounded import LARGEST_TOML, read_text
from skywright.core.toml_files import Layer, Tree
from skywright.description.parts import normalise_layer
from skywright.errors import InputError

RENAMED: Mapping[str, str] = {
    "mission.scan": "mission.task",
    "mission.waypoints": "mission.task.points",
}
"""Old key -> new key; everything below a table moves with it."""


def load_layer(path: Path, label: str | None = None, problems: list[str] | None = None) -> Layer:
    """Load one description file like `core.toml_files.load_layer`, with old keys renamed."""
    if problems is None:
        label = label or str(path)
        layer: Layer = pickle.loads(_build_layer(read_text(path, LARGEST_TOML, label=label), label))
    else:
        layer = toml_files.load_layer(path, label, problems)
    return normalise_layer(rename_keys(layer), path.parent)


@lru_cache(maxsize=32)
def _build_layer(text: str, label: str) -> bytes:
    """Parse a text once, because a hundred runs load the same robot; the caller may change its
    copy."""
    return pickle.dumps(toml_files.build_layer(text, label))


def rename_keys(layer: Layer) -> Layer:
    """Return the layer with new names; an empty value under an old name is dropped.

    Raises InputError if both names have a value.
    """
    for old, new in RENAMED.items():
        table, name = _find_parent(layer.tree, old)
        if table is None or name not in table:
            continue
        value = table.pop(name)
        if value in ({}, []):
            continue
        _tell(layer.label, old, new)
        _put(layer.tree, new.split("."), value, layer.label, old)
        layer = layer._replace(sources={_replace(k, old, new): s for k, s in layer.sources.items()})
    return layer


def rename_key(key: str, label: str = "--set") -> str:
    """Return the present name of a dotted key."""
    for old, new in RENAMED.items():
        if key == old or key.startswith(old + "."):
            _tell(label, old, new)
            return _replace(key, old, new)
    return key


def _replace(key: str, old: str, new: str) -> str:
    return new + key[len(old) :] if key == old or key.startswith(old + ".") else key


def _find_parent(tree: Tree, key: str) -> tuple[Tree | None, str]:
    """Return the table that contains a dotted key (or None), and the last part of the key."""
    *parents, name = key.split(".")
    table: Any = tree
    for parent in parents:
        table = table.get(parent) if isinstance(table, dict) else None
    return (table if isinstance(table, dict) else None), name


def _put(tree: Tree, path: list[str], value: Any, label: str, old: str) -> None:
    """Write a value at `path`; a table is merged into an existing one."""
    key = ".".join(path)
    *parents, name = path
    for parent in parents:
        child = tree.setdefault(parent, {})
        if not isinstance(child, dict):
            raise InputError(f"{label}: {old} is now {key}, and {parent} is no table here")
        tree = child
    here = tree.get(name)
    if isinstance(here, dict) and isinstance(value, dict):
        for child, inner in value.items():
            _put(here, [child], inner, label, f"{old}.{child}")
    elif name in tree:
        raise InputError(f"{label}: {old} is now {key}, and both are given; keep the new one")
    else:
        tree[name] = value


@lru_cache
def _tell(label: str, old: str, new: str) -> None:
    print(f"skywright: {label}: {old} is now called {new}", file=sys.stderr)
