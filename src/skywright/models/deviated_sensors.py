"""True noise of the plant's sensors, which deviates from the data sheet that the robot uses."""

import math
from typing import TypeVar

from skywright.core.spec import Spec
from skywright.core.streams import build_stream

MOST = 3.0
"""Factors are drawn within this many standard deviations."""

T = TypeVar("T", bound=Spec)


def draw_noise_factors(table: Spec, sensor: str, error: float, seed: int) -> dict[str, float]:
    """Return the ratio of true to stated noise of a sensor's table: key -> factor.

    Noises are the numbers whose keys contain `noise` or `walk`. The factors are log-normal, `error`
    is one standard deviation of the logarithm. The factor of a noise depends on the run's seed, the
    sensor's name and the key, and not on other sensors.
    """
    out = {}
    for key in type(table).model_fields:
        if ("noise" in key or "walk" in key) and isinstance(getattr(table, key), float):
            unit = build_stream(seed, "sensor_noise", f"{sensor}.{key}").standard_normal()
            out[key] = math.exp(error * min(max(unit, -MOST), MOST))
    return out


def deviate_noise(table: T, sensor: str, error: float, seed: int) -> T:
    """Return a sensor's table with its true noise."""
    factors = draw_noise_factors(table, sensor, error, seed)
    return table.model_copy(update={k: f * getattr(table, k) for k, f in factors.items()})
