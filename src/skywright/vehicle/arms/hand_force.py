"""Force control of a hand through its joint springs, and combined force and position control.

Suarez 2020, figure 17: the force error moves the hand's reference so that the springs stretch until
the force is reached. The compliance of the arm C = J K^-1 J^T converts newtons into metres (it is
the inverse of K_C of (27) and exists at a singularity, where K_C does not): dr_F = C n e. The joint
displacements that give dr_F are the spring deflections under the force, dtheta = K^-1 J^T n e.
`ArmsMemory.wind` holds them: the shafts wind the springs while the links do not move. The published
method through the inverse kinematics moves the hand by the same distance. At a fixed shoulder roll,
however, other joints compensate for the deflection of the roll spring and the arm drifts: a squeeze
of 4 N turned the yaw by 70 deg.

While an object holds the hand, the force follows the shafts: the loop is an integral of w e in
series with the servo lag. For position, a free hand oscillates on its springs, and an integral loop
around it is stable only below 2 zeta w_n (laws/compliant.py defines both bandwidths).
"""

from __future__ import annotations

import math
from typing import Any

from skywright.core.rotations import dot, mat_t_vec, norm
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS
from skywright.models.springs import spring_deflection, spring_stiffness
from skywright.vehicle.arms.view import ArmsView
from skywright.vehicle.component import helper

TOUCH = 0.3  # N, below which the hand counts as free
TOUCH_SPEED = 0.04  # m/s, limit of a free hand before contact: gives about 0.5 N at contact
LET_OUT = 0.3  # s, time constant of the release of a wound spring when another task begins


@helper
def wind_for(v: ArmsView, h: int, f_W: Any, out: Any) -> float:
    """Fill out (MAX_JOINTS,) rad with K^-1 J^T f_W, f_W (3,) N; returns |C f_W| (m).

    Only joints with a measured deflection contribute. Otherwise the noise of a force that only
    pitch joints measure would make the hand drift sideways.
    """
    f_B, c_B = local(3), local(3)
    c_B[:] = 0.0
    mat_t_vec(v.est.R_WB, f_W, f_B)
    for j in range(v.arm.first[h], v.arm.first[h] + v.arm.n):
        out[j] = 0.0
        if v.arm.k[j] == 0.0 or v.arm.sensed[j] == 0.0:
            continue
        k = spring_stiffness(
            v.arm.k[j], v.arm.linear[j], v.arm.hardening[j], v.joints.deflection[j]
        )
        for a in range(3):
            out[j] += v.hands.J_BP[h, a, j] * f_B[a] / k
        for a in range(3):
            c_B[a] += v.hands.J_BP[h, a, j] * out[j]
    return norm(c_B)


@helper
def step_force(v: ArmsView, h: int, f_ref: Any, gamma: float, along: bool) -> None:
    """Wind the springs of hand h by gamma w T K^-1 J^T (f_ref - f).

    `along`: control only the component of the error along f_ref. The transverse force remains, as
    required for a held object with a weight. Otherwise the transverse force is controlled to zero:
    without this an arm at the end of a swinging link drifts until the hand slips. The "cartesian"
    estimator reads the arm's weight as a transverse force, so with it `along` always applies.

    The speed of the hand is limited to speed_hand, before contact to TOUCH_SPEED. A spring is wound
    at most to the servo's stall torque, and a shaft leads the limits of its link by at most the
    spring's deflection. Beyond these limits the integral stops (anti-windup).
    """
    error, share = local(3), local(MAX_JOINTS)
    size = norm(f_ref)
    felt = dot(f_ref, v.force.f_WH[h]) / size if size > 0.0 else 0.0
    for a in range(3):
        if along or v.force.across < 0.5:
            error[a] = (size - felt) * f_ref[a] / size if size > 0.0 else 0.0
        else:
            error[a] = f_ref[a] - v.force.f_WH[h, a]
    gain = gamma * v.me.ki_force * v.arm.dt
    speed = v.state.speed_hand if felt > TOUCH else min(TOUCH_SPEED, v.state.speed_hand)
    length, most = gain * wind_for(v, h, error, share), speed * v.arm.dt
    if length > most:
        gain *= most / length
    for j in range(v.arm.first[h], v.arm.first[h] + v.arm.n):
        if v.arm.k[j] == 0.0:
            continue
        deflection, led = v.joints.deflection[j], v.cmd.theta[j] - v.me.wind[j]
        most = spring_deflection(v.arm.k[j], v.arm.linear[j], v.arm.hardening[j], v.arm.stall[j])
        lowest = max(-most, v.arm.q_min[j] + min(deflection, 0.0) - led)
        highest = min(most, v.arm.q_max[j] + max(deflection, 0.0) - led)
        now, wanted = v.me.wind[j], v.me.wind[j] + gain * share[j]
        v.me.wind[j] = min(max(wanted, min(lowest, now)), max(highest, now))
        if v.me.wind[j] != wanted:
            v.state.saturated[h] = 1.0


@helper
def let_out(v: ArmsView, h: int) -> None:
    """Release the wound springs of hand h, in a task that commands no force."""
    share = math.exp(-v.arm.dt / LET_OUT)
    for j in range(v.arm.first[h], v.arm.first[h] + v.arm.n):
        v.me.wind[j] *= share


@helper
def step_hold_position(v: ArmsView, h: int, gamma: float, dr: Any) -> None:
    """Fill dr (3,) m with the position part of (31): (1 - gamma) w T (p_WH - p) + v_WH T.

    The goal's velocity v_WH is fed forward, so that a held object moves as fast as the goal. The
    slow loop corrects only the deflection of the springs under the object's weight.
    """
    for a in range(3):
        e = v.tasks.p_WH[h, a] - v.hands.p_WH[h, a]
        dr[a] = ((1.0 - gamma) * v.me.ki_hold * e + v.tasks.v_WH[h, a]) * v.arm.dt
    length, most = norm(dr), v.state.speed_hand * v.arm.dt
    if length > most:
        for a in range(3):
            dr[a] *= most / length


@helper
def squeeze_force(v: ArmsView, h: int, f_ref: Any) -> None:
    """Fill f_ref (3,) N with (32): F (-1)^i (r1 - r2) / |r1 - r2|; F = |f_WH|, i = h + 1."""
    for a in range(3):
        f_ref[a] = v.hands.p_WH[0, a] - v.hands.p_WH[1, a]
    size = norm(v.tasks.f_WH[h]) / max(norm(f_ref), 1e-9)
    sign = -1.0 if h == 0 else 1.0
    for a in range(3):
        f_ref[a] *= sign * size
