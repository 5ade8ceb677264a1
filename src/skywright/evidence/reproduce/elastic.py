"""The reduced model of Tognon 2018, section V: vehicle and probe joined by one spring.

Vehicle m1 (driven by the force u) and probe m2, at x1 and x2, spring k and damper d between:

    m1 x1'' = u - k (x1 - x2) - d (x1' - x2'),    m2 x2'' = k (x1 - x2) + d (x1' - x2')
    displaced   u = -Kp x2 - Kd x1'     tip position, vehicle velocity: law (4)
    tip only    u = -Kp x2 - Kd x2'

With d = 0 the characteristic polynomials are

    displaced   m1 m2 s^4 + m2 Kd s^3 + (m1 + m2) k s^2 + k Kd s + k Kp
    tip only    m1 m2 s^4             + (m1 + m2) k s^2 + k Kd s + k Kp

The second has no s^3 term although Kd > 0, so not all its roots are in the left half plane: it is
unstable for every gain. The first is stable by Routh's criterion for 0 < Kp < k and Kd > 0 (De Luca
and Book, Springer Handbook of Robotics, 2008, ch. 13).
"""

from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array


class Elastic(NamedTuple):
    """Two masses (kg) and a spring (N/m) with a damper (N s/m)."""

    m1: float
    m2: float
    k: float
    d: float = 0.0

    @property
    def frequency(self) -> float:
        """Natural frequency (rad/s) of the relative motion of the masses."""
        return float(np.sqrt(self.k * (self.m1 + self.m2) / (self.m1 * self.m2)))


def build_damped(m1: float, m2: float, k: float, ratio: float) -> Elastic:
    """Build an elastic model with a structural damping ratio."""
    reduced = m1 * m2 / (m1 + m2)
    return Elastic(m1, m2, k, 2.0 * ratio * float(np.sqrt(k * reduced)))


def characteristic(model: Elastic, kp: float, kd: float, displaced: bool) -> Array:
    """Return the coefficients (5,) of the closed loop's characteristic polynomial, s^4 first."""
    m1, m2, k, d = model
    out = np.array([m1 * m2, (m1 + m2) * d, (m1 + m2) * k, 0.0, 0.0])
    if displaced:  # (d s + k) Kp + (m2 s^2 + d s + k) Kd s
        return out + np.array([0.0, m2 * kd, d * kd, k * kd + d * kp, k * kp])
    return out + np.array([0.0, 0.0, d * kd, k * kd + d * kp, k * kp])


def state_matrix(model: Elastic, kp: float, kd: float, displaced: bool) -> Array:
    """Return the closed loop's (4, 4) matrix for the state (x1, x2, x1', x2')."""
    m1, m2, k, d = model
    a = np.zeros((4, 4))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = [-k / m1, (k - kp) / m1, -d / m1, d / m1]
    a[3] = [k / m2, -k / m2, d / m2, -d / m2]
    a[2, 2 if displaced else 3] -= kd / m1
    return a


def compute_growth(model: Elastic, kp: float, kd: float, displaced: bool) -> float:
    """Return the largest real part (1/s) of the closed loop's poles; positive is unstable."""
    return float(np.max(np.linalg.eigvals(state_matrix(model, kp, kd, displaced)).real))


def is_stable_by_routh(polynomial: Array) -> bool:
    """Apply Routh's criterion: all coefficients and the whole first column are positive."""
    coefficients = np.asarray(polynomial, dtype=float)
    if np.any(coefficients <= 0.0):
        return False
    width = len(coefficients) // 2 + 1
    upper = np.zeros(width)
    lower = np.zeros(width)
    upper[: len(coefficients[::2])] = coefficients[::2]
    lower[: len(coefficients[1::2])] = coefficients[1::2]
    for _ in range(len(coefficients) - 2):
        if lower[0] <= 0.0:
            return False
        rest = np.zeros(width)
        rest[:-1] = upper[1:] - upper[0] / lower[0] * lower[1:]
        upper, lower = lower, rest
    return bool(lower[0] > 0.0)


def find_stability_limit(model: Elastic, kd: float, displaced: bool, most: float) -> float:
    """Return the largest stable Kp (N/m) up to `most`, by bisection on the eigenvalues; 0 if
    none."""
    low, high = 0.0, most
    if compute_growth(model, 1e-3 * model.k, kd, displaced) >= 0.0:
        return 0.0
    if compute_growth(model, high, kd, displaced) < 0.0:
        return high
    for _ in range(60):
        middle = 0.5 * (low + high)
        if compute_growth(model, middle, kd, displaced) < 0.0:
            low = middle
        else:
            high = middle
    return low
