"""Components that a description names: laws, estimators, sensors and others by their `kind`.

    [mission.law]            # or law = "cascade"
    kind = "lqr.py:Lqr"      # relative to this file
    q = 400.0                # a key of the law's own Table

    [robot.sensors.pitot]
    kind = "airspeed.py:Airspeed"

The spec of such a table is created from the `Table` of the class, so that its keys are available to
`--set`, `check` and `show`. A layer that names another kind replaces the whole table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import Field, create_model

from skywright.core.find import find, list_kinds, list_offers
from skywright.core.spec import Spec
from skywright.core.toml_files import Layer, Tree
from skywright.errors import InputError, neighbours

SINGLE = {("mission", "law"): "law", ("mission", "estimator"): "estimator"}
"""Tables that are a component, and its group; a plain text abbreviates `{ kind = TEXT }`."""
NAMED = {
    ("robot", "sensors"): "sensor", ("robot", "actuators"): "actuator",
    ("world", "effects"): "effect", ("plant", "faults"): "fault", ("mission", "faults"): "rule",
}  # fmt: skip
"""Tables that contain components by name."""
ALWAYS = {"mission": ("faults", "rule")}
"""Root -> a table that contains every built-in kind of a group under its own name."""


class Part(Spec):
    """A component's table; that of a class also has the keys of its `Table`."""

    kind: str  # name, or "file.py:Class"


class Place(NamedTuple):
    """Position of a component in a tree."""

    parent: Tree
    name: str
    group: str
    key: str  # dotted


def list_places(tree: Tree) -> Iterator[Place]:
    """Yield the positions of components in a tree of files."""
    for (root, name), group in SINGLE.items():
        table = tree.get(root)
        if isinstance(table, dict) and isinstance(table.get(name), dict | str):
            yield Place(table, name, group, f"{root}.{name}")
    for (root, name), group in NAMED.items():
        table = tree.get(root)
        parts = table.get(name) if isinstance(table, dict) else None
        if isinstance(parts, dict):
            for part, value in parts.items():
                if isinstance(value, dict):
                    yield Place(parts, part, group, f"{root}.{name}.{part}")


def normalise_layer(layer: Layer, folder: Path) -> Layer:
    """Convert plain texts to tables, and the files of a layer's components to absolute paths.

    The files are searched in `folder`, which is that of the layer, then in the current folder.
    """
    for place in list_places(layer.tree):
        value = place.parent[place.name]
        if isinstance(value, str):
            value = place.parent[place.name] = {"kind": value}
        if isinstance(value.get("kind"), str):
            value["kind"] = locate_kind(value["kind"], [folder])
    robot = layer.tree.get("robot")
    control = robot.get("control") if isinstance(robot, dict) else None
    if isinstance(control, dict) and isinstance(control.get("law"), str):
        control["law"] = locate_kind(control["law"], [folder])
    return layer


def locate_kind(kind: str, folders: Sequence[Path]) -> str:
    """Return the kind with the absolute path of its file, if the file is found."""
    file, colon, name = kind.rpartition(":")
    if not colon or not file.endswith(".py"):
        return kind
    for base in (*folders, Path()):
        path = base / Path(file).expanduser()
        if path.is_file():
            return f"{path.resolve()}:{name}"
    return kind


def take_kinds(
    assignments: list[tuple[str, object]], label: str
) -> tuple[Layer | None, list[tuple[str, object]]]:
    """Split off the assignments that set a component's kind, as a layer: they apply first."""
    tree: Tree = {}
    others: list[tuple[str, object]] = []
    for key, value in assignments:
        path = key.split(".")
        if tuple(path[:2]) in SINGLE and path[2:] in ([], ["kind"]):
            table, name = tree.setdefault(path[0], {}), path[1]
        elif tuple(path[:2]) in NAMED and len(path) == 4 and path[3] == "kind":
            table = tree.setdefault(path[0], {}).setdefault(path[1], {})
            name = path[2]
        else:
            others.append((key, value))
            continue
        table[name] = {"kind": value.strip("\"'") if isinstance(value, str) else value}
    return (normalise_layer(Layer(label, tree, {}), Path()) if tree else None), others


def check_named(keys: Sequence[str], tree: Tree, label: str) -> None:
    """Raise InputError for a key of a component that no layer names, such as that of a fault."""
    names = {place.key for place in list_places(tree)}
    for key in keys:
        path = key.split(".")
        group, table = NAMED.get((path[0], path[1] if len(path) > 1 else "")), ".".join(path[:3])
        if group is None or len(path) < 4 or table in names:
            continue
        if ALWAYS.get(path[0]) == (path[1], group) and path[2] in list_kinds(group):
            continue
        above = f"{path[0]}.{path[1]}."
        known = [n.removeprefix(above) for n in names if n.startswith(above)]
        known += list_kinds(group) if path[0] in ALWAYS else []
        raise InputError(
            f"{label} {key}: {table} does not exist; valid: "
            f"{neighbours(path[2], known) or 'none'}; "
            f"{table}.kind={[*list_kinds(group), 'file.py:Class'][0]} adds one"
        )


