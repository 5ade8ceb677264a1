"""Random streams: every sensor and disturbance has its own, spawned from the run's seed."""

from __future__ import annotations

import zlib

import numpy as np

STREAMS = (
    "plant", "gyro", "mocap", "dropout", "probe", "texture", "planner",
    "wind", "wind_start", "friction", "accelerometer", "vibration", "outlier", "link",
    "deflection", "scenario",
    "station", "camera", "range_finder", "force",
    "gnss", "pipe", "map", "operator", "survey", "faults", "springs",
    "sensor_noise", "radio", "block",
)  # fmt: skip
"""Append only: the index in this list determines the stream of a seed."""


def build_stream(seed: int, name: str, part: str = "") -> np.random.Generator:
    """Return the generator of the stream `name` for a run's seed; each `part` has its own."""
    key = (STREAMS.index(name), *([zlib.crc32(part.encode())] if part else []))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
