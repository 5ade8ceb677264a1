"""Errors of the estimates at the end of each interval without the station."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from skywright.analysis.locate.fusion import Events
from skywright.core.arrays import Array
from skywright.models.localisation.drift_filter import CAMERA, STATION, Fused


class Outage(NamedTuple):
    """An interval without the station, and the error of each estimate at its end.

    Distances (m) from the first accepted measurement after it to the last estimate before; None if
    the station did not return, or if no measurement was accepted before the next outage.
    """

    start: float  # s, station's clock
    end: float
    fused: float | None
    paper: float | None
    camera: float | None


def measure_outages(
    spans: list[tuple[float, float]], events: Events, fused: Fused, paper: Array, notes: list[str]
) -> list[Outage]:
    """Return the outages in `spans` (s, in order of time) with the errors at their ends.

    `paper` (n, 3) m: positions of the paper's filter. Appends a note on each outage after which the
    filter rejected all measurements.
    """
    return [
        _measure_outage(span, following[0], events, fused, paper, notes)
        for span, following in pairwise([*spans, (math.inf, math.inf)])
    ]


def _measure_outage(
    span: tuple[float, float], until: float, events: Events, fused: Fused, paper: Array,
    notes: list[str],
) -> Outage:  # fmt: skip
    """Return one outage; the next one begins at `until` (s)."""
    unknown = Outage(span[0], span[1], None, None, None)
    station = events.kind == STATION
    back = np.flatnonzero(station & (events.t >= span[1] - 1e-9))
    if not len(back) or back[0] == 0 or not np.any(events.t[station] < span[1]):
        return unknown
    # the first measurement may be a reflection
    good = back[fused.accepted[back] & (events.t[back] <= until + 1e-9)]
    if not len(good):
        notes.append(
            f"no measurement of the station was accepted after the outage from {span[0]:.1f} to "
            f"{span[1]:.1f} s: the errors at its end are unknown"
        )
        return unknown
    k, before = int(good[0]), int(back[0]) - 1
    # rejected measurements moved the paper's filter: all estimates are those before the first one,
    # and the accepted one is moved back by the motion since then
    z = events.z[k] - (fused.p[k - 1] - fused.p[before])
    camera = np.flatnonzero(events.kind[: before + 1] == CAMERA)

    def off(p: Array) -> float:
        return float(np.linalg.norm(z - p))

    return Outage(
        span[0], span[1], off(fused.p[before]), off(paper[before]),
        off(events.z_paper[camera[-1]]) if len(camera) else None,
    )  # fmt: skip
