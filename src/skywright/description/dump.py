"""Writing a description back: the resolved mission.toml of a run, from which it can be repeated."""

from __future__ import annotations

from typing import Any

import tomli_w

from skywright.core.spec import Source, Spec
from skywright.description.loader import Description

HEADER = "# A complete description: `skywright run` on this file, or on its folder, repeats it.\n\n"


def dump_description(description: Description) -> str:
    """Write the whole description as TOML, sources included.

    `load_description` on the result gives an equal description (but for `origin`).
    """
    roots: dict[str, Any] = {}
    for root in ("mission", "robot", "world", "plant"):
        spec: Spec = getattr(description, root)
        roots[root] = _dump(spec, root, description.sources)
    roots["mission"]["resolved"] = True
    return HEADER + tomli_w.dumps(roots)


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
