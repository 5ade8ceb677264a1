"""A pytest plugin: compiled functions run as plain Python, records by attribute as when compiled.

`pytest -p plain_python` with this folder on the path. What calls MuJoCo or a step by its address
(a flight) does not work so.
"""

import functools

import numba
import numpy as np

import skywright.core.record as record


def njit(*args, **options):
    """Return the function itself, with its records as views."""
    if not args or not callable(args[0]):
        return njit
    function = args[0]

    @functools.wraps(function)
    def call(*values, **named):
        return function(*(record.View(v) if isinstance(v, np.void) else v for v in values), **named)

    call.py_func = function
    return call


numba.njit = njit
