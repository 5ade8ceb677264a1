"""`skywright check`: lists all errors of a file at once, and the numbers that are assumed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from skywright.core.keys import iterate_leaves
from skywright.core.spec import Source, Spec
from skywright.core.toml_files import Layer, merge_layers
from skywright.core.validation import list_problems
from skywright.description.loader import SPECS, Description, list_layer_problems, load_description
from skywright.description.lookup import KINDS, find_kind
from skywright.description.parts import type_parts
from skywright.description.robot.loader import find_robot, load_robot_layers
from skywright.description.robot.sourced import list_unsourced
from skywright.description.robot.spec import Robot
from skywright.description.world.loader import find_world, load_world_layer
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.run.parts import build_rules
from skywright.run.requirements import check_requirements


class CheckReport(NamedTuple):
    """What `skywright check` found."""

    label: str
    kind: str
    valid: bool
    problems: list[str]
    notes: list[str]


def check_file(name: str) -> CheckReport:
    """Check a robot, world or mission by name or path; for a folder, all three that it contains.

    Raises InputError if the file does not exist or is not TOML.
    """
    kind, path = find_kind(name)
    folder = Path(name).expanduser()
    if not folder.is_dir() or path == name:
        return _check_one(name, kind, path)
    files = {k: folder / f"{k}.toml" for k in KINDS}
    found = {str(f): k for k, f in files.items() if f.is_file()}
    reports = [_check_one(f, k, f, frozenset(found)) for f, k in found.items()]
    # a problem of the robot or of the world is one of the mission too: it is stated once
    problems: dict[str, str] = {}
    for r in reports:
        for line in r.problems:
            problems.setdefault(line.removeprefix(f"{r.label}: "), line)
    return CheckReport(
        name, " and ".join(r.kind for r in reports), all(r.valid for r in reports),
        list(problems.values()),
        list(dict.fromkeys(line for r in reports for line in r.notes)),
    )  # fmt: skip


def _check_one(name: str, kind: str, path: str, files: frozenset[str] = frozenset()) -> CheckReport:
    """Check one file; `files` are the labels of those that are checked with it."""
    problems: list[str] = []
    notes: list[str] = []
    if kind == "mission":
        problems = list_layer_problems(path)
        if not problems:
            description = load_description(path)
            _check_lift(description.robot, description.world.gravity_mps2, name, problems, notes)
            problems += _list_error(build_rules, description)
            problems += _list_error(check_requirements, description.mission)
            problems += _check_overlaps(description.robot, description.world, name)
            if not problems and _has_code_of_a_user(description):
                problems += _check_compiles(description)
            files |= {description.origin.get("mission.name", name)}
            notes += list_assumed(description.roots, description.sources, description.origin, files)
            notes += count_unsourced(description.robot, description.sources)
    else:
        label = (find_robot if kind == "robot" else find_world)(path).label
        tree, sources, origin = merge_layers(_load_layers(kind, path, problems))
        spec = _check_root(tree, kind, origin, label, problems)
        if "plant" in tree:
            _check_root(tree, "plant", origin, label, problems)
        if spec is not None:
            notes += list_assumed({kind: spec}, sources, origin, files | {label})
        if isinstance(spec, Robot):
            notes += count_unsourced(spec, sources)
        if isinstance(spec, Robot) and not problems:
            _check_lift(spec, 9.81, label, problems, notes)
        if isinstance(spec, World) and not problems:
            problems += _check_overlaps(load_description("waypoints").robot, spec, label)
    return CheckReport(name, kind, not problems, problems, notes)


def _list_error(check: Callable[..., Any], *arguments: Any) -> list[str]:
    """Return the message of the InputError that a check raises, or nothing."""
    try:
        check(*arguments)
    except InputError as error:
        return [str(error)]
    return []


def _check_overlaps(robot: Robot, world: World, label: str) -> list[str]:
    from skywright.models.overlaps import find_overlaps  # heavy: only worlds need it

    try:
        found = find_overlaps(robot, world)
    except InputError as error:
        return [f"{label}: {error}"]
    return [
        f"{label}: {a!r} and {b!r} overlap by {1000 * depth:.0f} mm at the start, and one of them "
        "can move: move them apart"
        for a, b, depth in found
    ]


def _has_code_of_a_user(description: Description[Any]) -> bool:
    return any(
        isinstance(value, str) and ".py:" in value
        for root in description.roots.values()
        for _, value in iterate_leaves(root, "")
    )


def _check_compiles(description: Description[Any]) -> list[str]:
    """Build the vehicle, which compiles the steps of user code, and run the kind's check of it."""
    from skywright.run.backends import build_vehicle
    from skywright.run.kind import load_kind

    try:
        vehicle = build_vehicle(description)
        load_kind(description.mission.kind).check_vehicle(vehicle, description.mission.task)
    except InputError as error:
        return [str(error)]
    return []


def _load_layers(kind: str, path: str, problems: list[str]) -> list[Layer]:
    """Return the layers of a robot, after those of the robots that it extends, or of a world."""
    if kind == "robot":
        return load_robot_layers(find_robot(path), problems)
    found = find_world(path)
    layer = load_world_layer(found, problems)
    for root in layer.tree:
        if root not in (kind, "plant"):
            problems.append(f"{layer.label}: a {kind} file cannot contain the table [{root}]")
    return [layer]


def _check_root(
    tree: dict[str, Any], root: str, origin: dict[str, str], label: str, problems: list[str]
) -> Any:
    try:
        typed = type_parts(SPECS[root], root, tree)
    except InputError as error:
        problems.append(f"{label}: {error}")
        return None
    spec, found = list_problems(typed, tree[root], root, origin, label)
    problems += found
    return spec


def _check_lift(
    robot: Robot, gravity: float, label: str, problems: list[str], notes: list[str]
) -> None:
    from skywright.models.capability import check_can_fly  # heavy: only robots need it

    try:
        share = check_can_fly(robot, gravity)
    except InputError as error:
        problems.append(f"{label}: {error}")
        return
    notes.append(
        f"robot {robot.name!r} can lift its weight: hover takes {100 * share:.0f} % of "
        f"thrust_max_n (missions may use {100 * robot.rotors.thrust_fraction:.0f} %)"
    )


def list_assumed(
    specs: Mapping[str, Spec],
    sources: Mapping[str, Source],
    origin: Mapping[str, str] | None = None,
    files: frozenset[str] = frozenset(),
) -> list[str]:
    """List the assumed numbers of `specs` (by root) with their ranges.

    With `origin`, which maps a key to the label of the file that sets it, those of other files
    than `files` are counted only.
    """
    lines = []
    others = 0
    for root, spec in specs.items():
        for key, value in iterate_leaves(spec, root):
            source = sources.get(key)
            if source is None or source.kind != "assumed":
                continue
            if origin is not None and origin.get(key) not in files:
                others += 1
                continue
            span = f" (range {source.range[0]:g} to {source.range[1]:g})" if source.range else ""
            shown = f"{value:g}" if isinstance(value, int | float) else str(value)
            note = f": {source.note}" if source.note else ""
            lines.append(f"assumed {key} = {shown}{span}{note}")
    if others:
        lines.append(f"{others} assumed values of other files (`skywright show` lists them)")
    return lines


def count_unsourced(robot: Robot, sources: dict[str, Source]) -> list[str]:
    """Return one line with the number of a robot's numbers without a source, or nothing."""
    bare = len(list_unsourced(robot, sources))
    return [f"{bare} numbers of the robot have no source (including defaults)"] if bare else []
