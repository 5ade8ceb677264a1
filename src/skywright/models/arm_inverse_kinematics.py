"""Kinematics of the 4-DoF arm (shoulder pitch, roll, yaw, elbow pitch) in closed form.

Suarez 2020, (6) and (7): r = FK(q) and q = IK(r, phi), where the shoulder's roll q2 = phi resolves
the redundancy. The paper does not print the solution; this is its derivation. Frame: the origin is
where the shoulder's three axes meet, x forward, z up; upper arm L1 and forearm L2 hang along -z at
q = 0. With a = -L2 sin q4 and h = L1 + L2 cos q4 the hand is at

    r = Ry(q1) Rx(q2) Rz(q3) (a, 0, -h).

|r| determines q4 up to its sign, r_y = a s3 c2 + h s2 then q3 up to its branch, and the direction
of (r_x, r_z) then q1. The elbow lies on a circle about the line from shoulder to hand, at y = L1
sin q2. A solution exists for rolls with L1 |sin q2| within that circle.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.scratch import local
from skywright.core.user_code import njit
from skywright.description.robot.limbs import SIDES, list_joints, list_limbs
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.arm_nearest import arm_point, distance, search_nearest
from skywright.models.rigid_body import build_body_model

REACHED, OUT_OF_REACH, AT_A_LIMIT = 0, 1, 2
"""Status of a solution: exact; beyond (or within) the span of the links; or feasible only with
angles beyond the joint limits. The last two return the nearest point that the arm reaches."""
STATUS_NAMES = ("reached", "out of reach", "at a joint limit")

EXACT = 1e-10  # m, largest distance that counts as reached
ROLLS = 48  # number of rolls tried if the requested one violates a limit
TRIALS = ROLLS + 1
SAME = 1e-9  # m, largest difference of lengths that count as equal


class ArmChain(NamedTuple):
    """One arm: its lengths (m), limits (rad) and the indices of its joints in q."""

    upper: float
    fore: float  # including the hand
    p_shoulder: Array  # (3,) m, in the frame of the platform, or of the passive link
    q_min: Array  # (4,)
    q_max: Array
    first: int


class ArmSolution(NamedTuple):
    """Joint angles q (4,) rad, the point p (3,) m that they reach, and its distance to the goal."""

    q: Array
    status: str  # one of STATUS_NAMES
    p: Array
    error: float


def has_arm_chain(robot: Robot) -> bool:
    """Whether the arms of the robot have the joints that the closed form assumes."""
    if robot.arm is None:
        return False
    if any(x.link.is_turned or x.link.side != "both" for x in list_limbs(robot)):
        return False
    found = [_measure_chain(robot, side) for side in range(robot.arm.sides)]
    lengths = [(x.upper, x.fore) for x in found if x is not None]
    # the laws of both arms use the same lengths: a probe on one of two arms makes them differ
    return len(lengths) == robot.arm.sides and float(np.ptp(lengths, axis=0).max()) < SAME


class _Measured(NamedTuple):
    """Lengths (m) of an arm, and its shoulder (3,) m in the frame of its base."""

    upper: float
    fore: float
    p_shoulder: Array


def _measure_chain(robot: Robot, side: int) -> _Measured | None:
    """Return the lengths of an arm whose links are not turned, or None if the form does not fit.

    Fixed links may lie before, between and after the joints. The hand is the probe's tip if the arm
    carries the probe.
    """
    limbs, model = list_limbs(robot), build_body_model(robot)[0]
    joints: list[tuple[str, str, str]] = []
    gaps: list[Array] = []  # from each joint to the next one, and from the elbow to the hand
    gap = np.array(model["hand_offset"][side])  # backwards, from the hand to the base
    i = int(model["hand_link"][side])
    while i >= 0 and limbs[i].side == side:
        link = limbs[i].link
        if link.joint != "fixed":
            joints.insert(0, (link.axis, link.along, link.joint))
            gaps.insert(0, gap)
            gap = np.zeros(3)
        gap = gap + limbs[i].offset
        i = limbs[i].parent
    mine = sum(x.side == side for x in list_joints(robot))
    if joints != [(axis, "-z", "hinge") for axis in "yxzy"] or mine != len(joints):
        return None
    aside = np.array(gaps)  # (4, 3)
    aside[2:, 2] = 0.0
    upper, fore = -float(gaps[2][2]), -float(gaps[3][2])
    if np.abs(aside).max() > SAME or min(upper, fore) <= 0.0:
        return None
    return _Measured(upper, fore, gap)


def build_arm_chain(robot: Robot, side: int = 0) -> ArmChain:
    """Return the arm of `side` (0 left or only, 1 right); raises InputError for other arms."""
    if not has_arm_chain(robot):
        raise InputError(
            f"robot {robot.name!r}: inverse kinematics require arms of four hinges about "
            "y, x, z, y (shoulder pitch, roll, yaw, elbow pitch) with links along -z and "
            "shoulder axes that intersect in one point, equal on both sides, and a hand (or the "
            "tip of a probe) in line with the forearm"
        )
    assert robot.arm is not None
    if side not in range(robot.arm.sides):
        valid = ", ".join(f"{i} ({SIDES[i]})" for i in range(robot.arm.sides))
        raise InputError(f"robot {robot.name!r} has no arm {side!r}; valid: {valid}")
    everything = list_joints(robot)
    first = next(i for i, x in enumerate(everything) if x.side == side)
    joints, found = everything[first : first + 4], _measure_chain(robot, side)
    assert found is not None
    return ArmChain(
        found.upper,
        found.fore,
        found.p_shoulder,
        np.array([x.link.reach[0] for x in joints]),
        np.array([x.link.reach[1] for x in joints]),
        first,
    )


def compute_arm_fk(chain: ArmChain, q: Array) -> Array:
    """Return the hand (3,) m from the shoulder at q (4,) rad: (6)."""
    p = np.empty(3)
    arm_point(chain.upper, chain.fore, np.asarray(q, dtype=float), p)
    return p


def compute_arm_ik(
    chain: ArmChain, p: Array, *, roll: float = 0.0, near: Array | None = None
) -> ArmSolution:
    """Return the angles that bring the hand to p (3,) m from the shoulder: (7).

    `roll` (rad) is the desired roll of the shoulder; if it is infeasible, the nearest feasible roll
    is used. `near` (4,) selects the branch (default: elbow bent so that the forearm points
    forward).
    """
    near = np.array([0.0, roll, 0.0, -0.5 * math.pi]) if near is None else np.asarray(near, float)
    q, reached = np.empty(4), np.empty(3)
    p = np.asarray(p, dtype=float)
    if p.shape != (3,) or not all(map(math.isfinite, p.tolist())):
        raise InputError(f"the goal of a hand must be 3 finite numbers (m), got {p.tolist()}")
    status = solve_arm(
        chain.upper, chain.fore, p, roll, near, chain.q_min, chain.q_max, q, reached
    )  # fmt: skip
    return ArmSolution(q, STATUS_NAMES[status], reached, math.dist(reached, p))


@njit(cache=True, error_model="numpy")
def solve_arm(
    L1: float, L2: float, p: Any, roll: float, near: Any, q_min: Any, q_max: Any, q: Any,
    reached: Any,
) -> int:  # fmt: skip
    """Fill q (4,) with IK(p, roll) and `reached` (3,) with FK(q); return the status."""
    goal = local(3)
    status = _into_reach(L1, L2, p, near, q_min, q_max, goal)
    found = _solve_within(L1, L2, goal, roll, near, q_min, q_max, q)
    arm_point(L1, L2, q, reached)
    if not found:
        search_nearest(L1, L2, p, roll, near, q_min, q_max, q, reached)
        if status == REACHED and distance(p, reached) > EXACT:
            status = AT_A_LIMIT
    return status


@helper
def _into_reach(L1: float, L2: float, p: Any, near: Any, q_min: Any, q_max: Any, goal: Any) -> int:
    """Fill `goal` with the point nearest to p at a distance that the elbow can produce."""
    bend = max(abs(q_min[3]), abs(q_max[3]))
    least = 0.0
    if q_min[3] > 0.0 or q_max[3] < 0.0:
        least = min(abs(q_min[3]), abs(q_max[3]))
    shortest = math.sqrt(max(L1 * L1 + L2 * L2 + 2.0 * L1 * L2 * math.cos(min(bend, math.pi)), 0.0))
    longest = math.sqrt(L1 * L1 + L2 * L2 + 2.0 * L1 * L2 * math.cos(least))
    rho = math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    wanted = min(max(rho, shortest), longest)
    for a in range(3):
        goal[a] = p[a]
    if abs(wanted - rho) < 1e-14:
        return REACHED
    if rho < 1e-9:  # no direction at the shoulder itself: use that of the present posture
        arm_point(L1, L2, near, goal)
        rho = max(math.sqrt(goal[0] ** 2 + goal[1] ** 2 + goal[2] ** 2), 1e-9)
    for a in range(3):
        goal[a] *= wanted / rho
    return OUT_OF_REACH if abs(wanted - rho) > EXACT else REACHED


@helper
def _solve_within(
    L1: float, L2: float, p: Any, roll: float, near: Any, q_min: Any, q_max: Any, q: Any
) -> bool:
    """Fill q with the solution within the limits whose roll is nearest to `roll`.

    Returns False, and the solution with the least violation, if none satisfies the limits.
    """
    lo, hi = _feasible_rolls(L1, L2, p)
    lo, hi = max(lo, q_min[1]), min(hi, q_max[1])
    hi = max(lo, hi)
    start = min(max(roll, lo), hi)
    if solve_at_roll(L1, L2, p, start, near, q_min, q_max, q) == 0.0:
        return True
    off = local(TRIALS)
    step = (hi - lo) / ROLLS
    best = 1e9  # nearest roll within the limits, on a grid
    for i in range(TRIALS):
        phi = lo + step * i
        off[i] = solve_at_roll(L1, L2, p, phi, near, q_min, q_max, q)
        if off[i] == 0.0 and abs(phi - start) < abs(best - start):
            best = phi
    other = best - math.copysign(min(step, abs(best - start)), best - start)
    if best > 1e8:  # or between grid points, where only one roll satisfies the limits
        least = 1e9
        for i in range(TRIALS):
            if off[i] <= off[max(i - 1, 0)] and off[i] <= off[min(i + 1, ROLLS)]:
                phi = _least_violation(
                    L1, L2, p, max(lo, lo + step * (i - 1)), min(hi, lo + step * (i + 1)), near,
                    q_min, q_max, q,
                )  # fmt: skip
                found = solve_at_roll(L1, L2, p, phi, near, q_min, q_max, q)
                if found < least or (found == least and abs(phi - start) < abs(best - start)):
                    least, best = found, phi
        return bool(solve_at_roll(L1, L2, p, best, near, q_min, q_max, q) == 0.0)
    for _ in range(50):  # then refine to the roll at which a limit is just satisfied
        middle = 0.5 * (best + other)
        if solve_at_roll(L1, L2, p, middle, near, q_min, q_max, q) == 0.0:
            best = middle
        else:
            other = middle
    return bool(solve_at_roll(L1, L2, p, best, near, q_min, q_max, q) == 0.0)


@helper
def _least_violation(
    L1: float, L2: float, p: Any, lo: float, hi: float, near: Any, q_min: Any, q_max: Any, q: Any
) -> float:
    """Return the roll between `lo` and `hi` that violates the limits least (golden section)."""
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    x, y = hi - ratio * (hi - lo), lo + ratio * (hi - lo)
    f = solve_at_roll(L1, L2, p, x, near, q_min, q_max, q)
    g = solve_at_roll(L1, L2, p, y, near, q_min, q_max, q)
    for _ in range(70):
        if f <= g:
            hi, y, g = y, x, f
            x = hi - ratio * (hi - lo)
            f = solve_at_roll(L1, L2, p, x, near, q_min, q_max, q)
        else:
            lo, x, f = x, y, g
            y = lo + ratio * (hi - lo)
            g = solve_at_roll(L1, L2, p, y, near, q_min, q_max, q)
    return x if f <= g else y


@helper
def _feasible_rolls(L1: float, L2: float, p: Any) -> tuple[float, float]:
    """Return the interval of rolls (rad) in which the elbow's circle intersects y = L1 sin(roll).

    The upper arm lies on a cone of half angle beta about the direction to the hand, whose angle to
    the plane y = 0 is eta: sin(roll) ranges from sin(eta - beta) to sin(eta + beta).
    """
    a, h, _ = _fold(L1, L2, p)
    beta, eta = math.atan2(a, h), math.atan2(p[1], math.sqrt(p[0] * p[0] + p[2] * p[2]))
    return _angle_of_sine(eta - beta), _angle_of_sine(eta + beta)


@helper
def _angle_of_sine(angle: float) -> float:
    """Return asin(sin(angle)) without losing digits near a quarter turn."""
    angle = _wrap(angle)
    if angle > 0.5 * math.pi:
        return math.pi - angle
    return -math.pi - angle if angle < -0.5 * math.pi else angle


@helper
def _fold(L1: float, L2: float, p: Any) -> tuple[float, float, float]:
    """Return (a >= 0, h, bend >= 0): half-angle form, exact also with the arm stretched."""
    rho2 = p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
    sine = math.sqrt(max((L1 + L2) ** 2 - rho2, 0.0))
    cosine = math.sqrt(max(rho2 - (L1 - L2) ** 2, 0.0))
    bend = 2.0 * math.atan2(sine, cosine)
    return L2 * math.sin(bend), L1 + L2 * math.cos(bend), bend


@helper
def solve_at_roll(
    L1: float, L2: float, p: Any, roll: float, near: Any, q_min: Any, q_max: Any, q: Any
) -> float:
    """Fill q with the branch at this roll within the limits that is nearest to `near`.

    If no branch is within the limits, use the one with the least violation. Returns the violation
    (rad).
    """
    a, h, bend = _fold(L1, L2, p)
    s2, c2 = math.sin(roll), math.cos(roll)
    lever = a * c2
    y = 0.0
    if abs(lever) > 1e-15:
        y = a * min(max((p[1] - h * s2) / lever, -1.0), 1.0)
    missing = abs(p[1] - h * s2 - y * c2)  # distance by which the elbow's circle misses this roll
    z = y * s2 - h * c2
    across = p[0] * p[0] + p[2] * p[2]
    x = across - z * z if a > across * abs(c2) else a * a - y * y  # the more exact form
    x = math.sqrt(max(x, 0.0))
    best_off, best_far = 1e9, 1e9
    trial = local(4)
    for branch in range(4):
        elbow = -1.0 if branch % 2 == 0 else 1.0  # -1: forearm forward
        ahead = 1.0 if branch < 2 else -1.0
        trial[1], trial[3] = roll, elbow * bend
        # (x, y) = -L2 sin(q4) (c3, s3)
        trial[2] = math.atan2(-elbow * y, -elbow * ahead * x)
        if abs(lever) <= 1e-15:  # the yaw has no effect
            trial[2] = min(max(near[2], q_min[2]), q_max[2])
        forward = -L2 * math.sin(trial[3]) * math.cos(trial[2])
        upward = -L2 * math.sin(trial[3]) * math.sin(trial[2]) * s2 - h * c2
        trial[0] = math.atan2(upward * p[0] - forward * p[2], forward * p[0] + upward * p[2])
        if forward * forward + upward * upward < 1e-24:  # the hand lies on the pitch axis
            trial[0] = min(max(near[0], q_min[0]), q_max[0])
        off, far = missing, 0.0
        for j in range(4):
            off = max(off, q_min[j] - trial[j], trial[j] - q_max[j])
            far += (trial[j] - near[j]) ** 2
        off = off if off > 1e-11 else 0.0
        if off < best_off - 1e-12 or (off <= best_off + 1e-12 and far < best_far):
            best_off, best_far = off, far
            for j in range(4):
                q[j] = trial[j]
    if best_off == 0.0:
        for j in range(4):  # rounding at a limit
            q[j] = min(max(q[j], q_min[j]), q_max[j])
    return best_off


@helper
def _wrap(angle: float) -> float:
    """Return the angle within -pi..pi."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
