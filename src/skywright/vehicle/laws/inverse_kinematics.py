"""Inverse-kinematics feedback: the joints of the arm correct the measured position of the tip.

This is the standard control of a redundant manipulator (Siciliano, Robotics, 2009, section 3.7.1):
joint velocities qd = qd^n + J^+ K e_E with the tip error e_E. Tognon et al. 2018, section V, tested
it and rejected it: the feedback acts across the elasticity of the arm, and the tip vibrates.
The platform tracks its own nominal pose. In contact only the error along the surface is fed back,
because the joint velocity integrates and the intended penetration would increase the push without
bound.
"""

from __future__ import annotations

from typing import Any

from skywright.core.rotations import mat_t_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Out, helper
from skywright.vehicle.laws._three_loops import ThreeLoops
from skywright.vehicle.loops import arm_velocity, hold_attitude, platform_force, rest, to_body

DAMPING = 0.05
"""m/rad, damping of the pseudo-inverse, small against the reach; bounds it near singularities."""


class InverseKinematics(ThreeLoops):
    """Joint speeds by tip feedback while the tip is tracked, otherwise by law (2); attitude by law
    (3); the platform tracks its nominal position.
    """

    needs_full_actuation = True

    @staticmethod
    def step(
        me: ThreeLoops.Me,
        ref: Reference,
        est: Estimate,
        body: Body,
        allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:
        if ref.track_tip > 0.5:
            for j in range(MAX_JOINTS):
                cmd.qd[j] = ref.qd[j] if j < body.n_joints else 0.0
            tip_feedback(me, ref, est, body, cmd.qd)
            limit_motors(me, body, cmd.qd)
        else:
            arm_velocity(me, ref, est, body, cmd.qd)
        if ref.active < 0.5:
            rest(me, cmd)
            return
        f_W = local(3)
        platform_force(me, ref, est, body, allocated.saturated, f_W)
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)


@helper
def tip_feedback(me: Any, ref: Any, est: Any, body: Any, qd: Any) -> None:
    """qd += J^T (J J^T + d^2 1)^-1 K e_E, all in B, solved through the small joint-side matrix.

    e_E loses its part along z_S while the reference is in contact (`ref.dead_zone` > 0).
    J^T (J J^T + d^2)^-1 = (J^T J + d^2)^-1 J^T; Gauss elimination without pivoting is safe
    because the matrix is positive definite.
    """
    n = body.n_joints
    e_W, e_B = local(3), local(3)
    normal = 0.0
    for i in range(3):
        e_W[i] = me.k_arm * (ref.p_WT[i] - est.p_WT[i])
        normal += ref.R_WS[i, 2] * e_W[i]
    if ref.dead_zone > 0.0:
        for i in range(3):
            e_W[i] -= normal * ref.R_WS[i, 2]
    mat_t_vec(est.R_WB, e_W, e_B)
    a, x = local(MAX_JOINTS, MAX_JOINTS), local(MAX_JOINTS)
    for r in range(n):
        x[r] = 0.0
        for c in range(n):
            a[r, c] = 0.0
        for i in range(3):
            x[r] += body.J_BT[i, r] * e_B[i]
            for c in range(n):
                a[r, c] += body.J_BT[i, r] * body.J_BT[i, c]
        a[r, r] += DAMPING * DAMPING
    for p in range(n):
        for r in range(p + 1, n):
            factor = a[r, p] / a[p, p]
            for c in range(p, n):
                a[r, c] -= factor * a[p, c]
            x[r] -= factor * x[p]
    for r in range(n - 1, -1, -1):
        for c in range(r + 1, n):
            x[r] -= a[r, c] * x[c]
        x[r] /= a[r, r]
        qd[r] += x[r]


@helper
def limit_motors(me: Any, body: Any, qd: Any) -> None:
    """Scale all joint speeds by one factor so that no motor behind the belt exceeds its limit."""
    n = body.n_joints
    scale = 1.0
    for j in range(n):
        v = 0.0
        for i in range(n):
            v += me.belt_inv[j, i] * qd[i]
        if abs(v) > me.motor_speed_max[j]:
            scale = min(scale, me.motor_speed_max[j] / abs(v))
    for i in range(n):
        qd[i] *= scale
