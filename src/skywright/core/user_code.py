"""Where numba keeps what it compiled of users' files: by content, in the user's cache folder.

numba keeps compiled code beside its source and knows of that file alone. Of users' files it stands
under the name of their module, which changes with them and with what they import, and under a hash
of this package: a copy in a run's directory finds it, and stale code is never found.
Code that is kept imports `njit` from here: stale code is then dropped before any is loaded.
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
        """Return the place of a function of a user's file; None has numba choose."""
        if not is_user_module(function.__module__):
            return None
        self = cls(function, _choose_folder() / f"{function.__module__}_{_hash_package()}")
        try:
            self.ensure_cache_path()
        except OSError:
            return None
        return self if os.access(self.folder, os.W_OK) else None

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def get_source_stamp(self) -> str:
        """Return what must agree for code to be up to date."""
        return self.folder.name

    def get_disambiguator(self) -> str:
        """Tell functions of one name apart."""
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
