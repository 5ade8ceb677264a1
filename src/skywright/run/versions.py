"""Versions of the software that computed a run."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version


def collect_versions() -> dict[str, str]:
    """Return the versions of the software that computed a run."""
    out = {"python": platform.python_version()}
    for name in ("skywright", "mujoco", "numba", "numpy"):
        try:
            out[name] = version(name)
        except PackageNotFoundError:
            out[name] = "unknown"
    return out
