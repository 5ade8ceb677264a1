"""The laser range finder: one distance along its beam, in steps of its resolution.

The class of a LightWare SF11/C (Sanchez-Cuevas 2020, section 2).
"""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Array, Record
from skywright.core.user_code import njit

RANGE_BLOCK = 512
"""Samples whose noise is drawn at a time."""


class Finder(Record):
    """Parameters and state of a range finder."""

    period: float  # s
    range_min: float  # m
    range_max: float  # m
    resolution: float  # m
    bias: float  # m, fixed in a run
    noise_std: float  # m
    next_t: float  # s
    index: int
    unit: Annotated[Array, RANGE_BLOCK]
    # the sample of this step
    fresh: float
    valid: float  # 0: nothing within range
    stamp: float  # s
    distance: float  # m


class RangePrecision(NamedTuple):
    """Precision of a range finder; the defaults are from the SF11/C's data sheet."""

    rate_hz: float = 20.0
    range_min_m: float = 0.2
    range_max_m: float = 120.0
    resolution_m: float = 0.01
    bias_std_m: float = 0.05  # data sheet: accuracy of 0.1 m, taken as two sigma
    noise_std_m: float = 0.02  # assumed


def build_range_finder(
    stream: np.random.Generator, precision: RangePrecision | None = None
) -> NDArray[Any]:
    """Return a (1,) array of Finder, its bias and first block of noise drawn."""
    s = precision or RangePrecision()
    out = np.zeros(1, Finder.dtype)
    rf = out[0]
    rf["period"], rf["range_min"], rf["range_max"] = 1.0 / s.rate_hz, s.range_min_m, s.range_max_m
    rf["resolution"], rf["noise_std"] = s.resolution_m, s.noise_std_m
    rf["bias"] = s.bias_std_m * stream.standard_normal()
    draw_range_finder(rf, stream)
    return out


def draw_range_finder(rf: Any, stream: np.random.Generator) -> None:
    """Fill the block of noise; call it before `index` reaches RANGE_BLOCK."""
    rf["unit"] = stream.standard_normal(RANGE_BLOCK)
    rf["index"] = 0


@njit(cache=True, error_model="numpy")
def step_range_finder(rf: Any, t: float, distance: float) -> None:
    """Take a sample if one is due; `distance` (m) is the true one along the beam, inf: none."""
    rf.fresh = 0.0
    if t < rf.next_t - 1e-9:
        return
    rf.next_t += rf.period
    rf.fresh, rf.stamp = 1.0, t
    rf.valid = 1.0 if rf.range_min <= distance <= rf.range_max else 0.0
    if rf.valid == 0.0:
        rf.distance = 0.0
        return
    seen = distance + rf.bias + rf.noise_std * rf.unit[rf.index % RANGE_BLOCK]
    rf.index += 1
    rf.distance = rf.resolution * np.floor(seen / rf.resolution + 0.5)
