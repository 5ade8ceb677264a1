"""Description files: parses TOML into plain trees and the provenance of their numbers.

A sourced number is written `mass_kg = { value = 1.6, source = "paper", note = "Table I" }`; an
assumed one also has its plausible `range`. This module removes the wrappers, so that all other
modules use plain trees.
"""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, get_args

from skywright.core.bounded import LARGEST_TOML, parse_toml, read_text
from skywright.core.spec import Source, SourceKind
from skywright.errors import InputError, neighbours

Tree = dict[str, Any]

ROOTS = ("robot", "world", "mission", "plant")
"""The four top-level tables of every description."""

SOURCE_KINDS: tuple[str, ...] = get_args(SourceKind)
_WRAPPER_KEYS = {"value", "source", "note", "range"}


class Layer(NamedTuple):
    """One file, or the assignments of the command line, as a plain tree."""

    label: str
    """Its name in messages: a path as the user wrote it, or `--set`."""
    tree: Tree
    sources: dict[str, Source]
    """Dotted key -> provenance of its number."""


def load_layer(path: Path, label: str | None = None, problems: list[str] | None = None) -> Layer:
    """Read one description file.

    With `problems`, errors in keys and sources are appended there, not raised. Raises InputError if
    the file cannot be read, is not TOML, is empty, has a table outside the four roots, or contains
    a number that is not finite or has a malformed source.
    """
    label = label or str(path)
    return build_layer(read_text(path, LARGEST_TOML, label=label), label, problems)


def build_layer(text: str, label: str, problems: list[str] | None = None) -> Layer:
    """Parse the text of a description file; see `load_layer`."""
    raw = parse_toml(text, label)
    if not raw:
        raise InputError(f"{label}: the file is empty; valid tables: {', '.join(ROOTS)}")
    for key, value in list(raw.items()):
        if key not in ROOTS:
            message = (
                f"{label}: unknown table [{key}]; every key belongs to one of: {', '.join(ROOTS)}"
            )
        elif not isinstance(value, dict):
            message = f"{label}: {key} must be a table ([{key}]), found {describe_value(value)}"
        else:
            continue
        if problems is None:
            raise InputError(message)
        problems.append(message)
        del raw[key]
    tree, sources = strip_sources(raw, label, problems)
    return Layer(label, tree, sources)


def strip_sources(
    raw: Mapping[str, Any], label: str, problems: list[str] | None = None
) -> tuple[Tree, dict[str, Source]]:
    """Remove the `{ value, source, note, range }` wrappers of a tree.

    Returns the plain tree and the sources by dotted key. Raises InputError for a malformed wrapper
    and for NaN or infinity; with `problems`, appends there instead.
    """
    sources: dict[str, Source] = {}

    def plain(value: Any, key: str) -> Any:
        if isinstance(value, dict):
            if "value" in value:
                try:
                    sources[key] = _read_source(value, key, label)
                except InputError as error:
                    if problems is None:
                        raise
                    problems.append(str(error))
                return plain(value["value"], key)
            return {name: plain(child, f"{key}.{name}") for name, child in value.items()}
        if isinstance(value, list):
            return [plain(child, f"{key}.{i}") for i, child in enumerate(value)]
        # with `problems`, the validation of the spec reports it
        if problems is None and isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{label}: {key} is {value}; a finite number is needed")
        return value

    tree = {name: plain(value, name) for name, value in raw.items()}
    return tree, sources


