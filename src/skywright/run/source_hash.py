"""Versions of the code that computed a result: a hash of this package's files, and dependencies."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

SHOWING = {"reports", "ground", "analysis", "evidence", "cli", "__main__.py"}
"""Packages that display or use the results of a flight and do not affect them."""


@cache
def collect_code_versions(*also: str) -> dict[str, str]:
    """Return the versions of the code that affects a flight; `code` hashes this package's files.

    `also` names files of the excluded packages, relative to the package's folder, to include.
    """
    digest, root = hashlib.sha256(), Path(__file__).parents[1]
    files = [p for p in root.rglob("*") if p.suffix in (".py", ".toml")]
    own = [p for p in files if p.relative_to(root).parts[0] not in SHOWING]
    for path in sorted([*own, *(root / name for name in also)]):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    names = ("mujoco", "numba", "numpy", "scipy")
    return {"code": digest.hexdigest()[:16], **{name: version(name) for name in names}}
