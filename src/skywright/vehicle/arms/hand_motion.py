"""Motion of a hand: straight lines, velocities, and from the hand to the joints.

Suarez 2020, (23), (24) and (7). The hand's reference p_ref lives in W, so that the arm makes up
for what the platform and the passive link do. The paper steps from the measured hand; with the
servos' lag (17) it would then move at v T / T_s. Here the step is taken from the last reference,
which moves at v, and the servos are led by their lag.
"""

from __future__ import annotations

import math
from typing import Any

from skywright.core.rotations import cross, mat_t_vec, mat_vec, norm
from skywright.core.scratch import local
from skywright.models.arm_inverse_kinematics import REACHED, solve_arm
from skywright.models.arm_nearest import arm_point
from skywright.vehicle.arms.joint_loops import hold_joint
from skywright.vehicle.arms.servo_profile import PROFILE_LAG, follow_profile
from skywright.vehicle.arms.view import ArmsView
from skywright.vehicle.component import helper

SIGHT = 0.5  # s without a sample after which a marker counts as out of sight
LEAD_MAX = 0.05  # m, by which the servos' lag may be made up for


@helper
def start_hand(v: ArmsView, h: int) -> None:
    """Start a task at the hand's commanded position, so that nothing jumps."""
    first = v.arm.first[h]
    p_A = local(3)
    arm_point(v.arm.upper, v.arm.fore, v.state.q_goal[first : first + 4], p_A)
    _from_base(v, h, p_A, v.state.p_ref[h])
    for a in range(3):
        v.state.v_ref[h, a] = 0.0
    for j in range(first, first + v.arm.n):
        v.me.w_goal[j] = 0.0


@helper
def _from_base(v: ArmsView, h: int, p_A: Any, p_W: Any) -> None:
    """Fill p_W with a point given from the shoulder of arm h in A."""
    vec, p_B = local(3), local(3)
    for a in range(3):
        vec[a] = v.arm.p_BS[h, a] + p_A[a]
    mat_vec(v.hands.R_BA, vec, p_B)
    for a in range(3):
        p_B[a] += v.hands.p_BA[a]
    mat_vec(v.est.R_WB, p_B, p_W)
    for a in range(3):
        p_W[a] += v.est.p_WB[a]


@helper
def step_position(v: ArmsView, h: int, dr: Any) -> None:
    """Fill dr (3,) m with the step of (23): v T e / |e|, at most |e|."""
    e = local(3)
    for a in range(3):
        e[a] = v.tasks.p_WH[h, a] - v.state.p_ref[h, a]
    speed = norm(v.tasks.v_WH[h])
    step = min((speed if speed > 0.0 else v.state.speed_hand) * v.arm.dt, norm(e))
    length = max(norm(e), 1e-12)
    for a in range(3):
        dr[a] = step * e[a] / length


@helper
def step_to_marker(v: ArmsView, h: int, dr: Any) -> None:
    """Fill dr (3,) m: (23) towards v.tasks.p_WH in the marker's frame, while it is seen."""
    e = local(3)
    mat_vec(v.marker.R_WO, v.tasks.p_WH[h], e)
    for a in range(3):
        e[a] += v.marker.p_WO[a] - v.state.p_ref[h, a]
    speed = norm(v.tasks.v_WH[h])
    step = min((speed if speed > 0.0 else v.state.speed_hand) * v.arm.dt, norm(e))
    step = step if v.marker.age < SIGHT else 0.0
    length = max(norm(e), 1e-12)
    for a in range(3):
        dr[a] = step * e[a] / length


@helper
def step_velocity(v: ArmsView, h: int, dr: Any) -> None:
    """Fill dr (3,) m with the step of (24): v_max T [dx, dy, dz], here v_WH T within speed_hand."""
    speed = norm(v.tasks.v_WH[h])
    share = min(1.0, v.state.speed_hand / speed) if speed > 0.0 else 0.0
    for a in range(3):
        dr[a] = share * v.tasks.v_WH[h, a] * v.arm.dt


