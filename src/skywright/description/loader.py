"""Loading of a mission: robot < world < mission < assignments, validated into one description."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple

import numpy as np

from skywright.core.bounded import LARGEST_TOML
from skywright.core.catalog import Entry, Found, find_file, list_entries
from skywright.core.find import find
from skywright.core.keys import apply_assignments, parse_assignment
from skywright.core.spec import Source, Spec
from skywright.core.toml_files import Layer, describe_value, merge_layers
from skywright.core.trust import guarded
from skywright.core.validation import list_problems, validate_root
from skywright.description.map_error import displace_world
from skywright.description.mission.spec import Mission, Plant, T, find_mission_spec
from skywright.description.parts import (
    Part,
    check_named,
    drop_replaced,
    take_kinds,
    type_parts,
)
from skywright.description.renamed import load_layer, rename_key
from skywright.description.robot.fitting import check_fitting
from skywright.description.robot.loader import find_robot, load_robot_layers
from skywright.description.robot.spec import Robot
from skywright.description.world.loader import find_world, load_world_layer, read_things
from skywright.description.world.old_tables import translate_assignments
from skywright.description.world.spec import World
from skywright.errors import InputError

MISSIONS = Path(__file__).parents[1] / "missions"
"""A built-in mission is a file in the folder of its kind."""

SPECS: dict[str, type[Spec]] = {
    "robot": Robot,
    "world": World,
    "mission": Mission,
    "plant": Plant,
}
"""The four roots and their specs."""


def list_specs(
    tree: Mapping[str, Any], folders: Sequence[Path] = (), touched: Sequence[str] = ()
) -> dict[str, type[Spec]]:
    """Return the specs of the four roots, which depend on the kinds of mission and components.

    A kind in a file is searched in `folders`, then in the current folder; the tree then contains
    its absolute path. `touched` are keys that will be set. Raises InputError if there is no such
    kind.
    """
    table, specs = tree.get("mission"), dict(SPECS)
    if isinstance(table, dict) and "kind" in table:
        table["kind"], specs["mission"] = find_mission_spec(table["kind"], folders)
    return {root: type_parts(spec, root, dict(tree), touched) for root, spec in specs.items()}


Sets = Mapping[str, object] | Iterable[str]


class Description(NamedTuple, Generic[T]):
    """All inputs of a plan or a run; T is the task of the mission's kind."""

    robot: Robot
    world: World
    mission: Mission[T]
    plant: Plant
    sources: dict[str, Source]
    """Dotted key -> source of its number."""
    origin: dict[str, str]
    """Dotted key -> the file (or `--set`) that set it; defaults are absent."""

    @property
    def roots(self) -> dict[str, Spec]:
        """The four roots by name."""
        return {
            "robot": self.robot, "world": self.world, "mission": self.mission, "plant": self.plant,
        }  # fmt: skip

    @property
    def true_world(self) -> World:
        """The true world; `world` is the map that the robot uses."""
        return displace_world(self.world, self.plant, self.mission.seed)

    @property
    def law(self) -> Part | None:
        """The law of the mission, otherwise that of the robot; None if neither names one."""
        named = self.robot.control.law
        return self.mission.law or (None if named is None else Part(kind=named))


def list_missions() -> list[Entry]:
    """List the built-in missions."""
    return list_entries(_list_files(), "mission")


def find_mission(name: str | os.PathLike[str]) -> Found:
    """Find a mission by built-in name, file, or folder (a finished run's directory)."""
    return find_file(name, _list_files(), "mission")


def _list_files() -> dict[str, Path]:
    """Return the built-in missions by name."""
    return {path.stem: path for path in sorted(MISSIONS.glob("*/*.toml"))}


