"""Importing a user's file, and the files beside it that it imports.

The name of a file's module follows from its content and from that of the files beside it that it
imports (`import gains`, `from .gains import K`). The `gains.py` of two folders therefore do not
collide, an edited file is a new module, and numba finds its code by content (user_code.py).
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from typing import Any, NamedTuple

from skywright.core.bounded import LARGEST_CODE, read_bytes


class PythonEndedError(Exception):
    """A user's file ended the process that imported it (os._exit, a segmentation fault)."""


class _Source(NamedTuple):
    data: bytes
    beside: dict[str, Path]  # files beside it that it imports, by their names in the imports


class _Module(NamedTuple):
    path: Path
    data: bytes
    names: dict[str, str]  # of modules, by their names in the imports


_Sources = dict[Path, _Source]

_modules: dict[str, _Module] = {}
_loaded: dict[Path, _Sources] = {}  # the sources of a file at its last load
_in_child_first: ContextVar[bool] = ContextVar("in_child_first", default=False)


def load_file(path: Path) -> Any:
    """Import a user's file. Raises its errors, and PythonEndedError (`tried_first`)."""
    _loaded[path] = found = _read(path, {})
    for one, source in found.items():
        names = {name: _name_module(other, found) for name, other in source.beside.items()}
        _modules[_name_module(one, found)] = _Module(one, source.data, names)
    name = _name_module(path, found)
    if _in_child_first.get() and name not in sys.modules and (how := _try_in_child(path, name)):
        raise PythonEndedError(f"the file ends the Python process ({how})")
    return importlib.import_module(name)


def is_user_module(name: str) -> bool:
    """Whether a module of this name is a user's file."""
    return name in _modules


def read_sources(path: Path) -> dict[Path, bytes]:
    """Return a user's file and the files beside it that it imports, with the content as loaded.

    Raises OSError if the file was not loaded and cannot be read.
    """
    found = _loaded.get(path) or _read(path, {})
    return {one: source.data for one, source in found.items()}


def hash_as_it_is(path: Path) -> str:
    """Return the hash of the present content of a user's file and of the files that it imports."""
    return _name_module(path, _read(path, {}))


def hash_sources(paths: Iterable[Path]) -> str:
    """Return a hash of users' files and of the files that they import, for any folder."""
    digest = hashlib.sha256()
    for path in paths:
        for one, data in sorted(read_sources(path).items()):
            digest.update(one.name.encode() + b"\0" + data + b"\0")
    return digest.hexdigest()[:12]


@contextmanager
def tried_first() -> Iterator[None]:
    """Import users' files in a separate process first, to report one that ends Python."""
    token = _in_child_first.set(True)
    try:
        yield
    finally:
        _in_child_first.reset(token)


@cache
def _try_in_child(path: Path, name: str) -> str:
    """Import a file in another process; returns how that process ended, "" if it survived."""
    done = subprocess.run(
        [sys.executable, "-m", __name__, str(path)], stdin=subprocess.DEVNULL, capture_output=True
    )
    if done.stdout.endswith(b"imported"):
        return ""
    with suppress(ValueError):
        return signal.Signals(-done.returncode).name
    return f"exit code {done.returncode}"


def _read(path: Path, found: _Sources) -> _Sources:
    """Add a file, and what it imports beside it, to `found`."""
    if path not in found:
        data = read_bytes(path, LARGEST_CODE)
        names = {name: path.with_name(f"{name}.py") for name in _list_imports(data)}
        found[path] = _Source(data, {n: other for n, other in names.items() if other.is_file()})
        for other in found[path].beside.values():
            _read(other, found)
    return found


def _list_imports(data: bytes) -> set[str]:
    """Return the imported names, also inside functions, without those of Python and Skywright."""
    try:
        tree = ast.parse(data)
    except (SyntaxError, ValueError):  # reported at the import
        return set()
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level < 2:
            names.update([node.module] if node.module else [alias.name for alias in node.names])
    return names - sys.stdlib_module_names - {"skywright"}


def _name_module(path: Path, sources: _Sources) -> str:
    """Return the module name of a file, from its content and that of its imports."""
    digest, found, waiting = hashlib.sha256(), set[Path](), [path]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.add(one)
            waiting += sources[one].beside.values()
    for one in sorted(found):
        digest.update(one.name.encode() + b"\0" + sources[one].data + b"\0")
    return f"skywright_user_{path.stem}_{digest.hexdigest()[:12]}"


class _Renamed(ast.NodeTransformer):
    """Turns imports of files beside a file into imports of their modules."""

    def __init__(self, names: dict[str, str]) -> None:
        self.names = names

    def visit_Import(self, node: ast.Import) -> ast.AST:
        for alias in node.names:
            if alias.name in self.names:
                alias.asname, alias.name = alias.asname or alias.name, self.names[alias.name]
        return node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST:
        if node.level < 2 and node.module in self.names:
            node.module, node.level = self.names[node.module], 0
        elif node.level == 1 and node.module is None:  # from . import gains
            return self.visit_Import(ast.copy_location(ast.Import(node.names), node))
        return node


class _Loader(SourceFileLoader):
    """Compiles the content as read; stores no bytecode, which would contain module names."""

    def get_code(self, fullname: str) -> Any:
        module = _modules[fullname]
        tree = _Renamed(module.names).visit(ast.parse(module.data, str(module.path)))
        return compile(tree, str(module.path), "exec", dont_inherit=True)


class _Finder:
    """Finds modules of users' files, wherever they are imported."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if name not in _modules:
            return None
        file = str(_modules[name].path)
        return spec_from_file_location(name, file, loader=_Loader(name, file))


finder: Any = _Finder
sys.meta_path.append(finder)

if __name__ == "__main__":
    with suppress(Exception, SystemExit):  # errors are reported at the import
        load_file(Path(sys.argv[1]))
    sys.stdout.write("imported")
    sys.stdout.flush()
    os._exit(0)
