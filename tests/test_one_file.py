"""What CONTRIBUTING says of adding a law, sensor, estimator, effect or thing: it is one file.

Generic code asks the objects. It neither imports a part nor names one. Parts may build on each
other, and kinds of missions and studies are about some of them: these are exchangeable themselves.
"""

from __future__ import annotations

import ast
import functools
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from click.testing import CliRunner

import skywright
from skywright import cli
from skywright.core import find
from skywright.description.loader import load_description
from skywright.description.template import write_template
from skywright.errors import InputError
from skywright.run.parts import build_estimator, build_law, build_named
from skywright.run.setup import Setup

SOURCE = Path(skywright.__file__).parent
GROUPS = {group: g.package for group, g in find.GROUPS.items() if group != "kind"}
STUDIES = {"missions", "analysis", "evidence"}
ASKS = re.compile(r"(^|_)(kind|law|estimator|sensor|effect|thing)s?$")
"""Ends of names of variables, attributes, functions and keys that hold a kind."""
CALLS = {"find", "Part", "load_built_in", "make_table"}
NAMED = {
    ("run/parts.py", "push_and_slide"): "the law of robots for which nobody says one",
    ("run/parts.py", "thrust_vectoring"): "likewise, where the rotors make no lateral force",
    ("vehicle/arms/drive.py", "compliant"): "the arms law of robots for which nobody says one",
    ("description/mission/spec.py", "filter"): "the default of mission.estimator",
    ("core/streams.py", "range_finder"): "a stream of draws, older than streams of one's own",
    ("core/find.py", "sensor"): "the group of sensors, not the fault of one",
    ("description/robot/sourced.py", "cascade"): "its law alone reads three keys of every robot",
    ("run/backends.py", "bench"): "what holds the robot where a flight begins in the air",
}
"""Where generic code may name a part: defaults, with the reason."""
OLD = "description/world/old_tables.py"
"""Names of tables of version 0.1, which new things do not add to."""


class Words(NamedTuple):
    """What a file imports, and the texts in it that are no docstrings."""

    imports: list[tuple[int, list[str]]]  # line, dotted names
    texts: list[tuple[int, str, bool]]  # line, text, whether it stands where a kind does


def read_words(source: str) -> Words:
    words, nodes = Words([], []), list(ast.walk(ast.parse(source)))
    docs = {id(text) for node in nodes if (text := find_docstring(node)) is not None}
    kinds = set(map(id, list_kind_texts(nodes)))
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            whole = [f"{node.module}.{alias.name}" for alias in node.names]
            words.imports.append((node.lineno, [node.module, *whole]))
        elif isinstance(node, ast.Import):
            words.imports.append((node.lineno, [alias.name for alias in node.names]))
    words.texts.extend(
        (node.lineno, node.value, id(node) in kinds)
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs
    )
    return words


def list_names(words: Words, package: str, name: str) -> Iterator[str]:
    """Yield how a file names the part `name` of a package."""
    module, dashed = f"{package}.{name}", name.replace("_", "-")
    for line, imported in words.imports:
        if any(f"{one}.".startswith(f"{module}.") for one in imported):
            yield f"line {line} imports it"
    anywhere = "_" in name  # else it may be a word of its own
    mark = re.compile(rf"(?<![\w-])({name}|{dashed})(?![\w-])")
    for line, text, is_kind in words.texts:
        said = name in text or dashed in text  # far cheaper than the pattern, and seldom true
        if said and (
            (is_kind and text in (name, dashed, module)) or (anywhere and mark.search(text))
        ):
            yield f"line {line} says {text!r}"


def find_docstring(node: ast.AST) -> ast.AST | None:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return node.value
    return None


def list_kind_texts(nodes: list[ast.AST]) -> Iterator[ast.AST]:
    """Yield the texts that stand where a kind does: compared with one, assigned, asked for."""
    for node in nodes:
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            if any(ASKS.search(end_of(side)) for side in sides):
                for side in sides:
                    yield from ast.walk(side)
        elif isinstance(node, ast.Assign | ast.AnnAssign | ast.NamedExpr):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if node.value is not None and any(ASKS.search(end_of(t)) for t in targets):
                yield from ast.walk(node.value)
        elif isinstance(node, ast.FunctionDef) and ASKS.search(node.name):
            for inner in ast.walk(node):
                if isinstance(inner, ast.Return) and inner.value is not None:
                    yield from ast.walk(inner.value)
        elif isinstance(node, ast.Call):
            for keyword in node.keywords:
                if keyword.arg and ASKS.search(keyword.arg):
                    yield from ast.walk(keyword.value)
            if end_of(node.func) in CALLS:
                for argument in node.args:
                    yield from ast.walk(argument)
        elif isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and ASKS.search(str(key.value)):
                    yield from ast.walk(value)
        elif isinstance(node, ast.Match) and ASKS.search(end_of(node.subject)):
            for case in node.cases:
                yield from ast.walk(case.pattern)


