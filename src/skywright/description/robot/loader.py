"""Robot files: the built-in ones and the user's own."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from skywright.core.catalog import Entry, Found, find_file, list_entries, list_folders
from skywright.core.keys import apply_assignments
from skywright.core.spec import Source
from skywright.core.toml_files import Layer, describe_value, merge_layers
from skywright.core.validation import validate_root
from skywright.description.parts import drop_replaced, take_kinds, type_parts
from skywright.description.renamed import load_layer
from skywright.description.robot.spec import Robot
from skywright.errors import InputError

LONGEST_CHAIN = 16
"""Largest number of robots that extend each other."""

DATA = Path(__file__).parent / "data"


def list_robots() -> list[Entry]:
    """List the built-in robots."""
    return list_entries(list_folders(DATA, "robot"), "robot")


def find_robot(name: str | os.PathLike[str], folders: Sequence[Path] = ()) -> Found:
    """Find a robot file by built-in name or path; see `core.catalog.find_file`."""
    return find_file(name, list_folders(DATA, "robot"), "robot", folders)


def load_robot_layers(
    found: Found, problems: list[str] | None = None, heirs: tuple[Path, ...] = ()
) -> list[Layer]:
    """Load a robot file and, before it, those that it extends.

    `heirs` are the files that extend it. Raises InputError on any error, including a circular
    chain.
    """
    layer = load_layer(found.path, found.label, problems)
    table = layer.tree.get("robot")
    if not isinstance(table, dict):
        raise InputError(
            f"{found.label}: no [robot] table; a robot file is required, this file "
            f"contains: {', '.join(layer.tree)}"
        )
    for other in layer.tree:
        if other not in ("robot", "plant"):
            raise InputError(
                f"{found.label}: a robot file cannot contain the table [{other}]; use a "
                "mission file"
            )
    base = table.get("extends")
    if base is None:
        return [layer]
    if not isinstance(base, str):
        raise InputError(
            f"{found.label}: robot.extends is {describe_value(base)}; a name or path is needed"
        )
    chain = (*heirs, found.path.resolve())
    if len(chain) > LONGEST_CHAIN:
        raise InputError(
            f"{found.label}: the chain of robot.extends is longer than {LONGEST_CHAIN} files"
        )
    parent = find_robot(base, [found.path.parent])
    if parent.path.resolve() in chain:
        raise InputError(f"{found.label}: robot.extends = {base!r} is circular")
    return [*load_robot_layers(parent, problems, chain), layer]


def load_robot(
    name: str | os.PathLike[str],
    assignments: Sequence[tuple[str, object]] = (),
    label: str | None = None,
) -> tuple[Robot, dict[str, Source]]:
    """Load a robot alone: (robot, sources by dotted key `robot...`).

    `assignments` are (dotted key `robot...`, value) pairs that override the file; `label` is its
    name in messages.

    Raises InputError on an unknown name or any error in the file.
    """
    found = find_robot(name)
    found = found._replace(label=label or found.label)
    layers = load_robot_layers(found)
    kinds, others = take_kinds(list(assignments), "--set")
    layers += [kinds] if kinds is not None else []
    drop_replaced(layers)
    if others:
        tree = merge_layers(layers)[0]
        spec = type_parts(Robot, "robot", tree, [key for key, _ in others])
        layers.append(apply_assignments(tree, others, {"robot": spec}))
    tree, sources, origin = merge_layers(layers)
    typed: Any = type_parts(Robot, "robot", tree)
    robot: Robot = validate_root(typed, tree["robot"], "robot", origin, found.label)
    return robot, {k: s for k, s in sources.items() if k.startswith("robot.")}
