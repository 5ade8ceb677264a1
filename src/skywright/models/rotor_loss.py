"""Flying on after a rotor was lost: which platforms can, and how their other rotors are told.

A platform with parallel rotors needs vertical force, roll and pitch torque to stay in the air, and
can give up yaw: with five rotors of a hexarotor left, the one opposite to the lost one must nearly
stand still for the yaw torques to cancel, and then it can no longer help to control roll or pitch.
So yaw is not commanded any more, and the thrusts are those of least sum of squares that leave the
opposite rotor little. A platform whose law commands lateral force at a level attitude, with six
tilted rotors, loses a direction of its wrench with each rotor; it cannot fly on with that law.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.models.allocation import Allocator, build_allocator
from skywright.models.rotors import RotorSet

WEIGHTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Of the rotor that has the least to do, in the sum of squares; the largest that leaves it some."""
SPARE = 0.1
"""Share of a rotor's range that is left for control at hover."""
LEAST = 0.03
"""Share of the mean thrust that the least loaded rotor keeps above its lower limit."""


def compute_allocation_without(
    allocator: Allocator, lost: int, weight: float, p_BC: Array
) -> Array | None:
    """Return P (n, 6), thrusts per wrench without rotor `lost`; None where none can hover.

    `weight` (N) acts at p_BC (3,) m. The columns of lateral force and of yaw torque are zero.
    """
    n = allocator.P.shape[0]
    left = [i for i in range(n) if i != lost]
    if allocator.full or len(left) < 5:
        return None
    B = allocator.B[np.ix_([2, 3, 4], left)]  # vertical force, roll and pitch torque
    if np.linalg.matrix_rank(B) < 3:
        return None
    hover = weight * np.array([1.0, p_BC[1], -p_BC[0]])
    mean = weight / n
    low = allocator.t_min[left] + LEAST * mean
    high = allocator.t_max[left] - SPARE * (allocator.t_max[left] - allocator.t_min[left])
    found: Array | None = None
    least = int(np.argmin(np.linalg.pinv(B) @ hover))
    for heavy in WEIGHTS:
        inverse = np.ones(n - 1)
        inverse[least] = 1.0 / heavy
        P3 = inverse[:, None] * B.T @ np.linalg.inv(B * inverse @ B.T)
        thrust = P3 @ hover
        if np.all(thrust >= low) and np.all(thrust <= high):
            found = P3
    if found is None:
        return None
    P: NDArray[Any] = np.zeros((n, 6))
    P[np.ix_(left, [2, 3, 4])] = found
    return P


def list_dispensable(rotors: RotorSet, weight: float, p_BC: Array) -> tuple[int, ...]:
    """Return the rotors, from 1, without each of which `weight` (N) at p_BC (3,) m is held."""
    allocator = build_allocator(rotors)
    found = [
        compute_allocation_without(allocator, i, weight, p_BC) for i in range(len(rotors.axis))
    ]
    return tuple(i + 1 for i, P in enumerate(found) if P is not None)
