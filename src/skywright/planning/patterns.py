"""Scan patterns on the pipe's unrolled surface, and the smooth time law along a straight piece.

A pattern is a list of via-points (s, phi): s along the axis, phi around it. The tip moves on a
straight line between two via-points of the unrolled surface and rests at each of them.
"""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper

SIDES = {"side": 0.0, "top": 90.0, "underside": -90.0}
"""Circumferential angle (deg) of the middle of each named sector."""


class Pattern(NamedTuple):
    """Via-points of a scan, or the reason why there are none."""

    corners: Array  # (n, 2) s m, phi rad
    blocked_by: str | None


def build_pattern(
    kind: str,
    radius: float,
    half_length: float,
    centre_phi: float = 0.0,
    arc: float = math.radians(40.0),
    passes: int = 4,
    pass_length: float = 0.2,
    centre_s: float = 0.0,
    footprint: float = 0.008,
) -> Pattern:
    """Return the via-points of a `raster`, `line` or `spiral`.

    raster: axial passes joined by steps along the arc (2 corners per pass). line: one axial pass in
    the middle of the sector. spiral: alternating arcs that advance along the axis like a thread
    (passes + 1 corners). `footprint` (m) is the probe's width: closer passes, or a pattern that
    leaves the pipe, are refused.
    """
    lo, hi = centre_s - pass_length / 2, centre_s + pass_length / 2
    if lo < -half_length or hi > half_length:
        return Pattern(
            np.zeros((0, 2)),
            f"reach: the pattern spans s = {lo:.3f} to {hi:.3f} m, but the pipe spans only "
            f"{-half_length:.3f} to {half_length:.3f} m",
        )
    apart = radius * arc / max(passes - 1, 1) if kind == "raster" else pass_length / passes
    if kind != "line" and passes > 1 and apart < footprint:
        return Pattern(
            np.zeros((0, 2)),
            f"sector: {passes} passes over {math.degrees(arc):.0f} deg and {pass_length:.2f} m of "
            f"a {2 * radius:.3g} m pipe are {1e3 * apart:.1f} mm apart, less than the probe's "
            f"footprint of {1e3 * footprint:.1f} mm",
        )
    if kind == "line":
        return Pattern(np.array([[lo, centre_phi], [hi, centre_phi]]), None)
    rows = []
    if kind == "spiral":
        for i, s in enumerate(np.linspace(lo, hi, passes + 1)):
            rows.append([s, centre_phi + (arc / 2 if i % 2 == 0 else -arc / 2)])
        return Pattern(np.array(rows), None)
    if kind != "raster":
        raise ValueError(f"pattern {kind!r}; valid: raster, line, spiral")
    # from the top edge down: on most pipes the arm starts in its least loaded posture
    angles = np.linspace(arc / 2, -arc / 2, passes) if passes > 1 else np.zeros(1)
    for i, angle in enumerate(angles):
        ends = (lo, hi) if i % 2 == 0 else (hi, lo)
        rows += [[ends[0], centre_phi + angle], [ends[1], centre_phi + angle]]
    return Pattern(np.array(rows), None)


class TimeLaw(NamedTuple):
    """Time law from rest to rest over a length: quintic ramps around a constant speed."""

    length: float  # in any unit
    speed: float  # cruise, unit/s
    ramp: float  # s, each of the two ramps
    duration: float  # s


def build_time_law(
    length: float, speed: float, acceleration: float, ramp: float = 0.0, grid: float = 0.02
) -> TimeLaw:
    """Return the fastest law within `speed` and `acceleration`, its duration on the time grid.

    The ramps are at least `ramp` s long. Speed along a ramp follows the smooth step u^3 (10 - 15 u
    + 6 u^2), whose steepest slope is 1.875; acceleration and jerk vanish at rest.
    """
    if length <= 1e-12:
        return TimeLaw(0.0, 0.0, grid / 2, grid)
    ramp = max(ramp, 1.875 * speed / acceleration, 1e-3)
    if length < speed * ramp:  # too short to cruise
        # at constant peak acceleration the ramp decreases with the square root of the length
        ramp = max(math.sqrt(1.875 * length / acceleration), min(ramp, length / speed))
        speed = length / ramp
    duration = length / speed + ramp
    duration = math.ceil(duration / grid - 1e-9) * grid
    return TimeLaw(length, length / (duration - ramp), ramp, duration)


@helper
def eval_time_law(law: TimeLaw, t: float) -> tuple[float, float, float]:
    """Return (distance, speed, acceleration) at time t (s) along a law."""
    if t <= 0.0:
        return 0.0, 0.0, 0.0
    if t >= law.duration:
        return law.length, 0.0, 0.0
    late = t > law.duration - law.ramp
    u = (law.duration - t if late else t) / law.ramp
    if u >= 1.0:
        return law.speed * (t - 0.5 * law.ramp), law.speed, 0.0
    # integral of the smooth step: u^4 (2.5 - 3 u + u^2)
    d = law.speed * law.ramp * u**4 * (2.5 - 3.0 * u + u * u)
    v = law.speed * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    a = law.speed / law.ramp * 30.0 * u * u * (1.0 - u) ** 2
    if late:
        return law.length - d, v, -a
    return d, v, a