def _read_source(wrapper: Mapping[str, Any], key: str, label: str) -> Source:
    """Check one wrapper and return its source."""
    for name in wrapper:
        if name not in _WRAPPER_KEYS:
            raise InputError(
                f"{label}: {key}.{name}: unknown key; a sourced number has: value, source, note, "
                "range"
            )
    kind = wrapper.get("source")
    if kind is None:
        raise InputError(
            f"{label}: {key} has a value but no source; valid: {', '.join(SOURCE_KINDS)}"
        )
    if kind not in SOURCE_KINDS:
        raise InputError(
            f"{label}: {key}: unknown source {describe_value(kind)}; "
            f"valid: {', '.join(SOURCE_KINDS)}"
        )
    note = wrapper.get("note", "")
    if not isinstance(note, str):
        raise InputError(f"{label}: {key}.note must be text, found {describe_value(note)}")
    bounds = wrapper.get("range")
    if bounds is None:
        if kind == "assumed" and any(True for _ in iterate_numbers(wrapper["value"])):
            raise InputError(
                f"{label}: {key} is assumed and requires a plausible range, e.g. range = [0.5, 1.5]"
            )
        return Source(kind, note)
    if (
        not isinstance(bounds, list)
        or len(bounds) != 2
        or not all(_is_number(b) and abs(b) <= sys.float_info.max for b in bounds)
        or bounds[0] > bounds[1]
    ):
        raise InputError(
            f"{label}: {key}.range must be [lowest, highest], found {describe_value(bounds)}"
        )
    low, high = float(bounds[0]), float(bounds[1])
    for number in iterate_numbers(wrapper["value"]):
        if not low <= number <= high:
            raise InputError(
                f"{label}: {key}: the value {number:g} lies outside its range [{low:g}, {high:g}]"
            )
    return Source(kind, note, (low, high))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def iterate_numbers(value: object) -> Iterator[float]:
    """Yield the numbers of a value: itself, or those of a (nested) list."""
    if isinstance(value, list | tuple):
        for child in value:
            yield from iterate_numbers(child)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield math.inf if abs(value) > sys.float_info.max else float(value)  # an int has no limit


def describe_value(value: object) -> str:
    """Return a short phrase for a value, for an error message."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        names = ", ".join(sorted(map(str, value)))
        return f"a table with the keys {names}" if names else "an empty table"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if isinstance(value, str):
        shown = value if len(value) <= 40 else value[:37] + "..."
        return f"the text {shown!r}"
    shown = str(value)
    return shown if len(shown) <= 40 else shown[:37] + "..."


def merge_layers(layers: list[Layer]) -> tuple[Tree, dict[str, Source], dict[str, str]]:
    """Merge layers, later over earlier: tables key by key, all other values as a whole.

    Returns the tree, the sources and the origin (dotted key of every leaf -> label of the layer
    that wrote it). A sourced number that a plain one overrides has the source `set`. Raises
    InputError if a table is overridden by a value of another type, or the reverse.
    """
    tree: Tree = {}
    sources: dict[str, Source] = {}
    origin: dict[str, str] = {}

    def merge(into: Tree, over: Tree, prefix: str, layer: Layer) -> None:
        for name, value in over.items():
            key = f"{prefix}{name}"
            old = into.get(name)
            if isinstance(value, dict) and (name not in into or isinstance(old, dict)):
                merge(into.setdefault(name, {}), value, key + ".", layer)
                continue
            if isinstance(old, dict):
                raise InputError(
                    f"{layer.label}: {key} is a table with the keys "
                    f"{neighbours('', old)}; found {describe_value(value)}"
                )
            had_source = sources.pop(key, None) is not None
            if isinstance(old, list):
                for sub in [k for k in sources if k.startswith(key + ".")]:
                    del sources[sub]
            into[name] = value
            origin[key] = layer.label
            if key in layer.sources:
                sources[key] = layer.sources[key]
            elif had_source:
                sources[key] = Source("set", layer.label)
            if isinstance(value, list | dict):  # numbers inside a list of tables, or in a table
                found = layer.sources.items()
                sources.update({k: v for k, v in found if k.startswith(key + ".")})

    for layer in layers:
        merge(tree, layer.tree, "", layer)
    return tree, sources, origin


def parse_value(text: str) -> Any:
    """Parse the right side of KEY=VALUE: a TOML value, or else the text itself."""
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        return text
    if set(parsed) != {"value"}:  # the text contains a line break and a second key
        return text
    value = parsed["value"]
    return value if isinstance(value, bool | int | float | str | list | dict) else text