def load_description(
    mission: str | os.PathLike[str],
    robot: str | os.PathLike[str] | None = None,
    world: str | os.PathLike[str] | None = None,
    sets: Sets = (),
    seed: int | None = None,
) -> Description:
    """Load a mission with its robot and world.

    `mission` is a built-in name, a file, or a finished run's directory; `robot` and `world` replace
    those of the mission. `sets` are `KEY=VALUE` texts, or a mapping from dotted keys to values.
    `seed` replaces `mission.seed`. Raises InputError that names file and key of any error.
    """
    for what, given in {"mission": mission, "robot": robot, "world": world}.items():
        if not isinstance(given, str | os.PathLike) and (given is not None or what == "mission"):
            raise InputError(f"{what} is a {type(given).__name__}; valid: a name, file or folder")
    found = find_mission(mission)
    with guarded(_name_run(found.path)):
        return _load(found, robot, world, sets, seed)


def _name_run(path: Path) -> str | None:
    """Return the run to which a mission file belongs, or None."""
    try:
        text = path.read_bytes() if path.stat().st_size < LARGEST_TOML else b""
    except OSError:  # reported when it is loaded
        return None
    beside = any((path.parent / name).exists() for name in ("metrics.json", "recording.mcap"))
    return f"run {path.parent}" if beside or b"resolved = true" in text else None


def _load(
    found: Found, robot: str | os.PathLike[str] | None, world: str | os.PathLike[str] | None,
    sets: Sets, seed: int | None,
) -> Description:  # fmt: skip
    layers = load_layers(found, robot, world, split_assignments(sets), to_plain(seed))
    tree, sources, origin = merge_layers(layers)
    parts: dict[str, Any] = {}
    folder = found.path.parent
    for root, spec in list_specs(tree, [folder]).items():
        try:
            parts[root] = validate_root(spec, tree.get(root, {}), root, origin, found.label)
        except InputError as error:
            if root == "robot":
                check_fitting(layers, found.label, str(error))
            raise
    # `resolved` concerns only the reading of a file; a loaded mission is always complete
    parts["mission"] = parts["mission"].model_copy(update={"resolved": False})
    if parts["robot"].control.law is not None:
        find("law", parts["robot"].control.law, [folder], "robot.control.law")
    task = parts["mission"].task.find_files(folder)
    parts["mission"] = parts["mission"].model_copy(update={"task": task})
    parts["robot"] = task.adapt_robot(parts["robot"])
    return Description(**parts, sources=sources, origin=origin)


def list_layer_problems(mission: str | os.PathLike[str]) -> list[str]:
    """List all errors of a mission, its robot and its world, one line each."""
    found = find_mission(mission)
    problems: list[str] = []
    try:
        layers = load_layers(found, None, None, [], None, problems)
        tree, _, origin = merge_layers(layers)
        with guarded(_name_run(found.path)):
            specs = list_specs(tree, [found.path.parent])
    except InputError as error:
        return [*problems, str(error)]
    for root, spec in specs.items():
        problems += list_problems(spec, tree.get(root, {}), root, origin, found.label)[1]
    return problems


def split_assignments(sets: Sets) -> list[tuple[str, object]]:
    """Convert `sets` into (dotted key, value) pairs; arrays and tuples become lists.

    Raises InputError if `sets` is neither a mapping with texts as keys nor a list of texts.
    """
    given: Any = [sets] if isinstance(sets, str) else sets
    if isinstance(given, Iterable) and not isinstance(given, Mapping):
        given = list(given)  # a generator is read once
    if not isinstance(given, Mapping | list) or not all(isinstance(item, str) for item in given):
        raise InputError(
            f"sets: {given!r}; valid: a dictionary of keys and values, or a list of KEY=VALUE texts"
        )
    pairs = given.items() if isinstance(given, Mapping) else map(parse_assignment, given)
    return [(rename_key(key), to_plain(value)) for key, value in pairs]


