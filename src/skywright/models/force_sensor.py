"""The force sensor of the probe's slider: from force to count and back, and what it can resolve.

Calibration of Sanchez-Cuevas et al. 2020, Table 3: two straight pieces over the converter's count,
force falling with the count. The pieces meet at 7.80 and 7.81 N, less than a count apart.
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.record import Record
from skywright.description.robot.force_sensor import ForceSensor


class Converter(Record):
    """Parameters of the sensor, readable from compiled code."""

    hard_slope: float  # N a count, below `limit`
    hard_offset: float  # N
    soft_slope: float  # N a count, from `limit` on
    soft_offset: float  # N
    limit: float  # count
    top: float  # largest count
    noise: float  # counts, 1 sigma


def build_force_sensor(spec: ForceSensor) -> NDArray[Any]:
    """Return the sensor's parameters as a (1,) array of Converter."""
    out = np.zeros(1, Converter.dtype)
    s = out[0]
    s["hard_slope"], s["hard_offset"] = spec.hard_slope_n_per_count, spec.hard_offset_n
    s["soft_slope"], s["soft_offset"] = spec.soft_slope_n_per_count, spec.soft_offset_n
    s["limit"], s["top"], s["noise"] = spec.limit_count, 2**spec.adc_bits - 1, spec.noise_count
    return out


@njit(cache=True, error_model="numpy")
def compute_force(s: Any, count: float) -> float:
    """Return the force (N) that a count stands for; a released spring reads 0, never less."""
    if count < s.limit:
        return s.hard_offset + s.hard_slope * count
    return max(s.soft_offset + s.soft_slope * count, 0.0)


@njit(cache=True, error_model="numpy")
def compute_count(s: Any, force: float) -> float:
    """Return the count (not rounded) at a force (N): the inverse of `compute_force`."""
    if force > s.soft_offset + s.soft_slope * s.limit:
        return (max(force, 0.0) - s.hard_offset) / s.hard_slope
    return (max(force, 0.0) - s.soft_offset) / s.soft_slope


@njit(cache=True, error_model="numpy")
def convert_force(s: Any, force: float, noise: float) -> float:
    """Return the converter's whole count for a force (N) on the slider.

    `noise` is a standard normal number. Beyond its range the converter stays at its end. A force
    that is not a number gives the count of a released spring, so that NaN goes no further.
    """
    if math.isnan(force):
        force = 0.0
    count = math.floor(compute_count(s, force) + s.noise * noise + 0.5)
    return min(max(count, 0.0), s.top)


@njit(cache=True, error_model="numpy")
def measure_force(s: Any, force: float, noise: float) -> float:
    """Return the force (N) that the robot reads where `force` acts: through the converter."""
    return compute_force(s, convert_force(s, force, noise))