def drop_replaced(layers: Sequence[Layer]) -> None:
    """Empty the tables of components that a later layer replaces by another kind."""
    for i, layer in enumerate(layers):
        for place in list_places(layer.tree):
            kind = place.parent[place.name].get("kind")
            for earlier in layers[:i]:
                for other in list_places(earlier.tree):
                    old = other.parent[other.name]
                    if kind is not None and other.key == place.key and old.get("kind") != kind:
                        other.parent[other.name] = {}


def type_parts(spec: type[Spec], root: str, tree: Tree, touched: Sequence[str] = ()) -> type[Spec]:
    """Return the spec of a root with the tables of the components that the tree names.

    A built-in component is imported only if the tree, or a key in `touched`, has keys of its own.
    Raises InputError if a kind is unknown, or its file fails to import.
    """
    fields: list[tuple[str, str, str]] = []
    if root in ALWAYS:
        table, group = ALWAYS[root]
        fields += [(f"{table}.{kind}", group, kind) for kind in list_kinds(group)]
    for place in list_places({root: tree.get(root, {})}):
        value = place.parent[place.name]
        kind = value.get("kind") if isinstance(value, dict) else value
        name = place.key.partition(".")[2]
        if any(name == field[0] for field in fields) and kind in (None, place.name):
            continue
        if not isinstance(kind, str):
            fields.append((name, place.group, ""))
            continue
        own = len(value) > 1 or any(key.startswith(place.key + ".") for key in touched)
        offers = list_offers(place.group).get(kind, [])
        if own or len(offers) != 1 or offers[0].point is not None:  # not a plain built-in kind
            find(place.group, kind, (), place.key)
            fields.append((name, place.group, kind))
        elif "." in name:
            fields.append((name, place.group, ""))
    return extend_spec(spec, tuple(fields)) if fields else spec


@cache
def extend_spec(base: type[Spec], fields: tuple[tuple[str, str, str], ...]) -> type[Spec]:
    """Return a spec with tables of components: (name or TABLE.name, group, kind or "")."""
    inside: dict[str, list[tuple[str, str, str]]] = {}
    new: dict[str, Any] = {}
    for name, group, kind in fields:
        head, dot, rest = name.partition(".")
        if dot:
            inside.setdefault(head, []).append((rest, group, kind))
        else:
            table = make_table(group, kind) if kind else Part
            new[name] = (table, Field(default_factory=table) if group == "rule" else ...)
    for head, parts in inside.items():
        child: Any = base.model_fields[head].annotation
        typed = extend_spec(child, tuple(parts))
        new[head] = (typed, Field(default_factory=typed))
    out = create_model(base.__name__, __base__=base, **new)
    if base.__reduce__ is not object.__reduce__:  # it defines its own pickling
        return out
    return _make_picklable(out, _revive, base, fields)


def _revive(base: type[Spec], fields: Any, values: dict[str, Any]) -> Spec:
    return extend_spec(base, fields).model_validate(values)


@cache
def make_table(group: str, kind: str) -> type[Part]:
    """Return the spec of a component's table: `kind` and the keys of its class."""
    cls = find(group, kind).cls
    bases = Part if cls.Table is Spec else (cls.Table, Part)
    own: dict[str, Any] = {"kind": (str, kind)} if group == "rule" else {}
    table = create_model(cls.__name__, __base__=bases, **own)
    return _make_picklable(table, _revive_table, group, kind)


def _revive_table(group: str, kind: str, values: dict[str, Any]) -> Part:
    return make_table(group, kind).model_validate(values)


def _make_picklable(spec: Any, revive: Any, *recipe: Any) -> Any:
    """Let another process create the class again, which no module contains by name."""
    spec.__reduce__ = lambda self: (revive, (*recipe, dict(self)))
    return spec


def list_parts(spec: Spec) -> dict[str, Part]:
    """Return the components of a validated table, by name."""
    values = ((name, getattr(spec, name)) for name in type(spec).model_fields)
    return {name: value for name, value in values if isinstance(value, Part)}


def build_part(group: str, part: Part, name: str) -> Any:
    """Return the component of a part, as the instance `name` with its table."""
    cls = find(group, part.kind).cls
    return cls(name, cls.Table.model_validate(part.model_dump(exclude={"kind"})))
