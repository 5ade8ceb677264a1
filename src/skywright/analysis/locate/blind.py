"""Artificial outages: error of the filter over intervals in which the station is hidden.

The calibration estimates the camera's random walk from sample to sample, over tenths of a second,
where the station can separate it from noise. Over an outage of seconds the drift may be larger: a
drifting heading, a scale that depends on the scene, persistent errors. Therefore available
measurements of the station are hidden from the filter and compared with its stated deviations.
"""

import math

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.models.localisation.drift_filter import CAMERA, STATION, DriftModel, run_drift_filter

WINDOWS = 6
"""Number of intervals to hide, if the recording is long enough for intervals as long as its
outages."""
LEAST_WINDOW = 1.0
"""Minimum length of an interval (s)."""
PRIOR = 6.0
"""Weight of the calibration's walk, in squared errors (three per window)."""
ROUNDS = 4
"""Iterations: only a part of the deviation is drift, so its factor is found in steps."""
ENOUGH = 1.02


def scale_drift(
    t: Array, kind: Ints, z: Array, outages: list[tuple[float, float]], model: DriftModel
) -> DriftModel:
    """Return the model with the camera's drift scaled up to explain the errors of hidden intervals.

    t, kind, z: see `run_drift_filter`; `outages` (s) are those of the recording. Without outages
    the model stays unchanged, because drift has little effect while the station measures.
    """
    passes = choose_windows(float(t[0]), float(t[-1]), outages)
    if not passes:
        return model
    for _ in range(ROUNDS):
        squares = np.concatenate([measure_windows(t, kind, z, w, model) for w in passes])
        factor = math.sqrt((PRIOR + float(np.sum(squares))) / (PRIOR + squares.size))
        if factor < ENOUGH:
            break
        model = model._replace(
            walk_per_sqrt_s=factor * model.walk_per_sqrt_s,
            walk_per_sqrt_m=factor * model.walk_per_sqrt_m,
            yaw=factor * model.yaw, tilt=factor * model.tilt, scale=factor * model.scale,
        )  # fmt: skip
    return model


def choose_windows(
    start: float, stop: float, outages: list[tuple[float, float]]
) -> list[list[tuple[float, float]]]:
    """Return intervals (s) to hide between the outages, each after an equally long one with
    station.

    They are as long as the longest outage, or shorter to obtain WINDOWS of them. The intervals of
    the second list lie between those of the first.
    """
    edges = [start, *(x for span in outages for x in span), stop]
    covered = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]
    if not outages or not covered:
        return []
    there = sum(b - a for a, b in covered)
    long = min(max(b - a for a, b in outages), there / (WINDOWS + 1))
    if long < LEAST_WINDOW:
        return []
    return [
        [
            (a + k * long, a + (k + 1) * long)
            for a, b in covered
            for k in range(first, int((b - a) / long + 1e-9), 2)
        ]
        for first in (1, 2)
    ]


def measure_windows(
    t: Array, kind: Ints, z: Array, windows: list[tuple[float, float]], model: DriftModel
) -> Array:
    """Return the squared errors over the stated variances at the end of each window, per axis.

    The error is the median over the last third of a window, which is robust against outliers of the
    station.
    """
    inside = np.zeros(len(t), dtype=bool)
    for a, b in windows:
        inside |= (t > a) & (t < b)
    keep = ~(inside & (kind == STATION))
    fused = run_drift_filter(t[keep], kind[keep], z[keep], model)
    found: list[Array] = []
    for a, b in windows:
        hidden = (t > b - (b - a) / 3.0) & (t < b) & (kind == STATION)
        n = int(np.count_nonzero(hidden))
        if n < 3 or not np.any((fused.t > a) & (fused.t < b) & (fused.kind == CAMERA)):
            continue
        at = [np.interp(t[hidden], fused.t, fused.p[:, i]) for i in range(3)]
        std = [np.interp(t[hidden], fused.t, fused.p_std[:, i]) for i in range(3)]
        error = np.median(z[hidden] - np.stack(at, axis=1), axis=0)
        variance = np.mean(np.square(np.stack(std, axis=1)), axis=0)
        found.append(error**2 / (variance + 0.5 * math.pi * model.station**2 / n))
    return np.array(found).reshape(-1)
