"""Write docs/reference/keys.md, every key of robot, world, mission and plant, from the specs.

    python docs/generate_reference.py     (`make docs` does it)

A key's description is the comment on its line in the spec; a table's is the class's docstring.
"""

from __future__ import annotations

import ast
import inspect
import io
import re
import tokenize
import types
import typing
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import annotated_types as limits
from pydantic.fields import FieldInfo

from skywright.core.find import find, list_kinds
from skywright.core.open_spec import OpenSpec
from skywright.core.spec import Spec
from skywright.description.mission.spec import Mission, Plant
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World

OUT = Path(__file__).parent / "reference" / "keys.md"

# Longest suffix first: the unit is part of the key.
UNITS = {
    "_deg_per_min": "°/min",
    "_m_per_sqrt_m": "m/√m",
    "_m_per_sqrt_s": "m/√s",
    "_n_per_rad2s2": "N/(rad/s)²",
    "_n_per_count": "N/count",
    "_ns_per_m": "N s/m",
    "_count": "counts",
    "_n_per_rads_mps": "N/((rad/s)(m/s))",
    "_nms_per_rad": "N m s/rad",
    "_nm_per_rad": "N m/rad",
    "_rad_s2_sqrthz": "rad/s²/√Hz",
    "_rad_s_sqrthz": "rad/s/√Hz",
    "_mps2_sqrthz": "m/s²/√Hz",
    "_mps3_sqrthz": "m/s³/√Hz",
    "_s_per_m": "S/m",
    "_kg_m3": "kg/m³",
    "_n_per_m": "N/m",
    "_kgm2": "kg m²",
    "_rad_s": "rad/s",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_m_per_s": "m/s",
    "_kbps": "kbit/s",
    "_deg": "deg",
    "_rad": "rad",
    "_nm": "N m",
    "_kg": "kg",
    "_hz": "Hz",
    "_wh": "W h",
    "_m2": "m²",
    "_m": "m",
    "_n": "N",
    "_s": "s",
    "_w": "W",
}

INTRODUCTION = """\
# Keys of robot, world, mission and plant

*Made from the specs by `docs/generate_reference.py`; do not edit.*

A description has four roots. A robot file fills `robot`, a world file `world`, a mission file
`mission`, and any file may fill `plant`, deviations of the simulated truth from the
nominal model. Each layer overrides the one before it: robot, world, mission, `--set`.

- The unit is part of the key. A key without a unit is dimensionless.
- Every number may carry its source:
  `mass_kg = { value = 1.6, source = "paper", note = "Tognon 2018, Table I" }`. The source is
  `paper`, `derived`, `datasheet`, `assumed` (which needs a `range = [low, high]`), `set`,
  `imported` (from an imported file) or `asked` (entered during the import). Built-in robots have
  one on every number that applies to them.
- Unknown keys are rejected, with the nearest valid ones.
- `NAME` stands for a name that you choose.
- Keys of components (laws, estimators, sensors, actuators, effects, faults, rules) are on the pages
  of the components.
"""


def _comments(model: type[Spec]) -> dict[str, str]:
    """Return what is said of each field of `model`: on its last line, else on the lines above."""
    source = inspect.getsource(model)
    lines = source.splitlines()
    on_line = {
        token.start[0]: token.string.lstrip("# ").strip()
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT and not token.string.startswith("# type:")
    }
    body = typing.cast(ast.ClassDef, ast.parse(source).body[0]).body
    found = {}
    for node in body:
        if not isinstance(node, ast.AnnAssign):
            continue
        said, above = [on_line.get(node.end_lineno or 0, "")], node.lineno - 1
        while not said[-1] and lines[above - 1].lstrip().startswith("#"):
            said.insert(0, on_line[above])
            above -= 1
        found[typing.cast(ast.Name, node.target).id] = " ".join(said).strip()
    return found


def _unit(key: str) -> str:
    return next((unit for suffix, unit in UNITS.items() if key.endswith(suffix)), "")


def _options(annotation: Any) -> list[Any]:
    """The members of a union, or the annotation itself; None left out."""
    if get_origin(annotation) in (typing.Union, types.UnionType):
        return [a for a in get_args(annotation) if a is not type(None)]
    return [annotation]


