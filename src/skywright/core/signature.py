"""The one compiled signature of control laws and estimators: void(BELIEF*).

Passing a jitted function as an argument would recompile the loop and never hit numba's disk cache
in a second process; a `cfunc` of fixed signature does (ADR 0002).
"""

from __future__ import annotations

from numba import from_dtype, types

from skywright.core.types import BELIEF

BELIEF_TYPE = from_dtype(BELIEF)
ON_BELIEF = types.void(types.CPointer(BELIEF_TYPE))
