"""World files of versions before 0.3: their own tables are translated to `world.things`.

Version 0.3 will not read the old tables; until then a message is printed once per file.
"""

from __future__ import annotations

import math
import multiprocessing
import sys
from collections.abc import Iterator, Mapping
from typing import Any

from skywright.core.toml_files import Layer, Tree, parse_value
from skywright.errors import InputError

MANY = ("obstacles", "objects")
SINGLE = ("socket", "rack", "tool", "peg", "marker", "tape", "bench")
"""Old tables, in the order in which the scene was built."""

_told: set[str] = set()


def translate_layer(layer: Layer, below: Mapping[str, Any]) -> Layer:
    """Return the layer with its old tables as `world.things`; `below` is the tree under it.

    Raises InputError if two things would have the same name.
    """
    world = layer.tree.get("world")
    if not isinstance(world, dict) or not any(isinstance(world.get(t), dict) for t in OLD):
        return layer
    reader = _Reader(layer, world, _read_things(below))
    _tell(layer.label, [t for t in OLD if isinstance(world.get(t), dict)])
    kept = {name: table for name, table in world.items() if name not in reader.read}
    tree = {**layer.tree, "world": {**kept, "things": reader.things}}
    return Layer(layer.label, tree, reader.sources)


def translate_assignments(
    assignments: list[tuple[str, Any]], tree: Mapping[str, Any]
) -> list[tuple[str, Any]]:
    """Translate dotted keys (`--set`) of old tables; `tree` is the tree that they modify."""
    out: list[tuple[str, Any]] = []
    there = _read_things(tree)
    for key, value in assignments:
        root, _, rest = key.partition(".")
        table, _, inner = rest.partition(".")
        if root != "world" or table not in OLD or (not inner and not _is_table(value)):
            out.append((key, value))
            continue
        path = _split(table, inner, there)
        nested: Any = parse_value(value) if isinstance(value, str) else value
        for name in reversed(path):
            nested = {name: nested}
        layer = translate_layer(Layer("--set", {"world": nested}, {}), {"world": {"things": there}})
        things = layer.tree["world"].get("things")
        if things is None:  # nothing was read: the key is reported as unknown
            out.append((key, value))
            continue
        for name, thing in things.items():
            if name in there:
                out += [(f"world.things.{name}.{k}", v) for k, v in thing.items()]
            else:
                out.append((f"world.things.{name}", thing))
                there[name] = thing
    return out


OLD = (*MANY, *SINGLE)


