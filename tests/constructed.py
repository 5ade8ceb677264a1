"""Recordings that are constructed: what they show is known, and so is every metric of them."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np

from skywright.core.arrays import Samples
from skywright.description.loader import load_description
from skywright.run.flight import Flown, PhaseRecord
from skywright.run.planning import MissionPlan
from skywright.run.setup import Setup

DT = 0.01  # s between samples
LEVEL = (1.0, 0.0, 0.0, 0.0)


def build_samples(
    spans: list[tuple[str, float]], **columns: Any
) -> tuple[Samples, list[PhaseRecord]]:
    """Return samples (n,) over phases of these names and durations (s).

    A column is a value for all samples, a list of one value for each phase, or an array (n, ...).
    """
    counts = [round(duration / DT) for _, duration in spans]
    n, begins = sum(counts), np.concatenate([[0], np.cumsum(counts)])
    phase = np.repeat(np.arange(len(spans)), counts)
    filled = {}
    for name, value in columns.items():
        array = np.asarray(value, float)
        if isinstance(value, list):
            array = array[phase]
        filled[name] = array if array.shape[:1] == (n,) else np.tile(array, (n, *[1] * array.ndim))
    fields = [("t", float), ("phase", int)]
    s = np.zeros(n, fields + [(k, float, v.shape[1:]) for k, v in filled.items()])
    s["t"], s["phase"] = np.arange(n) * DT, phase
    for name, array in filled.items():
        s[name] = array
    return s, [
        PhaseRecord(name, begins[i] * DT, begins[i + 1] * DT, "done")
        for i, (name, _) in enumerate(spans)
    ]


def build_flown(
    mission: str,
    samples: Samples,
    phases: list[PhaseRecord],
    way: dict[str, Any] | None = None,
    sets: list[str] | None = None,
    segments: dict[str, Any] | None = None,
) -> Flown[Any, Any]:
    """Return a flight of a built-in mission with these samples, its plan's `way` as attributes."""
    setup = Setup(load_description(mission, sets=sets or []))
    plan: Any = MissionPlan(
        True, None, 0.0, 1.0, segments=segments or {}, way=SimpleNamespace(**way or {})
    )
    return Flown(setup, plan, samples, phases)


def about(axis: str, degrees: float) -> tuple[float, ...]:
    """Return the quaternion of a turn about an axis."""
    half, k = math.radians(0.5 * degrees), "xyz".index(axis)
    return (math.cos(half), *(math.sin(half) if i == k else 0.0 for i in range(3)))
