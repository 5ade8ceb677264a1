"""The plant's sensors: their noise is not that of the data sheet, which the robot believes."""

import math
from typing import TypeVar

from skywright.core.spec import Spec
from skywright.core.streams import build_stream

MOST = 3.0
"""Standard deviations beyond which no factor is drawn."""

T = TypeVar("T", bound=Spec)


def draw_noise_factors(table: Spec, sensor: str, error: float, seed: int) -> dict[str, float]:
    """Return by how much each noise of a sensor's table is larger in truth: key -> factor.

    Noises are the numbers whose keys contain `noise` or `walk`. The factors are log-normal,
    `error` is one standard deviation of the logarithm. What a noise gets depends on the run's
    seed, the sensor's name and the key, not on which other sensors there are.
    """
    out = {}
    for key in type(table).model_fields:
        if ("noise" in key or "walk" in key) and isinstance(getattr(table, key), float):
            unit = build_stream(seed, "sensor_noise", f"{sensor}.{key}").standard_normal()
            out[key] = math.exp(error * min(max(unit, -MOST), MOST))
    return out


def deviate_noise(table: T, sensor: str, error: float, seed: int) -> T:
    """Return a sensor's table with the noise that it truly has."""
    factors = draw_noise_factors(table, sensor, error, seed)
    return table.model_copy(update={k: f * getattr(table, k) for k, f in factors.items()})
