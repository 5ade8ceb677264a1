"""The slowest localisation that a mission's rules and clearances tolerate."""

from __future__ import annotations

import math
from typing import Any

from skywright.description.robot.localisation import TrackingCamera
from skywright.description.world.localisation import TotalStation
from skywright.run.kind import load_kind
from skywright.run.parts import build_rules
from skywright.run.setup import Setup
from skywright.vehicle.sensor_flight import CALIBRATION_SPEED

TOUCHING = frozenset({"probe", "hands"})
"""Needs of kinds whose robots touch something."""
SIGMAS = 3.0
"""Standard deviations of the position before a fix that a clearance must cover."""


def find_slow_localisation(setup: Setup[Any]) -> str | None:
    """Return a message if position fixes are less frequent than the mission tolerates, or None."""
    d = setup.description
    touches = bool(load_kind(d.mission.kind).needs & TOUCHING)
    camera = d.robot.tracking_camera
    if d.world.localisation == "total-station" and camera is not None:
        return _find_slow_station(setup, camera, touches)
    table = getattr(d.world, d.world.localisation, None)
    if table is None:
        return None
    period = 1.0 / table.rate_hz
    for rule in build_rules(d):
        bears = rule.bear_period(touches)
        if 0.0 < bears <= period:
            return (
                f"localisation is too slow: world.{d.world.localisation}.rate_hz = "
                f"{table.rate_hz:g} gives a position every {period:.2g} s; the period must "
                f"be below {bears:g} s (mission.faults.{rule.name}.limit), a rate above "
                f"{1.0 / bears:g} Hz"
            )
    return None


def _find_slow_station(setup: Setup[Any], camera: TrackingCamera, touches: bool) -> str | None:
    mission, station = setup.description.mission, setup.world.total_station
    key = "surface_clearance_m" if touches else "clearance_m"
    keeps = float(getattr(mission, key))
    period = compute_longest_period(station, camera, keeps / SIGMAS)
    if period * station.rate_mean_hz >= 1.0:
        return None
    least = f"a rate of at least {math.ceil(10.0 / period) / 10.0:g} Hz" if period > 0.0 else ""
    remedy = least or "a shorter latency_mean_s"
    return (
        f"localisation is too slow: world.total_station.rate_mean_hz = {station.rate_mean_hz:g} "
        f"gives a position every {1.0 / station.rate_mean_hz:.2g} s and the tracking camera walks "
        f"in between: {SIGMAS:g} standard deviations of the position exceed {keeps:g} m "
        f"(mission.{key}): set {remedy}"
    )


def compute_longest_period(station: TotalStation, camera: TrackingCamera, sigma: float) -> float:
    """Return the time (s) between fixes after which the position error is `sigma` (m); 0 if none.

    Between fixes the tracking camera measures the position, and its random walk adds q a second: by
    jumps, in time, and along the path. The filter models all three as a walk in time, since a
    calibration at one speed, with few fixes, cannot separate them. The variance P just before a
    fix, for a random walk measured every T with the variance r, is the variance after the previous
    fix plus the walk:

        P = P r / (P + r) + q T,   hence   T = P^2 / (q (P + r)),   with P = sigma^2 - q latency.
    """
    q = CALIBRATION_SPEED * camera.walk_m_per_sqrt_m**2 + camera.walk_m_per_sqrt_s**2
    if camera.jump_interval_s > 0.0:
        q += camera.jump_m**2 / camera.jump_interval_s
    r = max(station.range_noise_m, station.pointing_noise_m) ** 2
    left = max(sigma**2 - q * station.latency_mean_s, 0.0)
    if q == 0.0:
        return math.inf
    return left**2 / (q * (left + r)) if left > 0.0 else 0.0
