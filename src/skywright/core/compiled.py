"""Functions that steps call: compiled without wrappers, plain Python when called from Python."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable
from functools import cached_property, partial, update_wrapper
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np
from numba import carray, types
from numba.core.datamodel import models, register_default
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.core.imputils import lower_cast

from skywright.core.pointers import as_pointer
from skywright.core.user_code import njit

P = ParamSpec("P")
R = TypeVar("R")

# intended: a helper takes the record of a law as that of the loop that the law inherits
warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)

COMPILE: Any = {
    "cache": True, "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True,
}  # fmt: skip
"""Options for code that only compiled code calls: they halve the compilation time."""


class HelperType(types.Dispatcher):
    """numba type of a helper: one signature for arrays of all records.

    numba has a type for each shape of a record's array and for each constant, and would compile a
    product of two matrices eight times.
    """

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        named = {name: _simplify(kind) for name, kind in kws.items()}
        return super().get_call_type(context, tuple(map(_simplify, args)), named)


register_default(HelperType)(models.OpaqueModel)


def _simplify(kind: Any) -> Any:
    if isinstance(kind, types.NestedArray):
        return types.Array(kind.dtype, kind.ndim, "C")
    return types.unliteral(kind)


@lower_cast(types.NestedArray, types.Array)
def _cast_nested(_context: Any, _builder: Any, _from: Any, _to: Any, value: Any) -> Any:
    return value  # both have the same structure


class Helper(Generic[P, R]):
    """A function for compiled code. From Python it, or `python` in its place, runs uncompiled."""

    def __init__(
        self, function: Callable[P, R], python: Callable[P, R] | None = None, **options: Any
    ) -> None:
        self.py_func = python or function
        self._build = partial(njit(**{**COMPILE, **options}), function)
        update_wrapper(self, function)

    dispatcher: Any = cached_property(lambda self: self._build())  # built on demand

    @property
    def _numba_type_(self) -> Any:
        return HelperType(self.dispatcher)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        return self.py_func(*args, **kwargs)


def helper(function: Callable[P, R]) -> Helper[P, R]:
    """Decorate a function that steps call; see `Helper`."""
    return Helper(function)


def _words(address: int, n: int) -> Any:
    """Return the `n` numbers at an address, such as `words(mj.qpos, mj.nq)`."""
    return carray(as_pointer(address), n, np.float64)


def _integers(address: int, n: int) -> Any:
    """Return the `n` integers at an address."""
    return carray(as_pointer(address), n, np.int64)


def _table(address: int, rows: int, columns: int) -> Any:
    """Return the rows of numbers at an address, such as `table(mj.xfrc, mj.nbody, 6)`."""
    return carray(as_pointer(address), (rows, columns), np.float64)


def _python_words(address: int, n: int) -> Any:
    numbers: Any = (ctypes.c_double * int(n)).from_address(int(address))
    return np.frombuffer(numbers)


def _python_integers(address: int, n: int) -> Any:
    return _python_words(address, n).view(np.int64)


def _python_table(address: int, rows: int, columns: int) -> Any:
    return _python_words(address, int(rows) * int(columns)).reshape(int(rows), int(columns))


words = Helper(_words, _python_words, inline="always")
integers = Helper(_integers, _python_integers, inline="always")
table = Helper(_table, _python_table, inline="always")
