"""Removes compiled code whose callees changed.

numba stores compiled functions beside their source and compiles again when that file changes. It
does not detect changes in other files whose functions are called or whose records are used. After
an update of a checkout, machine code of two versions would run together, at worst writing past the
end of a record. The first process after a change therefore removes the code of all modules that
import changed files, directly or indirectly.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

IMPORT = re.compile(r"^\s*(?:from|import) (skywright[\w.]*)(?: import ([^\n(]*|\([^)]*\)))?", re.M)

Stamps = dict[str, list[int]]  # modification time (ns) and size of each module's file


def drop_stale_code(root: Path) -> list[str]:
    """Remove compiled code below `root` (the package) that a changed file made stale.

    Returns the modules whose code was removed. Does nothing if the folder cannot be written (numba
    then caches installed versions elsewhere, and their files do not change).
    """
    elsewhere = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(elsewhere) if elsewhere else root / "__pycache__"
    stamps = folder / f"skywright-{hashlib.sha256(os.fsencode(root)).hexdigest()[:8]}.json"
    now = read_stamps(root)
    try:
        before: Stamps = json.loads(stamps.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        before = {}
    if now == before:
        return []
    changed = {name for name in now.keys() | before.keys() if now.get(name) != before.get(name)}
    try:
        stale = sorted(find_dependents(changed, _read_imports(root, now)))
        for name in stale:
            for file in _list_compiled(root, name, folder if elsewhere else None):
                file.unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        fresh = stamps.with_suffix(f".{os.getpid()}")
        fresh.write_text(json.dumps(now), encoding="utf-8")
        fresh.replace(stamps)
    except OSError:
        return []
    return stale


def find_dependents(changed: Iterable[str], imports: Mapping[str, Iterable[str]]) -> set[str]:
    """Return the modules that import any of `changed`, directly or not, and `changed` too."""
    users = defaultdict(set)
    for name, used in imports.items():
        for one in used:
            users[one].add(name)
    found, open_ = set(changed), list(changed)
    while open_:
        fresh = users[open_.pop()] - found
        found |= fresh
        open_ += fresh
    return found


def read_stamps(root: Path) -> Stamps:
    """Return modification time and size of the modules below `root`, by module name."""
    stamps = {}
    for folder, folders, files in os.walk(root):
        folders[:] = [f for f in folders if f not in ("__pycache__", "data", "templates")]
        for file in files:
            if file.endswith(".py"):
                path = os.path.join(folder, file)
                status = os.stat(path)
                stamps[_name_module(root, path)] = [status.st_mtime_ns, status.st_size]
    return stamps


def _name_module(root: Path, path: str) -> str:
    parts = Path(path).relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _read_imports(root: Path, modules: Iterable[str]) -> dict[str, set[str]]:
    known = set(modules)
    imports: dict[str, set[str]] = {}
    for name in known:
        path = root.parent.joinpath(*name.split("."))
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        with suppress(OSError):  # deleted: it only has users
            imports[name] = set(_list_imports(file.read_text(encoding="utf-8"), known))
    return imports


def _list_imports(text: str, known: set[str]) -> Iterable[str]:
    for module, names in IMPORT.findall(text):
        if module in known:
            yield module
        for one in re.findall(r"\w+", names):
            if f"{module}.{one}" in known:
                yield f"{module}.{one}"


def _list_compiled(root: Path, module: str, elsewhere: Path | None) -> Iterable[Path]:
    """Return the files of numba's cache that belong to a module."""
    path = root.parent.joinpath(*module.split("."))
    pattern = f"{path.name}.*.nb[ic]"
    if elsewhere is None:
        return (path.parent / "__pycache__").glob(pattern)
    return elsewhere.glob(f"{path.parent.name}_*/{pattern}")  # numba: folder's name and hash
