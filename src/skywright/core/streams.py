"""Random streams: every sensor and disturbance draws from its own, spawned from the run's seed."""

from __future__ import annotations

import numpy as np

STREAMS = (
    "plant", "gyro", "mocap", "dropout", "probe", "texture", "planner",
    "wind", "wind_start", "friction", "accelerometer", "vibration", "outlier", "link",
    "deflection", "scenario",
    "station", "camera", "range_finder", "force",
    "gnss", "pipe", "map", "operator", "survey", "faults", "springs",
)  # fmt: skip
"""Append only: a stream's place in this list is part of what a seed means."""


def build_stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of the stream `name` for a run's seed."""
    key = (STREAMS.index(name),)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