class _Reader:
    """The things of one layer, old and new, and their sources under the new keys."""

    def __init__(self, layer: Layer, world: Tree, below: Mapping[str, Any]) -> None:
        self.label, self.below = layer.label, below
        given = world.get("things")
        self.things: Tree = dict(given) if isinstance(given, dict) else {}
        self.renamed: dict[str, str] = {}  # old dotted keys, or their prefixes -> new
        self.read: set[str] = set()
        self.from_table = {name: f"world.things.{name}" for name in self.things}
        for table in OLD:
            if not isinstance(world.get(table), dict):
                continue
            self.read.add(table)
            for name, old in self._list(table, world[table]):
                self._add(table, name, dict(old))
        self.sources = {self._rename(key): s for key, s in layer.sources.items()}

    def _list(self, table: str, found: Tree) -> Iterator[tuple[str, Tree]]:
        if table in SINGLE:
            yield table, found
            return
        for name, old in found.items():
            if not isinstance(old, dict):
                raise InputError(f"{self.label}: world.{table}.{name} must be a table")
            yield name, old

    def _add(self, table: str, name: str, old: Tree) -> None:
        """Read one old table as the thing `name`."""
        at = f"world.{table}" if table in SINGLE else f"world.{table}.{name}"
        if name in self.from_table:
            raise InputError(
                f"{self.label}: {self.from_table[name]} and {at} both define the thing "
                f"{name!r}; rename one: [world.things.NAME]"
            )
        self.from_table[name] = at
        self.renamed[at] = f"world.things.{name}"
        known = self.below.get(name)
        kind = _find_kind(table, old, known)
        if known is not None and known.get("kind") not in (kind, None):
            raise InputError(
                f"{self.label}: {at} is a {kind}, but world.things.{name} is already a "
                f"{known['kind']!r}: rename one of them"
            )
        old.pop("shape", None)
        pad = old.pop("pad", None)
        new = known is None
        if kind == "cylinder":
            old.pop("size_y_m", None)
            for a, b in (("size_x_m", "diameter_m"), ("size_z_m", "length_m")):
                if a in old:
                    old[b] = old.pop(a)
                    self.renamed[f"{at}.{a}"] = f"world.things.{name}.{b}"
        if table == "tool":
            if new:
                old.setdefault("on", "bench")
            self._move_onto(at, old, known or {})
        if table == "marker" and isinstance(old.get("on"), str):
            old["on"] += ".origin"
        first = _NEW.get(table, {}) if new else {}
        self.things[name] = {"kind": kind, **first, **old} if new else old
        if isinstance(pad, dict):
            self._add_pad(at, name, pad)

    def _move_onto(self, at: str, old: Tree, known: Tree) -> None:
        """Convert a tool's position in W into one on its support."""
        stand = str(old.get("on", known.get("on")))
        under = self.things.get(stand) or self.below.get(stand)
        if not isinstance(under, dict) or not ({"x_m", "y_m"} & set(old)):
            return
        yaw = math.radians(_number(under, "yaw_deg"))
        if yaw != 0.0 and not {"x_m", "y_m"} <= set(old):
            raise InputError(
                f"{self.label}: {at}.x_m and y_m are world.things.tool.x_m and y_m now, from the "
                f"middle of {stand!r} and along its edges: give both"
            )
        dx, dy = (_number(old, k) - _number(under, k) if k in old else 0.0 for k in ("x_m", "y_m"))
        c, s = math.cos(yaw), math.sin(yaw)
        moved = {"x_m": c * dx + s * dy, "y_m": c * dy - s * dx}
        old |= {k: moved[k] for k in moved if k in old}
        if "yaw_deg" in old:
            old["yaw_deg"] = _number(old, "yaw_deg") - math.degrees(yaw)

    def _add_pad(self, at: str, name: str, pad: Tree) -> None:
        """Convert a box's pad into a thing on its face."""
        label = f"{name} pad"
        self.renamed[f"{at}.pad"] = f"world.things.{label}"
        if label in self.below:
            self.things[label] = pad
            return
        box = {**self.below.get(name, {}), **self.things[name]}
        size = {"width_m": box.get("size_y_m"), "height_m": box.get("size_z_m")}
        self.things[label] = {"kind": "pad", "on": f"{name}.front", **size, **pad}

    def _rename(self, key: str) -> str:
        """Return the new dotted key of a source: the longest old prefix applies."""
        for old in sorted(self.renamed, key=len, reverse=True):
            if key == old or key.startswith(old + "."):
                return self.renamed[old] + key[len(old) :]
        return key


_NEW: dict[str, Tree] = {
    "objects": {"moves": True},
    "peg": {"on": "rack"},
    "socket": {"tracked": True},
}
"""Additional keys of a table that creates a new thing, by the old table."""


def _find_kind(table: str, old: Tree, known: Tree | None) -> str:
    if table == "objects":
        return str(old.get("shape") or (known or {}).get("kind") or "box")
    return {"obstacles": "box", "rack": "socket"}.get(table, table)


def _number(table: Mapping[str, Any], key: str) -> float:
    value = table.get(key, 0.0)
    return float(value) if isinstance(value, int | float) else 0.0


def _is_table(value: object) -> bool:
    return isinstance(parse_value(value) if isinstance(value, str) else value, dict)


def _read_things(tree: Mapping[str, Any]) -> dict[str, Any]:
    world = tree.get("world")
    things = world.get("things") if isinstance(world, dict) else None
    found = things.items() if isinstance(things, dict) else ()
    return {name: table for name, table in found if isinstance(table, dict)}


def _split(table: str, inner: str, things: Mapping[str, Any]) -> list[str]:
    """Split an old dotted key into its parts; names of things may contain dots."""
    if table in SINGLE or not inner:
        return [table, *filter(None, [inner])]
    names = [n for n in things if inner == n or inner.startswith(n + ".")]
    name = max(names, key=len) if names else inner.partition(".")[0]
    key = inner[len(name) + 1 :]
    return [table, name, *(key.split(".") if key else [])]


def _tell(label: str, tables: list[str]) -> None:
    """Print once per file, on standard error, how the tables are read."""
    if label in _told or multiprocessing.parent_process() is not None:
        return
    _told.add(label)
    shown = ", ".join(f"world.{name}" for name in tables)
    print(
        f"{label}: {shown}: read as [world.things.NAME] with a kind, as it is written since "
        "version 0.2; version 0.3 will not read the old tables (docs/reference/things.md)",
        file=sys.stderr,
    )