def to_plain(value: Any) -> Any:
    """Return a value with Python's numbers and lists in place of NumPy's and of tuples."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: to_plain(item) for key, item in value.items()}
    return value


def load_layers(
    found: Found,
    robot: str | os.PathLike[str] | None,
    world: str | os.PathLike[str] | None,
    assignments: list[tuple[str, object]],
    seed: int | None,
    problems: list[str] | None = None,
) -> list[Layer]:
    """Load the layers of a mission in order: robot, world, mission, assignments."""
    mission = load_layer(found.path, found.label, problems)
    table = mission.tree.get("mission")
    if table is None:
        raise InputError(
            f"{found.label}: no [mission] table; a mission file is required, this file "
            f"contains: {', '.join(mission.tree)}"
        )
    complete = table.get("resolved") is True
    if complete:
        _drop_old_map_error(mission.tree.get("plant", {}))
        _drop_old_mount(mission.tree.get("robot", {}))
    folder = found.path.parent
    layers: list[Layer] = []
    chosen: list[tuple[str, object]] = []
    for root, given, look_up in (("robot", robot, find_robot), ("world", world, find_world)):
        key = f"mission.{root}"
        assigned = [value for name, value in assignments if name == key]
        name: Any = given
        folders: list[Path] = []
        if name is None and assigned:
            name = str(assigned[-1]).strip("\"'")
        if name is not None:
            if complete:  # the whole robot or world is replaced
                mission.tree.pop(root, None)
                mission = mission._replace(sources=_drop(mission.sources, root))
            chosen.append((key, os.fspath(name)))
        elif complete:
            continue
        else:
            name = table.get(root)
            folders = [folder]
            if name is None:
                raise InputError(f"{found.label}: mission lacks {root}")
            if not isinstance(name, str):
                raise InputError(
                    f"{found.label}: {key} is {describe_value(name)}; a name or path is needed"
                )
        base_file = look_up(name, folders)
        if root == "robot":
            layers += load_robot_layers(base_file, problems)
            continue
        base = load_world_layer(base_file, problems)
        if root not in base.tree:
            raise InputError(
                f"{base_file.label}: no [{root}] table; a {root} file is required, this "
                f"file contains: {', '.join(base.tree)}"
            )
        for other in base.tree:
            if other not in (root, "plant"):
                raise InputError(
                    f"{base_file.label}: a {root} file cannot contain the table [{other}]; "
                    "use a mission file"
                )
        layers.append(base)
    layers.append(read_things(mission, folder, merge_layers(layers)[0]))
    # the kind is set first, because it defines the keys
    kinds = [pair for pair in assignments if pair[0] == "mission.kind"]
    first = ("mission.robot", "mission.world", "mission.kind")
    others = [pair for pair in assignments if pair[0] not in first]
    named, others = take_kinds(others, "--set")
    layers += [named] if named is not None else []
    drop_replaced(layers)
    seeds: list[tuple[str, object]] = [] if seed is None else [("mission.seed", seed)]
    for pairs, label in (
        (chosen, "command line"), (kinds, "--set"), (others, "--set"), (seeds, "--seed")
    ):  # fmt: skip
        if pairs:
            tree = merge_layers(layers)[0]
            touched = [key for key, _ in pairs]
            if pairs is others:
                check_named(touched, tree, label)
            specs = list_specs(tree, [folder], touched) if pairs is others else SPECS
            pairs = translate_assignments(pairs, tree)
            layers.append(apply_assignments(tree, pairs, specs, label))
    return layers


def _drop_old_map_error(plant: dict[str, Any]) -> None:
    """Treat the world file of a run from before map_error_size_m as the truth, as it was then."""
    if "map_error_size_m" not in plant:
        for key in ("map_error_m", "map_error_deg"):
            plant.pop(key, None)


def _drop_old_mount(robot: dict[str, Any]) -> None:
    """Drop keys without effect of a run from before they were refused: a pendulum's arm."""
    if "pendulum" in robot:
        for key in ("mount_x_m", "mount_z_m"):
            robot.get("arm", {}).pop(key, None)


def _drop(sources: dict[str, Source], root: str) -> dict[str, Source]:
    return {key: source for key, source in sources.items() if not key.startswith(root + ".")}
