"""MuJoCo's step, callable from compiled code.

libmujoco is loaded into LLVM in this module, because cached machine code that runs without the
library loaded would crash the process. Pass `model._address` and `data._address`.
"""

from __future__ import annotations

import ctypes
import glob
import os
from typing import Any

import llvmlite.binding as llvm
import mujoco
from numba import types

from skywright.core.user_code import njit


def load_library() -> str:
    """Load libmujoco permanently into LLVM's symbol table; return its path."""
    folder = os.path.dirname(mujoco.__file__)
    found = sorted(glob.glob(os.path.join(folder, "**", "*mujoco.so*"), recursive=True))
    found += sorted(glob.glob(os.path.join(folder, "**", "*mujoco*.dylib"), recursive=True))
    found += sorted(glob.glob(os.path.join(folder, "**", "mujoco.dll"), recursive=True))
    for path in found:
        try:
            ctypes.CDLL(path).mj_step  # noqa: B018 - the right library has the symbol
        except (OSError, AttributeError):
            continue
        llvm.load_library_permanently(path)
        return path
    raise ImportError(f"libmujoco was not found in {folder}")


LIBRARY = load_library()

_mj_step: Any = types.ExternalFunction("mj_step", types.void(types.intp, types.intp))


@njit(cache=True, error_model="numpy")
def step_physics(model: int, data: int, n: int) -> None:
    """Advance the plant by `n` time steps; `model` and `data` are addresses."""
    for _ in range(n):
        _mj_step(model, data)
