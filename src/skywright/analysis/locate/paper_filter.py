"""The Kalman filter of Sanchez-Cuevas 2020, eq. (6) to (16), with the printed Q and R.

State: position and velocity. The process noise is added once per step, independent of its length,
so the tuning is valid for one rate only. The paper uses H = I_6 for both sensors, but a total
station measures positions only. Here H = [I 0] for the station; `station_velocity` differentiates
its positions as printed. The camera's drift is not in the state, so the estimate follows the sensor
with the higher rate.
"""

from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.user_code import njit

CAMERA, STATION = 0, 1


class PaperNoise(NamedTuple):
    """The printed covariances, as factors of the identity (section 3.1)."""

    q: float = 2e-6
    r_station: float = 5e-3
    r_camera: float = 1e-2


@njit(cache=True, error_model="numpy")
def _run(t: Array, kind: Array, z: Array, known: Array, noise: Array, out: Array) -> None:
    """Run three decoupled filters of two states, one per axis, with one covariance (2, 2)."""
    n = len(t)
    p, v = z[0, :3].copy(), np.zeros(3)
    a, b, d = noise[2], 0.0, noise[2]  # covariance [[a, b], [b, d]]
    now = t[0]
    for k in range(n):
        dt = t[k] - now
        now = t[k]
        # (12), (13): A P A' + Q
        for i in range(3):
            p[i] += dt * v[i]
        a, b, d = a + 2.0 * dt * b + dt * dt * d + noise[0], b + dt * d, d + noise[0]
        r = noise[2] if kind[k] == CAMERA else noise[1]
        # (14) to (16), one component after the other: R is diagonal
        s = a + r
        ka, kb = a / s, b / s
        for i in range(3):
            e = z[k, i] - p[i]
            p[i] += ka * e
            v[i] += kb * e
        a, b, d = a - ka * a, b - ka * b, d - kb * b
        if known[k] > 0.0:  # the sensor also measured velocity
            s = d + r
            ka, kb = b / s, d / s
            for i in range(3):
                e = z[k, 3 + i] - v[i]
                p[i] += ka * e
                v[i] += kb * e
            a, b, d = a - ka * b, b - kb * b, d - kb * d
        for i in range(3):
            out[k, i], out[k, 3 + i] = p[i], v[i]
        out[k, 6], out[k, 7], out[k, 8] = a, b, d


def run_paper_filter(
    t: Array,
    kind: Ints,
    z: Array,
    velocity: Array,
    noise: PaperNoise | None = None,
) -> tuple[Array, Array, Array]:
    """Filter measurements in order of time: positions (n, 3), velocities (n, 3), covariance (n, 3).

    t (n,) s; kind (n,) CAMERA or STATION; z (n, 3) m in W; velocity (n, 3) m/s, NaN if the sensor
    did not measure it. The covariance holds the entries position, cross, velocity of each axis.
    """
    q = noise or PaperNoise()
    known = np.isfinite(velocity[:, 0]).astype(np.float64)
    out = np.empty((len(t), 9))
    both = np.column_stack([z, np.nan_to_num(velocity)])
    _run(t, kind, both, known, np.array([q.q, q.r_station, q.r_camera]), out)
    return out[:, :3], out[:, 3:6], out[:, 6:]
