"""The robotic total station: tracks a prism on the robot by laser and sends the prism's position.

It measures range and two angles at irregular intervals (0 to 20 Hz), and the radio link delivers
the result late. Without a line of sight it loses the prism and needs some time to lock on again.
Precision is that of the class of a Leica MS50 with a GRZ101 prism (Sanchez-Cuevas 2020, section 2).
"""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper
from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import cross, mat_vec
from skywright.core.scratch import local

STATION_BLOCK = 512
"""Measurements whose noise is drawn at a time."""
QUEUE = 16
"""Largest number of measurements in transit on the link."""


class Station(Record):
    """Parameters and state of a total station."""

    # parameters
    p_WS: Vec3  # m, position of the station
    p_BP: Vec3  # m, prism on the robot
    interval_min: float  # s, between measurements
    interval_mean: float  # s
    latency_min: float  # s, from the measurement to its arrival
    latency_mean: float  # s
    range_std: float  # m, along the line of sight
    angle_std: float  # rad
    pointing_std: float  # m, lateral: pointing error on a prism of finite size
    relock_time: float  # s in sight before it measures again
    # state
    next_t: float  # s, of the next measurement
    seen_since: float  # s, negative infinity: never lost
    sent: float  # s, arrival of the last one sent: measurements do not overtake each other
    index: int  # into the block
    unit: Annotated[Array, STATION_BLOCK, 5]  # two exponential draws, three normal ones
    n: int  # number in transit
    queue_stamp: Annotated[Array, QUEUE]
    queue_arrival: Annotated[Array, QUEUE]
    queue_p: Annotated[Array, QUEUE, 3]
    # outputs of this step
    fresh: float  # 1: a measurement arrived
    stamp: float  # s, when it was measured
    p_WP: Vec3  # m, the prism


class StationPrecision(NamedTuple):
    """Precision of a total station; the defaults are from data sheets of the MS50's class."""

    rate_max_hz: float = 20.0  # paper: 0 to 20 Hz
    rate_mean_hz: float = 10.0  # assumed, 5 to 15
    latency_min_s: float = 0.05  # assumed: instrument and Wi-Fi, 50 to 150 ms
    latency_mean_s: float = 0.1
    range_std_m: float = 2e-3  # data sheet: 1 mm + 1.5 ppm single, 2 to 3 mm tracking
    angle_std_rad: float = 4.85e-6  # data sheet: 1"
    pointing_std_m: float = 1.5e-3  # assumed, 1 to 3 mm: a 360 degree prism in motion
    relock_s: float = 1.0  # assumed, 0.5 to 5


def build_total_station(
    p_WS: Array, p_BP: Array, precision: StationPrecision | None = None
) -> NDArray[Any]:
    """Return a (1,) array of Station; `draw_total_station` must fill its noise first."""
    s = precision or StationPrecision()
    out = np.zeros(1, Station.dtype)
    ts = out[0]
    ts["p_WS"], ts["p_BP"] = p_WS, p_BP
    ts["interval_min"], ts["interval_mean"] = 1.0 / s.rate_max_hz, 1.0 / s.rate_mean_hz
    ts["latency_min"], ts["latency_mean"] = s.latency_min_s, s.latency_mean_s
    ts["range_std"], ts["angle_std"] = s.range_std_m, s.angle_std_rad
    ts["pointing_std"], ts["relock_time"] = s.pointing_std_m, s.relock_s
    ts["seen_since"] = -math.inf
    ts["index"] = STATION_BLOCK
    return out


def draw_total_station(ts: Any, stream: np.random.Generator) -> None:
    """Fill the block of noise; call it before `index` reaches STATION_BLOCK."""
    ts["unit"][:, :2] = stream.standard_exponential((STATION_BLOCK, 2))
    ts["unit"][:, 2:] = stream.standard_normal((STATION_BLOCK, 3))
    ts["index"] = 0


@helper
def step_total_station(ts: Any, t: float, p_WB: Array, R_WB: Array, visible: bool) -> None:
    """Take a measurement if one is due, and deliver one that has arrived by `t`.

    `visible`: the line of sight from `p_WS` to the prism is free. A step delivers at most one
    measurement, the oldest.
    """
    if not visible:
        ts.seen_since = math.inf
    elif ts.seen_since == math.inf:
        ts.seen_since = t
    if t >= ts.next_t:
        k = ts.index % STATION_BLOCK
        more = ts.interval_mean - ts.interval_min
        ts.next_t = t + ts.interval_min + more * ts.unit[k, 0]
        if t - ts.seen_since >= ts.relock_time and ts.n < QUEUE:
            _measure(ts, t, p_WB, R_WB, k)
        ts.index += 1
    ts.fresh = 0.0
    if ts.n > 0 and ts.queue_arrival[0] <= t:
        ts.fresh = 1.0
        ts.stamp = ts.queue_stamp[0]
        for i in range(3):
            ts.p_WP[i] = ts.queue_p[0, i]
        ts.n -= 1
        for j in range(ts.n):
            ts.queue_stamp[j] = ts.queue_stamp[j + 1]
            ts.queue_arrival[j] = ts.queue_arrival[j + 1]
            for i in range(3):
                ts.queue_p[j, i] = ts.queue_p[j + 1, i]


@helper
def _measure(ts: Any, t: float, p_WB: Array, R_WB: Array, k: int) -> None:
    """Send a measurement of the prism, with noise along and across the line of sight."""
    p, sight, side, up = local(3), local(3), local(3), local(3)
    mat_vec(R_WB, ts.p_BP, p)
    for i in range(3):
        p[i] += p_WB[i]
        sight[i] = p[i] - ts.p_WS[i]
    distance = math.sqrt(sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2)
    level = math.sqrt(sight[0] ** 2 + sight[1] ** 2)
    if level > 0.0:
        side[0], side[1], side[2] = -sight[1] / level, sight[0] / level, 0.0
    else:  # straight above: any direction is across
        side[0], side[1], side[2] = 1.0, 0.0, 0.0
    for i in range(3):
        sight[i] /= max(distance, 1e-9)
    cross(sight, side, up)
    across = math.sqrt((ts.angle_std * distance) ** 2 + ts.pointing_std**2)
    j = ts.n
    for i in range(3):
        ts.queue_p[j, i] = p[i] + (
            ts.range_std * ts.unit[k, 2] * sight[i]
            + across * (ts.unit[k, 3] * side[i] + ts.unit[k, 4] * up[i])
        )
    more = ts.latency_mean - ts.latency_min
    ts.sent = max(ts.sent, t + ts.latency_min + more * ts.unit[k, 1])
    ts.queue_stamp[j], ts.queue_arrival[j] = t, ts.sent
    ts.n += 1
