"""Dotted keys: resolving them in a description, and assigning to them (`--set`).

The pydantic specs are the only list of keys. This module traverses them, so that `--set` reaches
every value, including those that exist only as a default.
"""

from __future__ import annotations

import copy
import types
import typing
from collections.abc import Mapping
from typing import Any, Union, get_args, get_origin

from skywright.core.find import find
from skywright.core.key_names import describe_unknown
from skywright.core.open_spec import OpenSpec
from skywright.core.spec import Spec
from skywright.core.toml_files import Layer, Tree, parse_value, strip_sources
from skywright.errors import InputError


def apply_assignments(
    tree: Mapping[str, Any],
    assignments: list[tuple[str, Any]],
    roots: Mapping[str, type[Spec]],
    label: str = "--set",
) -> Layer:
    """Build the layer of `KEY=VALUE` assignments on top of the merged tree of the files.

    `assignments` are (dotted key, value); a text value is parsed as TOML if possible, unless the
    key is a text. `roots` maps the four roots to their specs. Raises InputError on an unknown key,
    naming its neighbours.
    """
    work = copy.deepcopy(dict(tree))
    sources: dict[str, Any] = {}
    touched: Tree = {}
    for key, value in assignments:
        path, leaf = resolve_key(key, work, roots, label)
        if isinstance(value, str):
            parsed = parse_value(value)
            if not is_text(leaf) or isinstance(parsed, str):
                value = parsed
        dotted = ".".join(map(str, path))
        plain, found = strip_sources({dotted: value}, label)
        sources.update(found)
        _put(work, path, plain[dotted])
        _put_in_layer(touched, work, path)
    return Layer(label, touched, sources)


def parse_assignment(text: str) -> tuple[str, str]:
    """Split `KEY=VALUE`; the key is dotted, the value may be empty or contain further `=`.

    Raises InputError if there is no `=` or no key.
    """
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not key:
        raise InputError(f"--set {text!r}: expected KEY=VALUE, e.g. world.pipe.diameter_m=0.3")
    return key, value.strip()


def resolve_key(
    key: str, tree: Mapping[str, Any], roots: Mapping[str, type[Spec]], label: str
) -> tuple[list[str | int], object]:
    """Resolve a dotted key through the specs and the tree.

    Names of requirements contain dots and list items are numbers: both are supported. Returns the
    path (names and list indices) and the annotation at its end. Raises InputError naming the
    neighbours of the first unknown part.
    """
    parts = key.split(".")
    root = parts[0]
    if root not in roots:
        raise InputError(
            f"{label} {key}: unknown root {root!r}; a key starts with one of: {', '.join(roots)}"
        )
    path: list[str | int] = [root]
    annotation: object = roots[root]
    here: Any = tree.get(root, {})
    rest = parts[1:]
    while rest:
        name, annotation, used = _step(annotation, here, rest, path, key, label)
        path.append(name)
        here = _child(here, name)
        rest = rest[used:]
    return path, annotation


def _step(
    annotation: object, here: Any, rest: list[str], path: list[str | int], key: str, label: str
) -> tuple[str | int, object, int]:
    """Execute one step of `resolve_key`: (name or index, annotation there, parts used)."""
    at = ".".join(map(str, path))
    part = rest[0]
    annotation = strip_optional(annotation)
    model = find_model(annotation, here)
    if model is not None:
        if issubclass(model, OpenSpec) and part != "kind" and "kind" in here:
            find(model.group, here["kind"], key=f"{label}: {at}.kind")  # reported before its keys
        fields = {n: f for n, f in model.model_fields.items() if n not in model.inline_tables}
        if part in fields:
            return part, fields[part].annotation, 1
        tables = list_inline_tables(model, here)
        if part in tables:
            return part, get_inline_model(model, here[part]), 1
        raise InputError(f"{label}: {describe_unknown(part, at, [*fields, *tables])}")
    origin = get_origin(annotation)
    if origin is dict:
        child = get_args(annotation)[1]
        names = list(here) if isinstance(here, dict) else []
        for used in range(len(rest), 0, -1):  # the longest existing name has priority
            name = ".".join(rest[:used])
            if name in names:
                return name, child, used
        model = as_model(child)
        if model is None or len(rest) == 1:
            return ".".join(rest), child, len(rest)
        keys, name = list(model.model_fields), ".".join(rest[:-1])
        required = [n for n, f in model.model_fields.items() if f.is_required()]
        optional = not required and len(rest) == 2
        if rest[-1] in keys and (required == rest[-1:] or optional):  # a new entry, complete
            return name, child, len(rest) - 1
        if optional:
            raise InputError(f"{label}: {describe_unknown(rest[-1], f'{at}.{name}', keys)}")
        raise InputError(f"{label}: {describe_unknown('.'.join(rest), at, names)}")
    if origin is list:
        items = here if isinstance(here, list) else []
        if not part.isdecimal() or int(part) >= len(items):
            valid = f"0 to {len(items) - 1}" if items else "none, the list is empty"
            raise InputError(f"{label} {key}: {at} is a list; valid items: {valid}")
        return int(part), get_args(annotation)[0], 1
    raise InputError(f"{label} {key}: {at} is a single value and has no key {part!r}")


