"""Force sensor of the probe's slider: travel to converter count, count to force.

Calibration of Sanchez-Cuevas et al. 2020, Table 3: two linear pieces over the converter's count;
the force falls with the count. The pieces meet at 7.80 and 7.81 N, less than a count apart. A
linear potentiometer produces the count, so the two slopes are those of the spring: harder to 7.8 N
(1205 N/m at a stroke of 30 mm), softer beyond (432 N/m).
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.record import Record
from skywright.core.user_code import njit
from skywright.description.robot.force_sensor import ForceSensor
from skywright.description.robot.spec import Probe


class Converter(Record):
    """Parameters of the sensor, readable from compiled code."""

    hard_slope: float  # N per count, below `limit`
    hard_offset: float  # N
    soft_slope: float  # N per count, from `limit` on
    soft_offset: float  # N
    limit: float  # count
    zero: float  # count of the slider at its stop
    per_m: float  # counts per metre of travel
    top: float  # largest count
    noise: float  # counts, 1 sigma


def build_force_sensor(
    spec: ForceSensor, preload: float = 0.0, factor: float = 1.0
) -> NDArray[Any]:
    """Return the sensor's parameters as a (1,) array of Converter; `preload` (N) of the spring.

    `factor` is the true force over the data sheet's force at the same count.
    """
    out = np.zeros(1, Converter.dtype)
    s = out[0]
    s["hard_slope"], s["hard_offset"] = spec.hard_slope_n_per_count, spec.hard_offset_n
    s["soft_slope"], s["soft_offset"] = spec.soft_slope_n_per_count, spec.soft_offset_n
    s["limit"], s["top"], s["noise"] = spec.limit_count, 2**spec.adc_bits - 1, spec.noise_count
    s["zero"], s["per_m"] = compute_count(s, preload), 2**spec.adc_bits / spec.stroke_m
    for name in ("hard_slope", "hard_offset", "soft_slope", "soft_offset"):
        s[name] *= factor
    return out


@njit(cache=True, error_model="numpy")
def compute_force(s: Any, count: float) -> float:
    """Return the force (N) of a count; a released spring reads 0, never less."""
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
def compute_travel(s: Any, force: float) -> float:
    """Return the slider's travel (m) at a force (N), by the calibration."""
    return (s.zero - compute_count(s, force)) / s.per_m


@njit(cache=True, error_model="numpy")
def convert_travel(s: Any, travel: float, noise: float) -> float:
    """Return the converter's integer count for a travel (m) of the slider.

    `noise` is a standard normal number. Outside its range the converter saturates. A NaN travel
    returns the count of a released spring, so that NaN does not propagate.
    """
    if math.isnan(travel):
        travel = 0.0
    count = math.floor(s.zero - s.per_m * travel + s.noise * noise + 0.5)
    return min(max(count, 0.0), s.top)


@njit(cache=True, error_model="numpy")
def measure_travel(s: Any, travel: float, noise: float) -> float:
    """Return the measured force (N) at a travel (m), through the converter."""
    return compute_force(s, convert_travel(s, travel, noise))


def compute_spring_force(probe: Probe, sensor: ForceSensor | None, travel: float) -> float:
    """Return the force (N) of the slider's spring at a travel (m); with a sensor, of its two
    slopes."""
    force = probe.spring_preload_n + probe.spring_n_per_m * travel
    if sensor is None or force <= sensor.knee_n:
        return force
    return sensor.knee_n + sensor.hard_share * (force - sensor.knee_n)
