"""Identification of a robot, world or mission by a name or a path alone."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from skywright.core.spec import Source
from skywright.core.toml_files import ROOTS
from skywright.description.loader import Description, list_missions, load_description
from skywright.description.renamed import load_layer
from skywright.description.robot.loader import list_robots, load_robot
from skywright.description.robot.spec import Robot
from skywright.description.world.loader import list_worlds, load_world
from skywright.description.world.spec import World
from skywright.errors import InputError, neighbours

KINDS = ("robot", "world", "mission")


class Subject(NamedTuple):
    """The object of a name: exactly one of robot alone, world alone, whole description."""

    kind: str
    label: str
    robot: Robot | None
    world: World | None
    description: Description | None
    sources: dict[str, Source]


def find_kind(name: str) -> tuple[str, str]:
    """Return the object of a name or path: (robot, world or mission; the name or path to load).

    Raises InputError that lists the nearest built-in names of all kinds.
    """
    listings = {"robot": list_robots, "world": list_worlds, "mission": list_missions}
    known: dict[str, str] = {}
    for kind in KINDS:
        for entry in listings[kind]():
            known.setdefault(entry.name, kind)
    if name in known:
        return known[name], name
    path = Path(name).expanduser()
    try:
        if path.is_dir():
            for kind in KINDS:
                if (path / f"{kind}.toml").is_file():
                    return kind, str(path / f"{kind}.toml")
            raise InputError(
                f"{name}: the folder contains none of robot.toml, world.toml, mission.toml"
            )
        if path.is_file():
            tree = load_layer(path, name, []).tree  # errors inside are reported later
            for kind in ("mission", "robot", "world"):
                if kind in tree:
                    return kind, str(path)
            raise InputError(
                f"{name}: contains none of [robot], [world], [mission]; valid tables: "
                + ", ".join(ROOTS)
            )
    except (OSError, ValueError):  # a name that is too long, or has a null byte
        pass
    raise InputError(
        f"unknown robot, world or mission {name!r}: no built-in name and no file; "
        f"built-in: {neighbours(name, known, count=12)}"
    )


def find_any(name: str) -> Subject:
    """Load the object of a name or path."""
    kind, path = find_kind(name)
    if kind == "robot":
        robot, sources = load_robot(path)
        return Subject(kind, name, robot, None, None, sources)
    if kind == "world":
        world, sources = load_world(path)
        return Subject(kind, name, None, world, None, sources)
    description = load_description(path)
    return Subject(kind, name, None, None, description, description.sources)
