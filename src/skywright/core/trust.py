"""Decides whether code of a file may run: code from a run must have run here before.

A file that the user names, directly or in his own description, is loaded, and its content is
remembered. If a run's directory or a recording names the file (`guarded`), only remembered content
is loaded; `--trust`, or SKYWRIGHT_TRUST=1, loads and remembers it.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from skywright.core.user_files import hash_as_it_is
from skywright.errors import InputError

_guarded: ContextVar[str | None] = ContextVar("guarded", default=None)
_here: set[str] = set()


@contextmanager
def guarded(what: str | None) -> Iterator[None]:
    """Load no code inside that has not run here before; `what` names the description.

    None changes nothing.
    """
    token = _guarded.set(what or _guarded.get())
    try:
        yield
    finally:
        _guarded.reset(token)


def trust_all() -> None:
    """Load and remember all code from now on: `--trust`."""
    os.environ["SKYWRIGHT_TRUST"] = "1"


def check_trust(path: Path) -> None:
    """Raise InputError if the code of a file must not be loaded; else remember it."""
    name = hash_as_it_is(path)
    marker = _choose_folder() / name
    what = _guarded.get()
    known = name in _here or marker.is_file()
    if what is not None and not known and os.environ.get("SKYWRIGHT_TRUST") != "1":
        raise InputError(
            f"{what} contains code that has not been executed on this computer, {path}; "
            "review it, then use --trust (SECURITY.md)"
        )
    _here.add(name)
    if not known:
        with suppress(OSError):  # it will be refused again
            marker.parent.mkdir(parents=True, exist_ok=True)
            marker.touch()


def _choose_folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "skywright" / "trusted"
