"""Writing of a description: the resolved mission.toml of a run, which repeats the run."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from skywright.core.keys import iterate_leaves
from skywright.core.spec import Source, Spec
from skywright.description.loader import Description
from skywright.description.robot.spec import Robot

HEADER = "# A complete description: `skywright run` on this file, or on its folder, repeats it.\n\n"


IN_FILE = re.compile(r"(.+\.py):([A-Za-z_]\w*)")
"""A kind in a user's file."""


def write_literal(value: Any) -> str:
    """Return a number, text, boolean, list or dictionary as TOML of one line.

    Raises TypeError for other values, which TOML lacks.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value) + 0.0)  # without the sign of a zero
    if isinstance(value, int):
        return repr(value)
    if isinstance(value, str):  # JSON's text would have surrogates as escapes, and DEL as it is
        whole = value.encode("utf-8", "replace").decode("utf-8")
        return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(write_literal, value))}]"
    if isinstance(value, Mapping):
        items = (f"{_write_key(name)} = {write_literal(v)}" for name, v in value.items())
        return f"{{{', '.join(items)}}}"
    raise TypeError(f"{value!r} has no form in TOML")


def _write_key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else write_literal(name)


def list_sources(description: Description) -> list[Path]:
    """List the users' files that a description names: laws, sensors, missions, and so on."""
    found: dict[Path, None] = {}
    for root in ("mission", "robot", "world"):
        for _, value in iterate_leaves(getattr(description, root), root):
            match = IN_FILE.fullmatch(value) if isinstance(value, str) else None
            if match is not None and Path(match[1]).is_file():
                found[Path(match[1])] = None
    return list(found)


def dump_description(description: Description, kept: Mapping[Path, str] | None = None) -> str:
    """Write the whole description as TOML, including sources.

    `load_description` on the result gives an equal description (except for `origin`). Files in
    `kept` are renamed as given there.
    """
    kept = kept or {}
    roots: dict[str, Any] = {}
    for root in ("mission", "robot", "world", "plant"):
        spec: Spec = getattr(description, root)
        roots[root] = _rename(_dump(spec, root, description.sources), kept)
    roots["mission"]["resolved"] = True
    return HEADER + tomli_w.dumps(roots)


def dump_robot(robot: Robot) -> str:
    """Write a robot as a robot file that needs no other: all values, no sources, no `extends`."""
    table = _dump(robot, "robot", {})
    table.pop("extends", None)
    return tomli_w.dumps({"robot": table})


def _rename(value: Any, kept: Mapping[Path, str]) -> Any:
    """Rename the files of kinds according to `kept`."""
    if isinstance(value, dict):
        return {name: _rename(child, kept) for name, child in value.items()}
    match = IN_FILE.fullmatch(value) if isinstance(value, str) else None
    if match is None or Path(match[1]) not in kept:
        return value
    return f"{kept[Path(match[1])]}:{match[2]}"


def _dump(value: Any, key: str, sources: dict[str, Source]) -> Any:
    if isinstance(value, Spec):
        table: dict[str, Any] = {}
        for name in type(value).model_fields:
            child = getattr(value, name)
            if child is None:
                continue
            if name in value.inline_tables:
                for sub, item in child.items():
                    table[sub] = _dump(item, f"{key}.{sub}", sources)
            else:
                table[name] = _dump(child, f"{key}.{name}", sources)
        return table
    if isinstance(value, dict):
        return {name: _dump(child, f"{key}.{name}", sources) for name, child in value.items()}
    if isinstance(value, list):
        plain: Any = [_dump(child, f"{key}.{i}", sources) for i, child in enumerate(value)]
    else:
        plain = value
    source = sources.get(key)
    if source is None:
        return plain
    wrapped: dict[str, Any] = {"value": plain, "source": source.kind}
    if source.note:
        wrapped["note"] = source.note
    if source.range is not None:
        wrapped["range"] = list(source.range)
    return wrapped