def _subtable(annotation: Any) -> tuple[str, type[Spec]] | None:
    """Return how a nested table is written below its key, and its spec."""
    for option in _options(annotation):
        if isinstance(option, type) and issubclass(option, Spec):
            return "", option
        inner = get_args(option)[-1] if get_args(option) else None
        if isinstance(inner, type) and issubclass(inner, Spec):
            return (".NAME" if get_origin(option) is dict else ".0"), inner
    return None


def _type_name(annotation: Any) -> str:
    names = []
    for option in _options(annotation):
        if get_origin(option) is typing.Annotated:
            option = get_args(option)[0]
        if get_origin(option) is Literal:
            names.append(", ".join(f"`{value}`" for value in get_args(option)))
        elif get_origin(option) is dict:
            names.append(f"{_type_name(get_args(option)[1])} by name")
        elif get_origin(option) is list:
            names.append(f"list of {_type_name(get_args(option)[0])}")
        else:
            names.append(
                {
                    "float": "number",
                    "int": "whole number",
                    "bool": "true or false",
                    "str": "text",
                }.get(getattr(option, "__name__", ""), str(option))
            )
    return " or ".join(names)


def _bounds(field: FieldInfo) -> str:
    """The allowed range; limits sit on the field and inside Annotated options."""
    metadata = list(field.metadata)
    for option in _options(field.annotation):
        if get_origin(option) is typing.Annotated:
            for item in get_args(option)[1:]:
                metadata += getattr(item, "metadata", [item])
    words = []
    for item in metadata:
        for kind, name, sign in (
            (limits.Gt, "gt", ">"),
            (limits.Ge, "ge", "≥"),
            (limits.Lt, "lt", "<"),
            (limits.Le, "le", "≤"),
        ):
            if isinstance(item, kind):
                words.append(f"{sign} {getattr(item, name):g}")
        if isinstance(item, limits.MinLen):
            words.append(f"{item.min_length} entries or more")
        if isinstance(item, limits.MaxLen):
            words.append(f"{item.max_length} entries or fewer")
    return ", ".join(words)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    value = field.default
    if value is None or value == "" or value == {} or value == []:
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _tables(path: str, model: type[Spec]) -> list[str]:
    comments: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if issubclass(base, Spec):
            comments |= {name: text for name, text in _comments(base).items() if text}
    rows, below = [], []
    for key, field in model.model_fields.items():
        nested = _subtable(field.annotation)
        if nested is not None:
            suffix, sub = nested
            if issubclass(sub, OpenSpec):
                for kind in list_kinds(sub.group):
                    below += _tables(f"{path}.{key}{suffix}", find(sub.group, kind).cls)
                continue
            # An arm's links and servos are written as tables directly below `robot.arm`.
            inner = f"{path}.NAME" if path == "robot.arm" else f"{path}.{key}{suffix}"
            below += _tables(inner, sub)
            continue
        if key == "task" and isinstance(field.annotation, typing.TypeVar):
            continue  # each kind has its own, below
        value = ", ".join(p for p in (_type_name(field.annotation), _bounds(field)) if p)
        meaning = comments.get(key, "").replace("|", "\\|")
        rows.append(f"| `{key}` | {_unit(key)} | {_default(field)} | {value} | {meaning} |")
    shown = f"[[{path[:-2]}]] (one table for each)" if path.endswith(".0") else path
    title = f"## {path}" if "." not in path else f"### {shown}"
    of_kind = path == "robot.arm.NAME" or issubclass(model, OpenSpec)
    name = f" ({re.sub(r'(?<!^)(?=[A-Z])', '_', model.__name__).lower()})" if of_kind else ""
    lines = [title + name, "", inspect.cleandoc(model.__doc__ or ""), ""]
    if rows:
        lines += ["| key | unit | default | value | meaning |", "|---|---|---|---|---|", *rows, ""]
    return lines + below


def build_page() -> str:
    """Return the page as Markdown."""
    lines = [INTRODUCTION]
    for root, model in (("robot", Robot), ("world", World), ("mission", Mission), ("plant", Plant)):
        lines += _tables(root, model)
        for kind in list_kinds("kind") if root == "mission" else ():
            first, *rest = _tables("mission.task", find("kind", kind).cls.task)
            lines += [f"{first} (kind {kind})", *rest]
    return "\n".join(lines)


if __name__ == "__main__":
    OUT.parent.mkdir(exist_ok=True)
    OUT.write_text(build_page(), encoding="utf-8")