@helper
def move_hand(v: ArmsView, h: int, dr: Any, smooth: bool) -> None:
    """Step p_ref by dr (3,) m in W and command the joints that bring the hand there: (7), dr_G.

    The deflection under the arm's weight, dr_G of (23), is made up for joint by joint
    (`hold_joint`). `smooth` sends the angles through the servos' profiles and leads their lag.
    Where the arm does not reach, p_ref stays at the nearest point that it does: no windup.
    """
    first = v.arm.first[h]
    p_W, p_B, p_A, vec = local(3), local(3), local(3), local(3)
    for a in range(3):
        v.state.p_ref[h, a] += dr[a]
        v.state.v_ref[h, a] = dr[a] / v.arm.dt
        vec[a] = v.state.p_ref[h, a] - v.est.p_WB[a]
    mat_t_vec(v.est.R_WB, vec, p_B)
    lead = local(3)
    lead[:] = 0.0
    if smooth:
        _lead(v, h, p_B, lead)
    q, reached, status = local(4), local(3), -1
    for attempt in range(2):
        if attempt == 1:  # a lead that ends out of reach is no reason to give p_ref up
            lead[:] = 0.0
        for a in range(3):
            vec[a] = p_B[a] + lead[a] - v.hands.p_BA[a]
        mat_t_vec(v.hands.R_BA, vec, p_A)
        for a in range(3):
            p_A[a] -= v.arm.p_BS[h, a]
        status = solve_arm(
            v.arm.upper, v.arm.fore, p_A, v.ref.q[first + 1], v.state.q_goal[first : first + 4],
            v.arm.q_min[first : first + 4], v.arm.q_max[first : first + 4], q, reached,
        )  # fmt: skip
        if status == REACHED or not smooth:
            break
    if smooth:
        v.state.saturated[h] = 0.0
    if status != REACHED:
        v.state.saturated[h] = 1.0
        for a in range(3):
            reached[a] -= p_A[a]
        mat_vec(v.hands.R_BA, reached, vec)
        mat_vec(v.est.R_WB, vec, p_W)
        for a in range(3):
            v.state.p_ref[h, a] += p_W[a]
    for i in range(4):
        j = first + i
        if smooth:
            follow_profile(v, j, q[i])
            hold_joint(v, j, v.state.q_goal[j], True)
        else:
            hold_joint(v, j, q[i], False)
            v.me.w_goal[j] = 0.0


@helper
def _lead(v: ArmsView, h: int, p_B: Any, lead: Any) -> None:
    """Fill `lead` (m, in B): the way of p_ref, seen from the arms' base, in the servos' lag.

    (17) inverted: theta_ref = theta + T_s theta'; with half a period of holding and the profile's.
    """
    v_B, turn, arm, vec = local(3), local(3), local(3), local(3)
    for a in range(3):
        vec[a] = v.state.v_ref[h, a] - v.est.v_WB[a]
        arm[a] = p_B[a] - v.hands.p_BA[a]
    mat_t_vec(v.est.R_WB, vec, v_B)
    cross(v.est.w_WB_B, p_B, turn)
    for a in range(3):
        v_B[a] -= turn[a]
    if v.arm.swing >= 0:  # the passive link turns about y of B
        v_B[0] -= v.est.qd[v.arm.swing] * arm[2]
        v_B[2] += v.est.qd[v.arm.swing] * arm[0]
    time = v.arm.servo_tau + (0.5 + PROFILE_LAG) * v.arm.dt
    length = time * math.sqrt(v_B[0] ** 2 + v_B[1] ** 2 + v_B[2] ** 2)
    share = min(1.0, LEAD_MAX / length) if length > 0.0 else 0.0
    for a in range(3):
        lead[a] = share * time * v_B[a]
