"""Effect of the rotors' inertia on a commanded torque, and the resulting limit of the attitude
loop.

A rotor that accelerates turns the platform the other way (vehicle/effects/rotor_momentum.py). In
hover, in addition to the rotors' lag, a commanded torque t becomes (1 + T s) t, with T diagonal
about the axes of B to good approximation: T = D B^+ with the torque D dT/dt of changing thrusts and
B^+ the allocation. Coplanar rotors have T = J w / (2 k_m T) = 0.4 s about z: the torque of the
spin-up is an order of magnitude above the steady drag torque. Tilted rotors have less, of either
sign. If the tilt's torque about z opposes the drag torque (the F550's, by the printed matrices), T
is negative: a zero in the right half plane, which no controller can cancel and which limits the
bandwidth.
"""

from __future__ import annotations

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.models.allocation import Allocator
from skywright.models.rotors import RotorSet

MARGIN = math.radians(30.0)
"""rad, phase margin that an attitude loop keeps despite a negative reaction time."""


def compute_reaction_times(rotors: RotorSet, allocator: Allocator, weight: float) -> Array:
    """Return T (3,) s about x, y, z of B of a hovering robot of `weight` (N)."""
    thrust = allocator.P @ np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0]) + allocator.preload
    speed = np.sqrt(np.maximum(thrust, rotors.thrust_min) / rotors.k_f)
    # speed changes by dT / (2 k_f w)
    reaction = -rotors.inertia * rotors.spin / (2.0 * rotors.k_f * speed) * rotors.axis.T
    return np.array(np.diag(reaction @ allocator.P[:, 3:]))


def limit_bandwidth(
    wanted: float, damping: float, reaction: float, lag: float, delay: float
) -> float:
    """Return the bandwidth (rad/s), at most `wanted`, of an attitude loop that keeps MARGIN.

    The loop is (w^2 + 2 zeta w s) / s^2, the rotors (1 + T s) / (1 + lag s) exp(-delay s). A T that
    is not negative reduces no phase, and `wanted` is returned.
    """
    if reaction >= 0.0 or _find_margin(wanted, damping, reaction, lag, delay) >= MARGIN:
        return wanted
    low, high = 0.0, wanted
    for _ in range(50):
        middle = 0.5 * (low + high)
        enough = _find_margin(middle, damping, reaction, lag, delay) >= MARGIN
        low, high = (middle, high) if enough else (low, middle)
    return low


def _find_margin(w: float, damping: float, reaction: float, lag: float, delay: float) -> float:
    """Return the phase margin (rad) at the highest frequency of loop gain 1; -pi if there is none.

    With |T| above the lag the gain may never fall below 1.
    """
    if w == 0.0:
        return math.pi
    s = 1j * w * np.geomspace(0.1, 1e3, 4000)
    gain = (w * w + 2.0 * damping * w * s) / s**2 * (1.0 + reaction * s) / (1.0 + lag * s)
    over = np.flatnonzero(np.abs(gain) >= 1.0)
    if over[-1] == len(s) - 1:
        return -math.pi
    at = s[over[-1]]
    turn = math.atan(2.0 * damping * at.imag / w) - math.pi
    return float(
        math.pi + turn + math.atan(reaction * at.imag) - math.atan(lag * at.imag) - delay * at.imag
    )
