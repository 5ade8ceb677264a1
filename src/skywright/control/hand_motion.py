"""Motion of a hand: straight lines, velocities, and from the hand to the joints.

Suarez 2020, (23), (24) and (7). The hand's reference p_ref lives in W, so that the arm makes up
for what the platform and the passive link do. The paper steps from the measured hand; with the
servos' lag (17) it would then move at v T / T_s. Here the step is taken from the last reference,
which moves at v, and the servos are led by their lag.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.control.joint_loops import hold_joint
from skywright.control.servo_profile import PROFILE_LAG, follow_profile
from skywright.core.rotations import cross, mat_t_vec, mat_vec, norm
from skywright.models.arm_inverse_kinematics import REACHED, arm_point, solve_arm

Record = Any

SIGHT = 0.5  # s without a sample after which a marker counts as out of sight
LEAD_MAX = 0.05  # m, by which the servos' lag may be made up for


@njit(cache=True, error_model="numpy")
def start_hand(b: Record, h: int) -> None:
    """Start a task where the servos now lead the hand: nothing jumps."""
    arms = b.arms
    first = arms.first[h]
    p_A = np.empty(3)
    arm_point(arms.upper, arms.fore, arms.q_goal[first : first + 4], p_A)
    _from_base(b, h, p_A, arms.p_ref[h])
    for a in range(3):
        arms.v_ref[h, a] = 0.0
    for j in range(first, first + arms.n):
        arms.w_goal[j] = 0.0


@njit(cache=True, error_model="numpy")
def _from_base(b: Record, h: int, p_A: Any, p_W: Any) -> None:
    """Fill p_W with a point given from the shoulder of arm h in A."""
    arms, vec, p_B = b.arms, np.empty(3), np.empty(3)
    for a in range(3):
        vec[a] = arms.p_BS[h, a] + p_A[a]
    mat_vec(arms.R_BA, vec, p_B)
    for a in range(3):
        p_B[a] += arms.p_BA[a]
    mat_vec(b.est.R_WB, p_B, p_W)
    for a in range(3):
        p_W[a] += b.est.p_WB[a]


@njit(cache=True, error_model="numpy")
def step_position(b: Record, h: int, dr: Any) -> None:
    """Fill dr (3,) m with the step of (23): v T e / |e|, at most |e|."""
    arms, e = b.arms, np.empty(3)
    for a in range(3):
        e[a] = b.ref.p_WH[h, a] - arms.p_ref[h, a]
    v = norm(b.ref.v_WH[h])
    step = min((v if v > 0.0 else arms.speed_hand) * arms.dt, norm(e))
    length = max(norm(e), 1e-12)
    for a in range(3):
        dr[a] = step * e[a] / length


@njit(cache=True, error_model="numpy")
def step_to_marker(b: Record, h: int, dr: Any) -> None:
    """Fill dr (3,) m: (23) towards ref.p_WH in the marker's frame, while it is seen."""
    arms, e = b.arms, np.empty(3)
    mat_vec(arms.R_WM, b.ref.p_WH[h], e)
    for a in range(3):
        e[a] += arms.p_WM[a] - arms.p_ref[h, a]
    v = norm(b.ref.v_WH[h])
    step = min((v if v > 0.0 else arms.speed_hand) * arms.dt, norm(e))
    step = step if arms.marker_age < SIGHT else 0.0
    length = max(norm(e), 1e-12)
    for a in range(3):
        dr[a] = step * e[a] / length


@njit(cache=True, error_model="numpy")
def step_velocity(b: Record, h: int, dr: Any) -> None:
    """Fill dr (3,) m with the step of (24): v_max T [dx, dy, dz], here v_WH T within speed_hand."""
    v = norm(b.ref.v_WH[h])
    share = min(1.0, b.arms.speed_hand / v) if v > 0.0 else 0.0
    for a in range(3):
        dr[a] = share * b.ref.v_WH[h, a] * b.arms.dt


@njit(cache=True, error_model="numpy")
def move_hand(b: Record, h: int, dr: Any, smooth: bool) -> None:
    """Step p_ref by dr (3,) m in W and command the joints that bring the hand there: (7), dr_G.

    The deflection under the arm's weight, dr_G of (23), is made up for joint by joint
    (`hold_joint`). `smooth` sends the angles through the servos' profiles and leads their lag.
    Where the arm does not reach, p_ref stays at the nearest point that it does: no windup.
    """
    arms, ref = b.arms, b.ref
    first = arms.first[h]
    p_W, p_B, p_A, vec = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for a in range(3):
        arms.p_ref[h, a] += dr[a]
        arms.v_ref[h, a] = dr[a] / arms.dt
        vec[a] = arms.p_ref[h, a] - b.est.p_WB[a]
    mat_t_vec(b.est.R_WB, vec, p_B)
    lead = np.zeros(3)
    if smooth:
        _lead(b, h, p_B, lead)
    q, reached, status = np.empty(4), np.empty(3), -1
    for attempt in range(2):
        if attempt == 1:  # a lead that ends out of reach is no reason to give p_ref up
            lead[:] = 0.0
        for a in range(3):
            vec[a] = p_B[a] + lead[a] - arms.p_BA[a]
        mat_t_vec(arms.R_BA, vec, p_A)
        for a in range(3):
            p_A[a] -= arms.p_BS[h, a]
        status = solve_arm(
            arms.upper, arms.fore, p_A, ref.q[first + 1], arms.q_goal[first : first + 4],
            arms.q_min[first : first + 4], arms.q_max[first : first + 4], q, reached,
        )  # fmt: skip
        if status == REACHED or not smooth:
            break
    if smooth:
        arms.saturated[h] = 0.0
    if status != REACHED:
        arms.saturated[h] = 1.0
        for a in range(3):
            reached[a] -= p_A[a]
        mat_vec(arms.R_BA, reached, vec)
        mat_vec(b.est.R_WB, vec, p_W)
        for a in range(3):
            arms.p_ref[h, a] += p_W[a]
    for i in range(4):
        j = first + i
        if smooth:
            follow_profile(arms, j, q[i])
            hold_joint(b, j, arms.q_goal[j], True)
        else:
            hold_joint(b, j, q[i], False)
            arms.w_goal[j] = 0.0


@njit(cache=True, error_model="numpy")
def _lead(b: Record, h: int, p_B: Any, lead: Any) -> None:
    """Fill `lead` (m, in B): the way of p_ref, seen from the arms' base, in the servos' lag.

    (17) inverted: theta_ref = theta + T_s theta'; with half a period of holding and the profile's.
    """
    arms, est = b.arms, b.est
    v_B, turn, arm, vec = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for a in range(3):
        vec[a] = arms.v_ref[h, a] - est.v_WB[a]
        arm[a] = p_B[a] - arms.p_BA[a]
    mat_t_vec(est.R_WB, vec, v_B)
    cross(est.w_WB_B, p_B, turn)
    for a in range(3):
        v_B[a] -= turn[a]
    if arms.swing >= 0:  # the passive link turns about y of B
        v_B[0] -= est.qd[arms.swing] * arm[2]
        v_B[2] += est.qd[arms.swing] * arm[0]
    time = arms.servo_tau + (0.5 + PROFILE_LAG) * arms.dt
    length = time * math.sqrt(v_B[0] ** 2 + v_B[1] ** 2 + v_B[2] ** 2)
    share = min(1.0, LEAD_MAX / length) if length > 0.0 else 0.0
    for a in range(3):
        lead[a] = share * time * v_B[a]
