"""World files: the built-in ones and the user's own."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skywright.core.catalog import Entry, Found, find_file, list_entries
from skywright.core.spec import Source
from skywright.core.toml_files import load_layer
from skywright.core.validation import validate_root
from skywright.description.parts import normalise_layer, type_parts
from skywright.description.world.spec import World
from skywright.errors import InputError

DATA = Path(__file__).parent / "data"


def list_worlds() -> list[Entry]:
    """List the built-in worlds."""
    return list_entries(DATA, "world")


def find_world(name: str | os.PathLike[str], folders: Sequence[Path] = ()) -> Found:
    """Find a world file by built-in name or path; see `core.catalog.find_file`."""
    return find_file(name, DATA, "world", folders)


def load_world(name: str | os.PathLike[str]) -> tuple[World, dict[str, Source]]:
    """Load a world alone: (world, sources by dotted key `world...`).

    Raises InputError on an unknown name or anything wrong in the file.
    """
    found = find_world(name)
    layer = normalise_layer(load_layer(found.path, found.label), found.path.parent)
    if "world" not in layer.tree:
        raise InputError(
            f"{found.label}: no [world] table; the file holds: {', '.join(layer.tree)}"
        )
    spec = type_parts(World, "world", layer.tree)
    world: Any = validate_root(spec, layer.tree["world"], "world", {}, found.label)
    return world, {k: s for k, s in layer.sources.items() if k.startswith("world.")}
