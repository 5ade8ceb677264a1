"""Robot files: the built-in ones and the user's own."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from skywright.core.catalog import Entry, Found, find_file, list_entries
from skywright.core.keys import apply_assignments
from skywright.core.spec import Source
from skywright.core.toml_files import load_layer, merge_layers
from skywright.core.validation import validate_root
from skywright.errors import InputError
from skywright.robots.spec import Robot

DATA = Path(__file__).parent / "data"


def list_robots() -> list[Entry]:
    """List the built-in robots."""
    return list_entries(DATA, "robot")


def find_robot(name: str | os.PathLike[str], folders: Sequence[Path] = ()) -> Found:
    """Find a robot file by built-in name or path; see `core.catalog.find_file`."""
    return find_file(name, DATA, "robot", folders)


def load_robot(
    name: str | os.PathLike[str], assignments: Sequence[tuple[str, object]] = ()
) -> tuple[Robot, dict[str, Source]]:
    """Load a robot alone: (robot, sources by dotted key `robot...`).

    `assignments` are (dotted key `robot...`, value) pairs laid over the file.

    Raises InputError on an unknown name or anything wrong in the file.
    """
    found = find_robot(name)
    layer = load_layer(found.path, found.label)
    if "robot" not in layer.tree:
        raise InputError(
            f"{found.label}: no [robot] table; the file holds: {', '.join(layer.tree)}"
        )
    layers = [layer]
    if assignments:
        layers.append(apply_assignments(layer.tree, list(assignments), {"robot": Robot}))
    tree, sources, origin = merge_layers(layers)
    robot = validate_root(Robot, tree["robot"], "robot", origin, found.label)
    return robot, {k: s for k, s in sources.items() if k.startswith("robot.")}
