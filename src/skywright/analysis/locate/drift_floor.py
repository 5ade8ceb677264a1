"""Lower bound of the error of any filter after an outage of the station.

During an outage only the camera measures the motion, and its drift is indistinguishable from
motion. If everything is known at the start of the outage, the variance at its end is that of the
drift:

- a walk of position: 3 (sigma_s^2 T + sigma_m^2 L), over the time T and the path of length L;
- a walk of the heading psi: the error is the integral of (psi(u) z x) dr = integral of z x
  (r(T) - r(u)) dpsi(u), so sigma_psi^2 times the integral of |r(T) - r(u)|^2 (horizontal) du;
- a walk of the scale: the same in three dimensions.
"""

import math

import numpy as np

from skywright.core.arrays import Array


def compute_drift_floor(
    t: Array,
    p: Array,
    *,
    walk_per_sqrt_s: float = 0.0,
    walk_per_sqrt_m: float = 0.0,
    yaw_walk: float = 0.0,
    scale_walk: float = 0.0,
    jump_rate: float = 0.0,
    jump_std: float = 0.0,
) -> float:
    """Return the minimum rms error (m, three-dimensional) at the end of a path without the station.

    t (n,) s and p (n, 3) m from the start to the end of the outage. Walks are standard deviations
    per axis, per square root of a second or metre; `yaw_walk` in rad per sqrt(s), `scale_walk` per
    sqrt(s). `jump_rate` (1/s) and `jump_std` (m, per axis) count only for undetectable jumps.
    """
    length = float(np.sum(np.linalg.norm(np.diff(p, axis=0), axis=1)))
    time = float(t[-1] - t[0])
    variance = 3.0 * (walk_per_sqrt_s**2 * time + walk_per_sqrt_m**2 * length)
    variance += 3.0 * jump_std**2 * jump_rate * time
    reach = p[-1] - p
    variance += yaw_walk**2 * float(np.trapezoid(np.sum(reach[:, :2] ** 2, axis=1), t))
    variance += scale_walk**2 * float(np.trapezoid(np.sum(reach**2, axis=1), t))
    return math.sqrt(variance)