def end_of(node: ast.AST) -> str:
    """Return the last word of a name, an attribute or a subscript; "" of anything else.

    A shape's and a joint's kind are no kinds of parts.
    """
    if isinstance(node, ast.Attribute) and end_of(node.value) in ("shape", "joint"):
        return ""
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        return str(node.slice.value)
    return getattr(node, "attr", getattr(node, "id", ""))


def list_generic() -> list[Path]:
    """List the files of the source that are neither parts nor studies."""
    folders = [SOURCE.joinpath(*package.split(".")[1:]) for package in GROUPS.values()]
    return [
        file
        for file in sorted(SOURCE.rglob("*.py"))
        if file.relative_to(SOURCE).parts[0] not in STUDIES
        and not any(folder in file.parents for folder in folders)
    ]


def test_generic_code_names_no_part() -> None:
    found, used = [], set()
    texts = {str(f.relative_to(SOURCE)): f.read_text("utf-8") for f in list_generic()}
    assert len(texts) > 150 and OLD in texts
    read = functools.cache(lambda file: read_words(texts[file]))
    for group, package in GROUPS.items():
        for name in find.list_modules(group):
            for file, text in texts.items():
                if name not in text and name.replace("_", "-") not in text:
                    continue  # neither an import nor a text of it has the name
                for how in list_names(read(file), package, name):
                    if (file, name) in NAMED:
                        used.add((file, name))
                    elif file != OLD:
                        found.append(f"{file}: {how} ({group} {name})")
    assert not found, "\n".join(found)
    assert used == set(NAMED)  # no exception outlives its reason


@pytest.mark.parametrize(
    "text",
    [
        "from skywright.vehicle.laws.cascade import Cascade",
        "from skywright.vehicle.laws import cascade",
        "import skywright.vehicle.laws.cascade as c",
        "if part.kind == 'cascade': pass",
        "if mission['law'] in ('lqr', 'cascade'): pass",
        "law = given or 'cascade'",
        "law: str = Field(default='cascade')",
        "x = find('law', 'cascade')",
        "x = Part(kind='cascade')",
        "x = {'kind': 'cascade'}",
        "def choose_law():\n    return 'a' if x else 'cascade'",
        "match part.kind:\n    case 'cascade': pass",
    ],
)
def test_the_search_finds_a_part_that_is_named(text: str) -> None:
    assert list(list_names(read_words(text), GROUPS["law"], "cascade"))
    other = read_words(text.replace("cascade", "others"))
    assert not list(list_names(other, GROUPS["law"], "cascade"))


def test_the_search_leaves_words_alone() -> None:
    text = '"""A cascade."""\nx = "cascade"\nif shape == "cascade":\n    """cascade"""\n'
    assert not list(list_names(read_words(text), GROUPS["law"], "cascade"))
    text = "x = f'use {law} or joint_space'"
    assert list(list_names(read_words(text), GROUPS["law"], "joint_space"))


@pytest.mark.parametrize("group", ["law", "sensor", "actuator", "estimator", "effect", "thing"])
def test_one_more_file_is_one_more_part(group: str, tmp_path: Path) -> None:
    """A file in the group's package is listed, loaded, checked and built."""
    word = f"one_more_{group}"
    files = write_template(group, tmp_path / word)
    folder = tmp_path / "more"
    folder.mkdir()
    next(f for f in files if f.suffix == ".py").rename(folder / f"{word}.py")
    package = importlib.import_module(GROUPS[group])
    package.__path__.append(str(folder))
    caches = (find.list_modules, find.list_offers, find.load_built_in)
    try:
        for cache in caches:
            cache.cache_clear()
        listed = CliRunner().invoke(cli.main, ["list", f"{group}s"]).stdout
        assert re.search(rf"(?m)^{word} +\w.* {word.replace('_', '.')}\b", listed), listed
        key = {"law": "mission.law", "estimator": "mission.estimator"}.get(group)
        key = key or {"sensor": "robot.sensors.x", "effect": "world.effects.x",
                      "actuator": "robot.actuators.x"}.get(group)  # fmt: skip
        key = key or "world.things.x"
        place = {f"{key}.{a}_m": 1.0 for a in "xyz"} if group == "thing" else {}
        place = {f"{key}.load": "parcel"} if group == "actuator" else place
        d = load_description("waypoints", "othex", sets={f"{key}.kind": word, **place})
        parts = [build_law(d, Setup(d)), build_estimator(d), *build_named(d),
                 *d.world.things.values()]  # fmt: skip
        assert f"{GROUPS[group]}.{word}" in {type(part).__module__ for part in parts}
        with pytest.raises(InputError, match=rf"{key}.no_such_key"):
            load_description("waypoints", "othex", sets={f"{key}.kind": word, **place,
                                                         f"{key}.no_such_key": 1.0})  # fmt: skip
    finally:
        package.__path__.remove(str(folder))
        sys.modules.pop(f"{GROUPS[group]}.{word}", None)
        for cache in caches:
            cache.cache_clear()
    assert word not in find.list_kinds(group)
