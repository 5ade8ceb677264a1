"""Arrays on the stack: right values, no allocation, the same in plain Python."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from skywright.core.scratch import local

ROWS, COLUMNS = 4, 2


@njit(error_model="numpy")
def _inner(k: int, out: Any) -> None:
    a = local(ROWS)
    for i in range(ROWS):
        a[i] = k + i
    for i in range(ROWS):
        out[i] += a[i]


@njit(error_model="numpy")
def _sum(n: int, out: Any) -> float:
    """Arrays of two sizes in a loop, next to those of a callee."""
    a, M = local(ROWS), local(ROWS, COLUMNS)
    total = 0.0
    for k in range(n):
        a[:] = 0.0
        _inner(k, a)
        for i in range(ROWS):
            for j in range(COLUMNS):
                M[i, j] = a[i] * (j + 1)
        for j in range(COLUMNS):
            total += M[:, j].sum()
    for i in range(ROWS):
        out[i] = a[i]
    return total


def test_compiled_and_plain_python_agree() -> None:
    fast, slow = np.zeros(ROWS), np.zeros(ROWS)
    assert _sum(100, fast) == _sum.py_func(100, slow)
    assert np.array_equal(fast, slow)
    assert np.array_equal(fast, 99.0 + np.arange(ROWS))


def test_nothing_is_allocated() -> None:
    out = np.zeros(ROWS)
    _inner(1, out)
    assert "NRT_MemInfo_alloc" not in _inner.inspect_llvm(_inner.signatures[0])
