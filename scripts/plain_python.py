"""A pytest plugin: compiled functions run as plain Python, with attribute access to records.

Use `pytest -p plain_python` with this folder on the path. Code that calls MuJoCo or a step by its
address (a flight) does not work.
"""

import functools

import numba
import numpy as np

import skywright.core.record as record


class Rows(np.ndarray):
    """An array of records whose elements are views as well."""

    def __getitem__(self, key):
        """Return the element, a record as a view."""
        value = super().__getitem__(key)
        return record.View(value) if isinstance(value, np.void) else value


def _show(value):
    if isinstance(value, np.void):
        return record.View(value)
    if isinstance(value, np.ndarray) and value.dtype.names:
        return value.view(Rows)
    return value


def njit(*args, **options):
    """Return the function itself, with its records as views."""
    if not args or not callable(args[0]):
        return njit
    function = args[0]

    @functools.wraps(function)
    def call(*values, **named):
        return function(*map(_show, values), **named)

    call.py_func = function
    return call


numba.njit = njit
