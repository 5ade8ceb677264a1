"""Linear algebra on one thread, so that sums do not depend on the number of cores.

A multithreaded BLAS splits long sums, and the last bits of a result depend on the split: a run on
two cores would differ from the same run on one. The matrices are too small to gain from threads.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
R = TypeVar("R")


def on_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Run `function` with every loaded BLAS limited to one thread; the limits are then restored."""

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
