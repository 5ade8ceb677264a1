"""Gains of PX4's rate and attitude loops from inertia and lag.

PX4's rate loop commands a torque between -1 and 1; its control allocation scales that by the size
of the columns of the pseudo-inverse (ControlAllocationPseudoInverse.cpp, release 1.14: roll and
pitch by the root of the squared sum over half of the rotors in use, yaw by the largest entry). One
unit is therefore 1 / scale newton metres. With the inertia I, a rate gain P and the scale s the
open loop is P / (I s) / (s (1 + T s)), T the lag of rotors, filter and exchange: a crossover at
1 / (2 T) damps it with 0.7.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OTHER_LAG = 0.012
"""s: gyroscope filter of 30 Hz (IMU_GYRO_CUTOFF) 5 ms, sensor exchange 4 ms, computing 3 ms."""
RATE_PER_LAG = 0.5
"""Crossover of the rate loop times its lag: damping 0.7."""
ATTITUDE_PER_RATE = 0.4
"""Bandwidth of the attitude loop over the crossover of the rate loop."""
YAW_PER_ROLL = 0.5
"""Crossover of yaw over that of roll and pitch: rotors have little drag torque."""
THRUST_COEFFICIENT = 6.5
"""PX4's default of CA_ROTOR0_CT; equal rotors need no other, and PX4's scaling depends on it."""
INTEGRAL = 0.4
"""1/s per rad/s: integral gain over P, as a share of the crossover."""


class Gains(NamedTuple):
    """Gains about roll, pitch and yaw."""

    rate_p: Array  # (3,) torque of PX4 per rad/s
    rate_i: Array  # (3,) torque of PX4 per rad
    attitude_p: Array  # (3,) 1/s


def compute_torque_units(B: Array, thrust_max: Array) -> Array:
    """Return (3,) N m of one unit of PX4's torque about roll, pitch and yaw.

    `B` (6, n) is the wrench in B per newton, about the centre of mass, `thrust_max` (n,) N.
    """
    mix = _compute_mix(B)
    scale = np.zeros(3)
    for axis in (0, 1):
        used = int(np.sum(np.abs(mix[:, axis]) > 1e-3))
        scale[axis] = np.sqrt(mix[:, axis] @ mix[:, axis] / max(used / 2.0, 0.5))
    scale[:2] = scale[:2].max()
    scale[2] = mix[:, 2].max()
    return np.mean(thrust_max) / THRUST_COEFFICIENT / scale


def compute_force_units(B: Array, thrust_max: Array) -> Array:
    """Return (3,) N of one unit of PX4's thrust along x, y and z; z's unit for an axis without
    force.

    PX4 scales each axis by the mean size of the entries of its column, so that the units along x
    and y differ from the one along z, which is the thrust of all rotors.
    """
    mix = _compute_mix(B)[:, 3:]
    size = np.abs(mix)
    used = np.sum(size > 1e-7, axis=0)
    scale = size.sum(axis=0) / np.maximum(used, 1)
    scale[used == 0] = scale[2]
    return np.asarray(np.mean(thrust_max) / THRUST_COEFFICIENT / scale)


def _compute_mix(B: Array) -> Array:
    """Return PX4's pseudo-inverse (n, 6) before scaling: torques, then forces."""
    return np.asarray(np.linalg.pinv(np.vstack([B[3:], B[:3]]) * THRUST_COEFFICIENT, rcond=1e-6))


def compute_gains(inertia: Array, torque_units: Array, lag: float) -> Gains:
    """Return the gains of a robot of `inertia` (3,) kg m^2 whose rotors lag by `lag` (s)."""
    crossover = np.full(3, RATE_PER_LAG / (lag + OTHER_LAG))
    crossover[2] *= YAW_PER_ROLL
    rate_p = inertia * crossover / torque_units
    return Gains(rate_p, rate_p * INTEGRAL * crossover, ATTITUDE_PER_RATE * crossover)
