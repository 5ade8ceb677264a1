"""Shared memory of the processes of a vector of environments: one row per environment."""

from __future__ import annotations

import mmap
import os
import tempfile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Layout(NamedTuple):
    """Sizes of the arrays."""

    n: int  # environments
    actions: int
    signals: int
    values: int


class Shared(NamedTuple):
    """Arrays of all environments, in one mapped file without a name."""

    actions: NDArray[np.float32]  # (n, actions)
    seen: NDArray[np.float32]  # (n, signals)
    last: NDArray[np.float32]  # (n, signals), final observation of an episode that ended
    reward: NDArray[np.float64]  # (n,)
    values: NDArray[np.float64]  # (n, values)
    terminated: NDArray[np.bool_]  # (n,)
    truncated: NDArray[np.bool_]
    memory: Any  # keeps the mapping


def open_file() -> int:
    """Return the descriptor of a new unlinked file, which processes with the descriptor can map."""
    file, path = tempfile.mkstemp(prefix="skywright-envs-")
    os.unlink(path)
    return file


def map_arrays(file: int, layout: Layout) -> Shared:
    """Map the arrays; the file is extended to their size."""
    n, actions, signals, values = layout
    shapes: list[tuple[tuple[int, ...], type]] = [
        ((n, actions), np.float32), ((n, signals), np.float32), ((n, signals), np.float32),
        ((n,), np.float64), ((n, values), np.float64), ((n,), np.bool_), ((n,), np.bool_),
    ]  # fmt: skip
    sizes = [-(-int(np.prod(s)) * np.dtype(t).itemsize // 64) * 64 for s, t in shapes]
    os.ftruncate(file, max(sum(sizes), 64))
    memory = mmap.mmap(file, max(sum(sizes), 64))
    at, out = 0, list[Any]()
    for (shape, kind), size in zip(shapes, sizes, strict=True):
        count = int(np.prod(shape))
        out.append(np.frombuffer(memory, kind, count, at).reshape(shape))
        at += size
    return Shared._make([*out, memory])
