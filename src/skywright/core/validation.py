"""Validation of a description's roots: converts pydantic's errors to single plain lines.

Each line states the file, the key, the value found and the valid values.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, get_args

from pydantic import ValidationError

from skywright.core.key_names import describe_unknown
from skywright.core.keys import as_model, list_inline_tables, strip_optional, walk_path
from skywright.core.spec import Spec
from skywright.core.toml_files import describe_value
from skywright.errors import InputError

S = TypeVar("S", bound=Spec)


def validate_root(
    model: type[S],
    tree: Mapping[str, Any],
    root: str,
    origin: Mapping[str, str],
    fallback: str,
) -> S:
    """Validate a root, or raise InputError with the first problem; see `list_problems`."""
    spec, problems = list_problems(model, tree, root, origin, fallback)
    if spec is None:
        more = len(problems) - 1
        raise InputError(problems[0] + (f" (and {more} more problems)" if more else ""))
    return spec


def list_problems(
    model: type[S],
    tree: Mapping[str, Any],
    root: str,
    origin: Mapping[str, str],
    fallback: str,
) -> tuple[S | None, list[str]]:
    """Validate a root against its spec.

    Returns (the spec or None, problems), each problem one line that starts with the file (or
    `--set`) that defined the key; `fallback` names the file if none defined it.
    """
    try:
        return model.model_validate(tree), []
    except ValidationError as error:
        problems = []
        for item in error.errors(include_url=False):
            path = _file_path(model, list(item["loc"]))
            key = ".".join([root, *map(str, path)])
            where = _find_origin(origin, key) or fallback
            line = f"{where}: {_describe_item(model, tree, item, path, key)}"
            if line not in problems:
                problems.append(line)
        return None, problems


def _file_path(model: type[Spec], loc: list[Any]) -> list[Any]:
    """Convert pydantic's location to the path in the file (inline tables are hidden)."""
    path: list[Any] = []
    annotation: object = model
    for name in loc:
        current = as_model(annotation)
        if current is not None:
            field = current.model_fields.get(name)
            annotation = field.annotation if field is not None else None
            if name in current.inline_tables:
                continue
        else:
            args = get_args(strip_optional(annotation))
            annotation = args[-1] if args else None
        path.append(name)
    return path


def _find_origin(origin: Mapping[str, str], key: str) -> str | None:
    """Return the origin of a key: of itself, of a key inside it, or of the table around it."""
    if key in origin:
        return origin[key]
    inside = [label for k, label in origin.items() if k.startswith(key + ".")]
    if inside:
        return inside[-1]
    parent = key.rpartition(".")[0]
    return _find_origin(origin, parent) if "." in parent else None


def _describe_item(
    model: type[Spec], tree: Mapping[str, Any], item: Any, path: list[Any], key: str
) -> str:
    """Return one pydantic error in the wording of Skywright."""
    kind, found, ctx = item["type"], item.get("input"), item.get("ctx", {})
    if kind == "extra_forbidden":
        parent, here = walk_path(model, tree, path[:-1])
        names = [n for n in parent.model_fields if n not in parent.inline_tables] if parent else []
        names += [n for n in (list_inline_tables(parent, here) if parent else []) if n != path[-1]]
        return describe_unknown(str(path[-1]), key.rpartition(".")[0], names)
    if kind == "missing":
        table, _, name = key.rpartition(".")
        siblings = walk_path(model, tree, path[:-2])[1] if len(path) > 1 else None
        hint = ""
        if isinstance(siblings, dict) and len(path) > 2:
            near = [n for n, v in siblings.items() if isinstance(v, dict) and n != path[-2]]
            hint = f" (tables at the same level: {', '.join(near)})" if near else ""
        return f"{table} lacks {name}{hint}"
    if kind == "value_error":
        return f"{key}: {ctx.get('error', item['msg'])}"
    if kind == "finite_number":
        return f"{key} is {found}; a finite number is needed"
    if kind == "literal_error":
        return f"{key} is {describe_value(found)}; valid: {ctx['expected'].replace(' or ', ', ')}"
    return f"{key} is {describe_value(found)}; {_describe_need(kind, found, ctx)}"


def _describe_need(kind: str, found: object, ctx: Mapping[str, Any]) -> str:
    """Return the description of valid values for a pydantic error."""
    limits = {
        "greater_than": ("gt", "greater than"),
        "greater_than_equal": ("ge", "at least"),
        "less_than": ("lt", "less than"),
        "less_than_equal": ("le", "at most"),
    }
    if kind in limits:
        name, words = limits[kind]
        return f"it must be {words} {ctx[name]:g}"
    if kind in ("too_short", "too_long"):
        if kind == "too_short":
            return f"at least {ctx['min_length']} entries are needed"
        return f"at most {ctx['max_length']} entries are possible"
    needs = {
        "float_type": "a number is needed",
        "int_type": "a whole number is needed",
        "int_from_float": "a whole number is needed",
        "string_type": "text is needed",
        "bool_type": "true or false is needed",
        "list_type": "a list is needed",
        "dict_type": "a table is needed",
        "model_type": "a table is needed",
    }
    need = needs.get(kind, kind.replace("_", " "))
    if kind in ("float_type", "int_type") and isinstance(found, dict):
        need += ", plain or as { value = ..., source = ... }"
    return need
