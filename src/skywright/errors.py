"""Error classes. Every message states what is wrong and lists the valid values."""

from __future__ import annotations

import difflib
import errno
import os
import re
from collections.abc import Callable, Iterable
from functools import wraps
from typing import ParamSpec, TypeVar

OPTION = re.compile(r"(?<![\w./-])(?<!skywright run )--[a-z][a-z0-9-]*(?![\w./])")
"""An option of the command line in a message, not of a command that it quotes; file names may
contain the same characters."""
P = ParamSpec("P")
R = TypeVar("R")


class SkywrightError(Exception):
    """Base of every error that a user can cause; the command line prints it as one line.

    `exit_code` follows the command-line contract: 1 a requirement failed or no plan exists, 2 the
    input is wrong, 3 the simulation failed.
    """

    exit_code = 2


class InputError(SkywrightError):
    """A file, flag, key or stream is wrong; nothing was started."""

    exit_code = 2
    with_options = ""
    """The message that names options, where `naming_arguments` has replaced them."""


class InfeasibleError(SkywrightError):
    """The input is valid but no plan exists; `blocked_by` names the constraint."""

    exit_code = 1

    def __init__(self, message: str, blocked_by: str) -> None:
        super().__init__(message)
        self.blocked_by = blocked_by

    def __reduce__(self) -> tuple[type[InfeasibleError], tuple[str, str]]:
        return InfeasibleError, (str(self), self.blocked_by)  # crosses to another process


class SimulationError(SkywrightError):
    """The simulation diverged or produced NaN."""

    exit_code = 3


DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)
"""Errors of writing, which have no file name."""


def describe_os_error(error: OSError) -> str | None:
    """Return "FILE: reason" for an error of a file or a disk; None for other errors."""
    if not error.filename and error.errno not in DISK_ERRORS:
        return None
    return f"{error.filename or 'an output file'}: {error.strerror}"


LONGEST_NAME = 100
"""Largest number of characters of a name in a message."""


def neighbours(word: str, valid: Iterable[str], count: int = 5) -> str:
    """Return the valid names nearest to `word` for an error message, or all if there are few."""
    names = [name[:LONGEST_NAME] for name in sorted(valid)]
    if len(names) <= count:
        return ", ".join(names)
    word = word[:LONGEST_NAME]
    close = difflib.get_close_matches(word, names, n=count, cutoff=0.3)
    close += [name for name in names if name not in close][: count - len(close)]
    return ", ".join(close) + ", ..."


def check_path(argument: str, value: object, also: str = "") -> None:
    """Raise InputError if an argument is not a path; `also` is what else it may be."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(
            f"{argument}: got {type(value).__name__} {str(value)[:LONGEST_NAME]!r}; valid: a name "
            f"or a path{also}"
        )


def naming_arguments(**options: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let the InputErrors of a function name its arguments in place of the command's options.

    `options` has the options whose names are not those of the arguments: `sets="--set"`, and those
    of values inside an argument.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        code = function.__code__
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        named = {n: "--" + n.replace("_", "-") for n in names} | options
        known = {option: n for n, option in named.items()}

        @wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return function(*args, **kwargs)
            except InputError as error:
                if type(error) is InputError:
                    error.with_options = error.with_options or str(error)
                    error.args = (OPTION.sub(lambda m: known.get(m[0], m[0]), str(error)),)
                raise

        return call

    return decorate
