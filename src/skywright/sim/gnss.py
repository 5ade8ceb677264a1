"""A satellite receiver: fixes of its antenna at a rate, late, with white and correlated errors.

The correlated error is a first-order Gauss-Markov process an axis, e' = -e / T + w, of the stated
standard deviation (Rankin, An error model for sensor simulation: GPS and differential GPS, IEEE
PLANS 1994, has the same form). A fix comes with the heading of two antennas or of a magnetometer,
which has white noise and an error that stays through the flight.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import mat_vec
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World

Array = NDArray[np.float64]
Record = Any

FIXES_UNDER_WAY = 16
GNSS_NOISE = 7  # normal draws a control tick: white (3), drift (3), heading

f8, i8 = np.float64, np.int64

GNSS = np.dtype(
    [
        ("on", i8),
        ("period", f8),
        ("latency", f8),
        ("dropout", f8),
        ("next", f8),  # s, next epoch
        ("p_BG", f8, 3),  # m, antenna
        ("noise", f8, 3),  # m, 1 sigma
        ("drift", f8, 3),
        ("decay", f8),  # of the correlated error in one period
        ("error", f8, 3),  # m, that error now
        ("heading_noise", f8),  # rad
        ("heading_error", f8),
        ("head", i8),
        ("tail", i8),
        ("queue_t", f8, FIXES_UNDER_WAY),
        ("queue_p", f8, (FIXES_UNDER_WAY, 3)),
        ("queue_heading", f8, FIXES_UNDER_WAY),
    ]
)


@njit(cache=True, error_model="numpy")
def sense_gnss(
    gn: Record, t: float, p_WB: Array, R_WB: Array, noise: Array, drop: float, meas: Record
) -> None:
    """Take a fix when its epoch has come, and hand over the one that arrives now.

    `noise` (GNSS_NOISE,) normal, `drop` uniform.
    """
    if t >= gn.next - 1e-9:
        gn.next += gn.period
        spread = math.sqrt(1.0 - gn.decay * gn.decay)
        lever = np.empty(3)
        mat_vec(R_WB, gn.p_BG, lever)
        for i in range(3):
            gn.error[i] = gn.decay * gn.error[i] + spread * gn.drift[i] * noise[3 + i]
        if drop >= gn.dropout:
            k = gn.head
            gn.head = (k + 1) % FIXES_UNDER_WAY
            if gn.head == gn.tail:  # full: the oldest is lost
                gn.tail = (gn.tail + 1) % FIXES_UNDER_WAY
            gn.queue_t[k] = t
            for i in range(3):
                gn.queue_p[k, i] = p_WB[i] + lever[i] + gn.error[i] + gn.noise[i] * noise[i]
            heading = math.atan2(R_WB[1, 0], R_WB[0, 0])
            gn.queue_heading[k] = heading + gn.heading_error + gn.heading_noise * noise[6]
    meas.fix_fresh = 0.0
    while gn.tail != gn.head and t - gn.queue_t[gn.tail] >= gn.latency - 1e-9:
        k = gn.tail
        gn.tail = (k + 1) % FIXES_UNDER_WAY
        meas.fix_fresh, meas.fix_t = 1.0, gn.queue_t[k]
        meas.fix_heading = gn.queue_heading[k]
        for i in range(3):
            meas.fix_p[i] = gn.queue_p[k, i]


def fill_gnss(gn: Any, robot: Robot, world: World, stream: np.random.Generator) -> None:
    """Fill a GNSS record; it stays off where the world is localised in another way."""
    if world.localisation != "gnss":
        return
    g, e, s = world.gnss, world.gnss.errors, robot.sensors
    gn["on"], gn["period"], gn["latency"] = 1, 1.0 / g.rate_hz, g.latency_s
    gn["dropout"] = g.dropout_fraction
    gn["p_BG"] = [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
    gn["noise"] = [e.noise_level_m, e.noise_level_m, e.noise_up_m]
    gn["drift"] = [e.drift_level_m, e.drift_level_m, e.drift_up_m]
    gn["decay"] = math.exp(-1.0 / (g.rate_hz * e.drift_time_s))
    gn["error"] = gn["drift"] * stream.standard_normal(3)
    gn["heading_noise"] = math.radians(e.heading_noise_deg)
    gn["heading_error"] = math.radians(e.heading_error_deg) * stream.standard_normal()
