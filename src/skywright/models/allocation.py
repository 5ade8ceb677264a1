"""Allocation of a wrench to rotor thrusts that stay within their limits.

The allocation is the exact inverse for six independent rotors and least squares for more. Robots
whose rotors produce no lateral force (coplanar ones) receive the controllable components: f_z and
the torques. If a wrench is infeasible, its components are reduced in this order: lateral force, yaw
torque, then vertical thrust against roll and pitch torque. Each reduction is a closed form (a ray
against the box of limits), so a call takes well under a microsecond and needs no iteration.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.core.user_code import njit
from skywright.errors import InputError
from skywright.models.rotors import RotorSet

EXACT = 0
LATERAL_REDUCED = 1
YAW_REDUCED = 2
ATTITUDE_OR_THRUST_REDUCED = 3
NOT_FINITE = -1

OMNIDIRECTIONAL = 2
"""Value of `full` for rotors that push both ways and hover at any attitude."""

THRUST_BAND = 0.3
"""Largest fraction by which the vertical thrust is reduced in favour of roll and pitch torque."""


class Allocator(NamedTuple):
    """Data of `allocate`, readable from compiled code."""

    B: Array  # (6, n) wrench [N; N m] in B per newton of thrust
    P: Array  # (n, 6) thrust per wrench; lateral columns are zero when `full` is 0
    t_min: Array  # (n,) N, minus the preload
    t_max: Array  # (n,) N, minus the preload
    k_f: float  # N/(rad/s)^2
    full: int  # 1 for six independent components, 2 if at any attitude (OMNIDIRECTIONAL)
    preload: Array  # (n,) N, zero net wrench; added to the thrusts of `allocate`


def build_allocator(rotors: RotorSet) -> Allocator:
    """Build the allocator of a rotor set.

    Raises InputError when the rotors cannot control f_z and the three torques independently.
    """
    arm = max(float(np.max(np.linalg.norm(rotors.position, axis=1))), 1e-6)
    scaled = rotors.B / np.array([1.0, 1.0, 1.0, arm, arm, arm])[:, None]
    sigma = np.linalg.svd(scaled, compute_uv=False)
    # Below a tilt of 0.1 % of the thrust, the lateral authority is too small for any law.
    full = bool(len(sigma) == 6 and sigma[-1] > 1e-3 * sigma[0])
    n = rotors.B.shape[1]
    pinv = np.zeros((n, 6))
    if full:
        pinv[:, :] = np.linalg.inv(rotors.B) if n == 6 else np.linalg.pinv(rotors.B)
    else:
        rows = np.linalg.svd(scaled[2:], compute_uv=False)
        if len(rows) < 4 or rows[-1] < 1e-6 * rows[0]:
            raise InputError(
                f"robot.rotors: these {n} rotors cannot control vertical force and all "
                "three torques independently; use at least 4 rotors with both spins that "
                "are not on one line"
            )
        pinv[:, 2:] = np.linalg.pinv(rotors.B[2:])
    preload = np.zeros(n)
    if full and n > 6 and np.min(pinv[:, 2]) < 0.0:
        preload = compute_preload(rotors)
    return Allocator(
        B=rotors.B,
        P=np.ascontiguousarray(pinv),
        t_min=rotors.thrust_min - preload,
        t_max=rotors.thrust_max - preload,
        k_f=rotors.k_f,
        full=OMNIDIRECTIONAL if np.any(preload) else int(full),
        preload=preload,
    )


def compute_preload(rotors: RotorSet) -> Array:
    """Return thrusts (n,) N with zero net wrench that centre the least one in its range.

    Rotors that point down act against those that point up. Around this preload each thrust can
    increase and decrease like that of a reversible rotor, so that the least-squares solution may
    have either sign (Tognon, Franchi: Omnidirectional aerial vehicles with unidirectional
    thrusters, RA-L 2018). Returns zeros if no such thrusts exist.
    """
    n = len(rotors.spin)
    # maximise the least share x over thrusts with B T = 0 and a sum of n
    equal = np.vstack([np.hstack([rotors.B, np.zeros((6, 1))]), np.append(np.ones(n), 0.0)])
    found = linprog(
        np.append(np.zeros(n), -1.0), A_ub=np.hstack([-np.eye(n), np.ones((n, 1))]),
        b_ub=np.zeros(n), A_eq=equal, b_eq=np.append(np.zeros(6), float(n)), method="highs",
    )  # fmt: skip
    if found.status != 0 or found.x[-1] < 1e-3:
        return np.zeros(n)
    share = np.asarray(found.x[:n])
    middle = 0.5 * (rotors.thrust_min + rotors.thrust_max)
    return share * float(np.min(middle / share))


def usable_limit(allocator: Allocator, thrust_fraction: float) -> Array:
    """Return the upper limits (n,) N of which `thrust_fraction` is used, minus the preload."""
    return (allocator.t_max + allocator.preload) * thrust_fraction - allocator.preload


@helper
def _interval(base: Array, ray: Array, t_min: Array, t_max: Array) -> tuple[float, float]:
    """Return [lo, hi] of s with t_min <= base + s ray <= t_max (lo > hi if it is empty)."""
    lo = -math.inf
    hi = math.inf
    for i in range(base.shape[0]):
        r = ray[i]
        below = t_min[i] - base[i]
        above = t_max[i] - base[i]
        if abs(r) < 1e-12:
            if below > 1e-9 or above < -1e-9:
                return 1.0, -1.0
            continue
        a = below / r
        b = above / r
        if a > b:
            a, b = b, a
        lo = max(lo, a)
        hi = min(hi, b)
    return lo, hi


@helper
def _mul(
    P: Array, fx: float, fy: float, fz: float, tx: float, ty: float, tz: float, out: Array
) -> None:
    for i in range(P.shape[0]):
        out[i] = (
            P[i, 0] * fx + P[i, 1] * fy + P[i, 2] * fz + P[i, 3] * tx + P[i, 4] * ty + P[i, 5] * tz
        )


@helper
def _share_line(
    thrust: float, up: Array, turn: Array, t_min: Array, t_max: Array
) -> tuple[float, float]:
    """Return the largest feasible share of the torque thrusts `turn` at this vertical thrust and
    its slope.

    Each rotor allows share <= (limit - thrust up_i) / turn_i, a line over the vertical thrust.
    """
    best, slope = math.inf, 0.0
    for i in range(up.shape[0]):
        r = turn[i]
        if abs(r) < 1e-12:
            continue
        limit = t_max[i] if r > 0.0 else t_min[i]
        share = (limit - thrust * up[i]) / r
        if share < best:
            best, slope = share, -up[i] / r
    return best, slope


@helper
def _limit_thrust_and_torque(
    wanted: float, up: Array, turn: Array, t_min: Array, t_max: Array, work: Array
) -> tuple[float, float, bool]:
    """Return vertical thrust (N), share of the roll and pitch torque, and whether both exist."""
    work[:] = 0.0
    f_lo, f_hi = _interval(work, up, t_min, t_max)
    if f_lo > f_hi:
        return 0.0, 0.0, False
    f0 = min(max(wanted, f_lo), f_hi)
    band = THRUST_BAND * abs(f0)
    f_lo = max(f_lo, f0 - band)
    f_hi = min(f_hi, f0 + band)
    a, b = _interval(turn, up, t_min, t_max)
    a = max(a, f_lo)
    b = min(b, f_hi)
    if a <= b:
        return min(max(f0, a), b), 1.0, True
    # The share is the minimum of n lines: intersect rising and falling lines until they meet.
    left, right = f_lo, f_hi
    y1, s1 = _share_line(left, up, turn, t_min, t_max)
    y2, s2 = _share_line(right, up, turn, t_min, t_max)
    if s1 <= 0.0:
        return left, min(max(y1, 0.0), 1.0), True
    if s2 >= 0.0:
        return right, min(max(y2, 0.0), 1.0), True
    best = left
    share = y1
    for _ in range(6):
        best = (y2 - y1 + s1 * left - s2 * right) / (s1 - s2)
        top = y1 + s1 * (best - left)
        share, slope = _share_line(best, up, turn, t_min, t_max)
        if share > top - 1e-12:
            break
        if slope > 0.0:
            left, y1, s1 = best, share, slope
        else:
            right, y2, s2 = best, share, slope
    return best, min(max(share, 0.0), 1.0), True


@njit(cache=True, error_model="numpy")
def allocate(
    B: Array,
    P: Array,
    t_min: Array,
    t_max: Array,
    full: int,
    f_B: Array,
    t_B: Array,
    up_B: Array,
    p_BC: Array,
    thrust: Array,
) -> int:
    """Write thrusts (n,) N that produce the wrench, or the nearest one in the order of priority.

    f_B (3,) N and t_B (3,) N m: wanted wrench in B, torque about B's origin. up_B (3,): the
    vertical in B (third row of R_WB). p_BC (3,) m: whole-robot centre of mass in B. A reduction of
    the force applies at this point, so that the weight of the arm stays balanced.

    Returns EXACT (0), LATERAL_REDUCED (1), YAW_REDUCED (2), ATTITUDE_OR_THRUST_REDUCED (3: the
    vertical thrust changes by at most THRUST_BAND, then the torque is reduced) or NOT_FINITE (-1:
    `thrust` is unchanged and the caller decides). The result stays within [t_min, t_max].

    Without lateral force the thrust acts along z_B with the wanted vertical component: at level
    attitude it has no lateral part, at a tilted one that of a coplanar robot. That of an
    omnidirectional robot (`full` 2) acts along the vertical at any attitude.
    """
    n = P.shape[0]
    fx, fy, fz = f_B[0], f_B[1], f_B[2]
    tx, ty, tz = t_B[0], t_B[1], t_B[2]
    if not math.isfinite(fx + fy + fz + tx + ty + tz):
        return -1
    if full == 0:
        fx = 0.0
        fy = 0.0
    ok = True
    for i in range(n):
        t = P[i, 0] * fx + P[i, 1] * fy + P[i, 2] * fz + P[i, 3] * tx + P[i, 4] * ty + P[i, 5] * tz
        thrust[i] = t
        if t < t_min[i] - 1e-9 or t > t_max[i] + 1e-9:
            ok = False
    if ok:
        for i in range(n):
            thrust[i] = min(max(thrust[i], t_min[i]), t_max[i])
        return 0

    work = local(5, MAX_ROTORS)
    up, turn, yaw = work[0, :n], work[1, :n], work[2, :n]
    lateral, base = work[3, :n], work[4, :n]
    cx, cy, cz = p_BC[0], p_BC[1], p_BC[2]
    # torque about the centre of mass
    mx = tx - (cy * fz - cz * fy)
    my = ty - (cz * fx - cx * fz)
    mz = tz - (cx * fy - cy * fx)
    # thrust along (dx, dy, dz) with the wanted vertical component
    dx, dy, dz, wanted = 0.0, 0.0, 1.0, fz
    if full == OMNIDIRECTIONAL:
        dx, dy, dz = up_B[0], up_B[1], up_B[2]
        wanted = fx * dx + fy * dy + fz * dz
    elif full != 0 and up_B[2] > 0.3:
        wanted = (fx * up_B[0] + fy * up_B[1] + fz * up_B[2]) / up_B[2]
    _mul(P, dx, dy, dz, cy * dz - cz * dy, cz * dx - cx * dz, cx * dy - cy * dx, up)
    _mul(P, 0.0, 0.0, 0.0, mx, my, 0.0, turn)
    _mul(P, 0.0, 0.0, 0.0, 0.0, 0.0, mz, yaw)
    vertical, share, exists = _limit_thrust_and_torque(wanted, up, turn, t_min, t_max, base)
    if not exists:  # hover is infeasible with this centre of mass: nearest corner
        for i in range(n):
            thrust[i] = min(max(thrust[i], t_min[i]), t_max[i])
        return 3
    for i in range(n):
        base[i] = vertical * up[i] + share * turn[i]
    flag = 0
    if share < 1.0 or abs(vertical - wanted) > 1e-9:
        flag = 3
    _, s = _interval(base, yaw, t_min, t_max)
    s = min(max(s, 0.0), 1.0)
    if s < 1.0 and flag == 0:
        flag = 2
    for i in range(n):
        base[i] += s * yaw[i]
    # the rest of the force is lateral; it acts at the centre of mass
    if full != 0:
        lx, ly, lz = fx - wanted * dx, fy - wanted * dy, fz - wanted * dz
        _mul(P, lx, ly, lz, cy * lz - cz * ly, cz * lx - cx * lz, cx * ly - cy * lx, lateral)
        _, s = _interval(base, lateral, t_min, t_max)
        s = min(max(s, 0.0), 1.0)
        if s < 1.0 and flag == 0:
            flag = 1
        for i in range(n):
            base[i] += s * lateral[i]
    # Move every component toward the demand as far as the limits allow. Without this step the
    # result would jump where a demand becomes feasible.
    for i in range(n):
        lateral[i] = thrust[i] - base[i]
    _, s = _interval(base, lateral, t_min, t_max)
    s = min(max(s, 0.0), 1.0)
    for i in range(n):
        thrust[i] = min(max(base[i] + s * lateral[i], t_min[i]), t_max[i])
    return flag


@njit(cache=True, error_model="numpy")
def thrust_to_speed(thrust: Array, n: int, k_f: float, speed: Array) -> None:
    """Write rotor speeds (rad/s) sqrt(T / k_f) of the first n thrusts (N); the rest become 0."""
    for i in range(speed.shape[0]):
        speed[i] = math.sqrt(max(thrust[i], 0.0) / k_f) if i < n else 0.0
