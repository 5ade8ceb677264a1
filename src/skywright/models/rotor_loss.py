"""Flight after the loss of a rotor: feasible platforms, and the allocation to the remaining rotors.

A platform with parallel rotors needs vertical force, roll and pitch torque to stay in the air, and
can give up yaw. With five rotors of a hexarotor left, the yaw torques cancel only if the rotor
opposite to the lost one nearly stops, and then it no longer helps to control roll or pitch. Yaw is
therefore no longer commanded, and the thrusts are those of weighted least squares that leave the
opposite rotor little.

A platform whose law commands force and torque in any direction needs at least seven remaining
rotors, because thrusts are positive: six rotors with limits T >= T_min > 0 produce a wrench and all
its neighbours only if none of them is at its limit. With six tilted rotors each loss removes a
direction of the wrench, and that law cannot continue. With eight, the remaining seven produce all
six components, B T = w, T = P w + s N with one null vector N. Where N has zeros, the thrusts of
these rotors follow from the wrench alone, and level hover may require less than T_min from one of
them. The platform may then hover with a lean. The least lean with a reserve at all limits is a
linear programme in the thrusts and the horizontal force (the weight in B), solved repeatedly for
the cosine of the lean.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from skywright.core.arrays import Array
from skywright.models.allocation import Allocator, build_allocator
from skywright.models.rotors import RotorSet

WEIGHTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Weights of the least loaded rotor in the sum of squares; the largest that leaves it some thrust
is used."""
SPARE = 0.1
"""Share of a rotor's range that is reserved for control at hover."""
LEAST = 0.03
"""Share of the mean thrust that the least loaded rotor keeps above its lower limit."""
SIDES = 32
"""Sides of the polygon that approximates the circle of equal lean."""
ROUNDS = 12
"""Iterations of the programme, each with the cosine of the previous lean."""


class RotorsLeft(NamedTuple):
    """Allocation to the remaining rotors; rows of the lost one are zero."""

    P: Array  # (n, 6) thrust (N) per wrench
    preload: Array  # (n,) N, zero net wrench
    t_min: Array  # (n,) N, minus the preload
    t_max: Array  # (n,) N, minus the preload
    R_WB: Array  # (3, 3) hover attitude without heading
    holds_heading: bool

    @property
    def lean(self) -> float:
        """Lean (rad) at hover."""
        return math.acos(min(max(float(self.R_WB[2, 2]), -1.0), 1.0))


def compute_rotors_left(
    allocator: Allocator, lost: int, weight: float, p_BC: Array, tilt_max: float
) -> RotorsLeft | None:
    """Return the allocation that holds `weight` (N) at p_BC (3,) m without rotor `lost`, or None.

    `tilt_max` (rad): largest lean for a law that commands six components; 0 for a law that does not
    track a commanded attitude.
    """
    if float(np.min(allocator.t_max - allocator.t_min)) <= 0.0:  # another rotor is already lost
        return None
    found = (
        _lean(allocator, lost, weight, p_BC, tilt_max)
        if allocator.full
        else _give_up_yaw(allocator, lost, weight, p_BC)
    )
    if found is None:
        return None
    P, preload, up = found
    t_min = allocator.t_min + allocator.preload - preload
    t_max = allocator.t_max + allocator.preload - preload
    t_min[lost] = t_max[lost] = 0.0
    return RotorsLeft(P, preload, t_min, t_max, _stand_up(up), bool(allocator.full))


def _give_up_yaw(
    allocator: Allocator, lost: int, weight: float, p_BC: Array
) -> tuple[Array, Array, Array] | None:
    """Return P, a zero preload and up. The columns of lateral force and of yaw torque are zero."""
    n = allocator.P.shape[0]
    left = [i for i in range(n) if i != lost]
    if len(left) < 5:
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
    return P, np.zeros(n), np.array([0.0, 0.0, 1.0])


