"""A small random generator for compiled code: splitmix64 with a state of one word.

The state is an array, so that a search can continue the same sequence in another call. (Steele, Lea
and Flood, Fast splittable pseudorandom number generators, OOPSLA 2014.)
"""

import math

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper

State = NDArray[np.uint64]

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_A, _B = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


def build_state(rng: np.random.Generator) -> State:
    """Seed a state from a stream."""
    return rng.integers(0, 2**63, size=1, dtype=np.int64).astype(np.uint64)


@helper
def uniform(state: State) -> float:
    """Return the next number in [0, 1)."""
    state[0] += _GAMMA
    z = state[0]
    z = (z ^ (z >> _S30)) * _A
    z = (z ^ (z >> _S27)) * _B
    z = z ^ (z >> _S31)
    return float(z >> _S11) * (1.0 / 9007199254740992.0)


@helper
def normal(state: State) -> float:
    """Return a standard normal number (Box and Muller; one of the pair)."""
    return math.sqrt(-2.0 * math.log(1.0 - uniform(state))) * math.cos(
        2.0 * math.pi * uniform(state)
    )


@helper
def pick(state: State, n: int) -> int:
    """Return an index below n."""
    return int(uniform(state) * n)
