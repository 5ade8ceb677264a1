"""World files: the built-in ones and the user's own."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from skywright.core.catalog import Entry, Found, find_file, list_entries, list_folders
from skywright.core.spec import Source
from skywright.core.toml_files import Layer
from skywright.core.validation import validate_root
from skywright.description.parts import type_parts
from skywright.description.renamed import load_layer
from skywright.description.world.old_tables import translate_layer
from skywright.description.world.spec import World
from skywright.errors import InputError

DATA = Path(__file__).parent / "data"


def list_worlds() -> list[Entry]:
    """List the built-in worlds."""
    return list_entries(list_folders(DATA, "world"), "world")


def find_world(name: str | os.PathLike[str], folders: Sequence[Path] = ()) -> Found:
    """Find a world file by built-in name or path; see `core.catalog.find_file`."""
    return find_file(name, list_folders(DATA, "world"), "world", folders)


def load_world_layer(found: Found, problems: list[str] | None = None) -> Layer:
    """Load a world file as a layer; see `core.toml_files.load_layer`."""
    return read_things(load_layer(found.path, found.label, problems), found.path.parent, {})


def read_things(layer: Layer, folder: Path, below: Mapping[str, Any]) -> Layer:
    """Translate old tables of a layer's world; things of a file's kind are searched in `folder`.

    `below` is the tree that the layer modifies.
    """
    layer = translate_layer(layer, below)
    world = layer.tree.get("world")
    things = world.get("things") if isinstance(world, dict) else None
    for table in things.values() if isinstance(things, dict) else ():
        kind = table.get("kind") if isinstance(table, dict) else None
        file, _, name = kind.rpartition(":") if isinstance(kind, str) else ("", "", "")
        if file.endswith(".py") and (folder / file).is_file():
            table["kind"] = f"{(folder / file).resolve()}:{name}"
    return layer


def load_world(name: str | os.PathLike[str]) -> tuple[World, dict[str, Source]]:
    """Load a world alone: (world, sources by dotted key `world...`).

    Raises InputError on an unknown name or any error in the file.
    """
    found = find_world(name)
    layer = load_world_layer(found)
    if "world" not in layer.tree:
        raise InputError(
            f"{found.label}: no [world] table; the file contains: {', '.join(layer.tree)}"
        )
    typed: Any = type_parts(World, "world", layer.tree)
    world: World = validate_root(typed, layer.tree["world"], "world", {}, found.label)
    return world, {k: s for k, s in layer.sources.items() if k.startswith("world.")}
