"""Forward kinematics of the 4-DoF arm, (6) of Suarez 2020, and the posture nearest to a point.

The frame and the order of the joints are those of `arm_inverse_kinematics.py`, whose closed form is
exact. The search applies to points that no posture within the limits reaches.
"""

import math
from typing import Any

from skywright.core.compiled import helper
from skywright.core.rotations import solve3
from skywright.core.scratch import local
from skywright.core.user_code import njit

STEPS = 200  # steps of the search for the nearest point
GRID = 7  # start postures per joint


@njit(cache=True, error_model="numpy")
def arm_point(L1: float, L2: float, q: Any, p: Any) -> None:
    """Fill p (3,) with FK(q): (6)."""
    s1, c1 = math.sin(q[0]), math.cos(q[0])
    s2, c2 = math.sin(q[1]), math.cos(q[1])
    a, h = -L2 * math.sin(q[3]), L1 + L2 * math.cos(q[3])
    x, y = a * math.cos(q[2]), a * math.sin(q[2])
    z = y * s2 - h * c2
    p[0] = x * c1 + z * s1
    p[1] = y * c2 + h * s2
    p[2] = -x * s1 + z * c1


@helper
def arm_jacobian(L1: float, L2: float, q: Any, J: Any) -> None:
    """Fill J (3, 4) m/rad = dFK/dq."""
    s1, c1 = math.sin(q[0]), math.cos(q[0])
    s2, c2 = math.sin(q[1]), math.cos(q[1])
    s3, c3 = math.sin(q[2]), math.cos(q[2])
    a, h = -L2 * math.sin(q[3]), L1 + L2 * math.cos(q[3])
    da, dh = -L2 * math.cos(q[3]), -L2 * math.sin(q[3])
    x, y = a * c3, a * s3
    z = y * s2 - h * c2
    J[0, 0], J[1, 0], J[2, 0] = -x * s1 + z * c1, 0.0, -x * c1 - z * s1
    dz = y * c2 + h * s2
    J[0, 1], J[1, 1], J[2, 1] = dz * s1, -y * s2 + h * c2, dz * c1
    dx, dy = -y, x
    J[0, 2], J[1, 2], J[2, 2] = dx * c1 + dy * s2 * s1, dy * c2, -dx * s1 + dy * s2 * c1
    dx, dy = da * c3, da * s3
    dz = dy * s2 - dh * c2
    J[0, 3], J[1, 3], J[2, 3] = dx * c1 + dz * s1, dy * c2 + dh * s2, -dx * s1 + dz * c1


@helper
def distance(a: Any, b: Any) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@helper
def search_nearest(
    L1: float, L2: float, p: Any, roll: float, near: Any, q_min: Any, q_max: Any, q: Any,
    reached: Any,
) -> None:  # fmt: skip
    """Fill q with a posture within the limits whose hand is nearest to p, and fill `reached`.

    Projected Levenberg-Marquardt starts from the best postures of a coarse grid (one per elbow
    angle), from the given posture and from `near`. The best result is kept.
    """
    best = 1e9
    x, kept, at = local(4), local(4), local(3)
    for start in range(GRID + 2):
        for j in range(4):
            x[j] = min(max(near[j] if start == GRID + 1 else q[j], q_min[j]), q_max[j])
        if start < GRID:
            _best_of_grid(L1, L2, p, q_min, q_max, start, x)
        error = _descend(L1, L2, p, q_min, q_max, x, at)
        if error < best - 1e-12:
            best = error
            for a in range(3):
                reached[a] = at[a]
            for j in range(4):
                kept[j] = x[j]
    for j in range(4):
        q[j] = kept[j]


@helper
def _best_of_grid(L1: float, L2: float, p: Any, q_min: Any, q_max: Any, elbow: int, x: Any) -> None:
    """Fill x with the posture of the grid nearest to p, at elbow angle number `elbow`."""
    trial, there = local(4), local(3)
    best = 1e9
    for i in range(GRID**3):
        n = i
        for j in range(4):
            share = elbow / (GRID - 1.0) if j == 3 else (n % GRID) / (GRID - 1.0)
            trial[j] = q_min[j] + share * (q_max[j] - q_min[j])
            n //= GRID
        arm_point(L1, L2, trial, there)
        if distance(p, there) < best:
            best = distance(p, there)
            for j in range(4):
                x[j] = trial[j]


@helper
def _descend(L1: float, L2: float, p: Any, q_min: Any, q_max: Any, x: Any, at: Any) -> float:
    """Reduce |FK(x) - p| over x within the limits; fill `at` = FK(x) and return the error."""
    J, M, r, y = local(3, 4), local(3, 3), local(3), local(3)
    trial, there = local(4), local(3)
    free = local(4)
    free[:] = 1.0
    damping = 1e-4
    arm_point(L1, L2, x, at)
    error = distance(p, at)
    for _ in range(STEPS):
        arm_jacobian(L1, L2, x, J)
        for a in range(3):
            r[a] = p[a] - at[a]
        for j in range(4):  # a joint at its limit does not move further outward
            g = J[0, j] * r[0] + J[1, j] * r[1] + J[2, j] * r[2]
            held = (x[j] <= q_min[j] and g < 0.0) or (x[j] >= q_max[j] and g > 0.0)
            free[j] = 0.0 if held else 1.0
        for a in range(3):
            for c in range(3):
                M[a, c] = damping * L1 * L1 if a == c else 0.0
                for j in range(4):
                    M[a, c] += free[j] * J[a, j] * J[c, j]
        solve3(M, r, y)
        for j in range(4):
            step = free[j] * (J[0, j] * y[0] + J[1, j] * y[1] + J[2, j] * y[2])
            trial[j] = min(max(x[j] + step, q_min[j]), q_max[j])
        arm_point(L1, L2, trial, there)
        new = distance(p, there)
        if new < error:
            for j in range(4):
                x[j] = trial[j]
            for a in range(3):
                at[a] = there[a]
            if error - new < 1e-15:
                return float(new)
            error = new
            damping = max(0.2 * damping, 1e-10)
        else:
            damping *= 8.0
            if damping > 1e8:
                break
    return error