def strip_optional(annotation: object) -> object:
    """Convert `X | None` to X and remove `Annotated`."""
    while True:
        if get_origin(annotation) is typing.Annotated:
            annotation = get_args(annotation)[0]
            continue
        if get_origin(annotation) in (Union, types.UnionType):
            kept = [a for a in get_args(annotation) if a is not type(None)]
            if len(kept) == 1:
                annotation = kept[0]
                continue
        return annotation


def as_model(annotation: object) -> type[Spec] | None:
    annotation = strip_optional(annotation)
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        return annotation
    return None


def find_model(annotation: object, here: object) -> type[Spec] | None:
    """Return the spec of the table `here`, or None; for open kinds, that of its kind."""
    model = as_model(annotation)
    return model.find_class(here) if model and issubclass(model, OpenSpec) else model


def is_text(annotation: object) -> bool:
    """Whether a key's value is text (a plain string or one of fixed words)."""
    annotation = strip_optional(annotation)
    if annotation is str:
        return True
    return get_origin(annotation) is typing.Literal and all(
        isinstance(a, str) for a in get_args(annotation)
    )


def list_inline_tables(model: type[Spec], here: Any) -> list[str]:
    if not model.inline_tables or not isinstance(here, dict):
        return []
    return [n for n, v in here.items() if isinstance(v, dict) and n not in model.model_fields]


def get_inline_model(model: type[Spec], table: Mapping[str, Any]) -> object:
    """Return the spec of an inline table: the one that shares most of its keys."""
    candidates = [get_args(model.model_fields[n].annotation)[1] for n in model.inline_tables]
    return max(candidates, key=lambda c: len(set(table) & set(c.model_fields)))


def _child(here: Any, name: str | int) -> Any:
    if isinstance(here, dict):
        return here.get(name, {})
    if isinstance(here, list) and isinstance(name, int) and name < len(here):
        return here[name]
    return {}


def _put(tree: Any, path: list[str | int], value: Any) -> None:
    """Write a value at a path; creates missing tables."""
    for name in path[:-1]:
        if isinstance(tree, dict):
            child = tree.get(name)
            if not isinstance(child, dict | list):
                child = tree[name] = {}
            tree = child
        else:
            tree = tree[name]
    tree[path[-1]] = value


def _put_in_layer(layer: Tree, work: Tree, path: list[str | int]) -> None:
    """Copy the value at `path` into the layer; a list is copied as a whole."""
    depth = next((i for i, name in enumerate(path) if isinstance(name, int)), len(path))
    value: Any = work
    for name in path[:depth]:
        value = value[name]
    _put(layer, path[:depth], value)


def walk_path(model: type[Spec], tree: Any, path: list[Any]) -> tuple[type[Spec] | None, Any]:
    """Follow a path of a file: (the spec there if it is a table, the tree there)."""
    annotation: object = model
    here = tree
    for name in path:
        current = find_model(annotation, here)
        if current is not None and name in current.model_fields:
            annotation = current.model_fields[name].annotation
        elif current is not None and name in list_inline_tables(current, here):
            annotation = get_inline_model(current, here[name])
        else:
            args = get_args(strip_optional(annotation))
            annotation = args[-1] if args else None
        here = _child(here, name)
    return find_model(annotation, here), here


def iterate_leaves(spec: Spec, prefix: str) -> list[tuple[str, Any]]:
    """List every leaf of a validated spec as (dotted key as in a file, value)."""
    leaves: list[tuple[str, Any]] = []

    def visit(value: Any, key: str) -> None:
        if isinstance(value, Spec):
            for name in type(value).model_fields:
                child = getattr(value, name)
                if name in value.inline_tables:
                    for sub, table in child.items():
                        visit(table, f"{key}.{sub}")
                else:
                    visit(child, f"{key}.{name}")
        elif isinstance(value, dict):
            for sub, child in value.items():
                visit(child, f"{key}.{sub}")
        elif isinstance(value, list) and value and isinstance(value[0], Spec):
            for i, child in enumerate(value):
                visit(child, f"{key}.{i}")
        else:
            leaves.append((key, value))

    visit(spec, prefix)
    return leaves