def _lean(
    allocator: Allocator, lost: int, weight: float, p_BC: Array, tilt_max: float
) -> tuple[Array, Array, Array] | None:
    """Return P, preload and up (3,) in B of the least lean with a reserve at all limits.

    The search starts at level, so a lean beyond one at which the rotors cannot produce the weight
    over its cosine is not found. A robot would fall before it reached such a lean.
    """
    n = allocator.P.shape[0]
    left = [i for i in range(n) if i != lost]
    B = allocator.B[:, left]
    sizes = np.linalg.svd(B, compute_uv=False)
    if len(left) < 7 or sizes[-1] < 1e-3 * sizes[0]:
        return None
    low = (allocator.t_min + allocator.preload)[left]
    high = (allocator.t_max + allocator.preload)[left]
    spare = SPARE * (high - low)
    turn = np.array([[0.0, -p_BC[2], p_BC[1]], [p_BC[2], 0.0, -p_BC[0]], [-p_BC[1], p_BC[0], 0.0]])
    at_com = weight * np.vstack([np.eye(3), turn])  # wrench of weights along x, y and z
    angle = 2.0 * math.pi * np.arange(SIDES) / SIDES
    # variables: thrusts, horizontal parts of up over its vertical one, and their norm, which is
    # minimised
    size = np.hstack([
        np.zeros((SIDES, len(left))), np.cos(angle)[:, None], np.sin(angle)[:, None],
        -np.ones((SIDES, 1)),
    ])  # fmt: skip
    bounds = [*zip(low + spare, high - spare, strict=True), *[(None, None)] * 3]
    cost = np.append(np.zeros(len(left) + 2), 1.0)
    up = np.array([0.0, 0.0, 1.0])
    for _ in range(ROUNDS):
        down = up[2] * at_com
        found = linprog(
            cost, A_ub=size, b_ub=np.zeros(SIDES),
            A_eq=np.hstack([B, -down[:, :2], np.zeros((6, 1))]), b_eq=down[:, 2],
            bounds=bounds, method="highs",
        )  # fmt: skip
        if found.status != 0:
            return None
        up = np.append(found.x[len(left) : len(left) + 2], 1.0)
        up /= np.linalg.norm(up)
    if math.acos(up[2]) > tilt_max + 1e-6:
        return None
    hover = at_com @ up
    # among the thrusts of this lean, maximise the distance to their limits
    room = np.vstack(
        [
            np.hstack([-np.eye(len(left)), np.ones((len(left), 1))]),
            np.hstack([np.eye(len(left)), np.ones((len(left), 1))]),
        ]
    )
    middle = linprog(
        np.append(np.zeros(len(left)), -1.0), A_ub=room, b_ub=np.concatenate([-low, high]),
        A_eq=np.hstack([B, np.zeros((6, 1))]), b_eq=hover, bounds=[(None, None)] * (len(left) + 1),
        method="highs",
    )  # fmt: skip
    if middle.status != 0:
        return None
    P: NDArray[Any] = np.zeros((n, 6))
    P[left] = np.linalg.pinv(B)
    preload: NDArray[Any] = np.zeros(n)
    preload[left] = np.asarray(middle.x[:-1]) - P[left] @ hover
    return P, preload, up


def _stand_up(up: Array) -> Array:
    """Return the smallest rotation (3, 3) that turns `up` (3,) in B to the vertical."""
    v = np.array([up[1], -up[0], 0.0])  # up x z
    cross = np.array([[0.0, 0.0, v[1]], [0.0, 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + up[2]))


def list_rotors_left(
    rotors: RotorSet, weight: float, p_BC: Array, tilt_max: float
) -> dict[int, RotorsLeft]:
    """Return the rotors, numbered from 1, whose single loss leaves `weight` held, and the
    allocations."""
    allocator = build_allocator(rotors)
    found = {
        i + 1: compute_rotors_left(allocator, i, weight, p_BC, tilt_max)
        for i in range(len(rotors.axis))
    }
    return {i: left for i, left in found.items() if left is not None}
