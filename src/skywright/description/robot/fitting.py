"""Check that a robot has the parts that a mission's file changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from skywright.core.toml_files import Layer, merge_layers
from skywright.description.robot.loader import find_robot, list_robots, load_robot_layers
from skywright.errors import InputError


def check_fitting(layers: Sequence[Layer], label: str, problem: str) -> None:
    """Refuse a mission that changes single keys of a part which the chosen robot lacks.

    `problem` is the message of the validation: it reports the missing keys of such a table, which
    is not the cause. `label` is that of the mission's file among `layers`.
    """
    mission = merge_layers([x for x in layers if x.label == label])[0].get("robot", {})
    tree = merge_layers([x for x in layers if x.label not in (label, "--set")])[0]
    name = merge_layers([*layers])[0]["mission"].get("robot", "")
    for table in _list_tables(mission):
        path = ".".join(table)
        if not _has(tree.get("robot", {}), table) and f": robot.{path} lacks " in problem:
            fitting = ", ".join(e.name for e in list_robots() if _has_part(e.name, table))
            if not fitting:
                return  # no robot has this part: a misspelt name, which the problem reports
            raise InputError(
                f"robot {name!r} has no [robot.{path}], which {label} needs; built-in robots "
                f"that have it: {fitting}"
            )


def _list_tables(
    tree: Mapping[str, Any], parents: tuple[str, ...] = ()
) -> Iterator[tuple[str, ...]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield (*parents, key)
            yield from _list_tables(value, (*parents, key))


def _has(tree: Mapping[str, Any], table: tuple[str, ...]) -> bool:
    here: Any = tree
    for key in table:
        here = here.get(key) if isinstance(here, dict) else None
    return isinstance(here, dict)


def _has_part(robot: str, table: tuple[str, ...]) -> bool:
    """Return whether a built-in robot has the part."""
    return _has(merge_layers(load_robot_layers(find_robot(robot)))[0]["robot"], table)
