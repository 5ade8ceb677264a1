"""Cache of numba for users' files: addressed by content, in the user's cache folder.

numba normally stores compiled code beside its source and checks only that file. For users' files,
the cache folder is named after the module, whose name changes with the file and its imports, and a
hash of this package. A copy in a run's directory reuses the code, and stale code is never used.
Modules with cached code import `njit` from here, which removes stale code before any is loaded.
"""

from __future__ import annotations

import hashlib
import json
import os
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit as njit
from numba.core.caching import CacheImpl

from skywright.core.compiled_code import drop_stale_code, read_stamps
from skywright.core.user_files import is_user_module


class UserCode:
    """A cache locator of numba."""

    def __init__(self, function: Any, folder: Path) -> None:
        self.function, self.folder = function, folder

    @classmethod
    def from_function(cls, function: Any, file: str) -> UserCode | None:
        """Return the locator for a function of a user's file; None: numba chooses another one."""
        if not is_user_module(function.__module__):
            return None
        self = cls(function, _choose_folder() / f"{function.__module__}_{_hash_package()}")
        try:
            self.ensure_cache_path()
        except OSError:
            return None
        return self if os.access(self.folder, os.W_OK) else None

    def ensure_cache_path(self) -> None:
        """Create the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def get_source_stamp(self) -> str:
        """Return the stamp that must match for code to be up to date."""
        return self.folder.name

    def get_disambiguator(self) -> str:
        """Distinguish functions with the same name."""
        return str(self.function.__code__.co_firstlineno)


def _choose_folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(os.environ.get("NUMBA_CACHE_DIR") or Path(base, "skywright", "compiled"))


@cache
def _hash_package() -> str:
    stamps = json.dumps(read_stamps(Path(__file__).parents[1]), sort_keys=True)
    return hashlib.sha256(stamps.encode()).hexdigest()[:12]


drop_stale_code(Path(__file__).parents[1])  # before any compiled code is loaded
places: list[Any] = CacheImpl._locator_classes
places.insert(0, UserCode)
