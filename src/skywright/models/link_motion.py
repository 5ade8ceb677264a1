"""Motion of the links and its joint torques: recursive Newton-Euler on the link tree.

All quantities are expressed in the axes of B; accelerations are inertial. (Featherstone, Rigid Body
Dynamics Algorithms, 2008, section 5.3, in its classical form.) A test compares with MuJoCo's
inverse dynamics.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_JOINTS
from skywright.core.user_code import njit
from skywright.models.body_records import MAX_LINKS, BodyModel, Kinematics
from skywright.models.rigid_body import compute_kinematics


class Motion(NamedTuple):
    """Inertial motion of the link frames' origins, in the axes of B (scratch)."""

    w: Array  # (MAX_LINKS, 3)
    wd: Array
    a: Array


def build_motion() -> Motion:
    """Return scratch space."""
    return Motion(np.zeros((MAX_LINKS, 3)), np.zeros((MAX_LINKS, 3)), np.zeros((MAX_LINKS, 3)))


@njit(cache=True)
def fill_motion(
    m: BodyModel,
    k: Kinematics,
    w_B: Array,
    wd_B: Array,
    a_B: Array,
    qd: Array,
    qdd: Array,
    out: Motion,
) -> None:
    """Fill angular velocity, angular and linear acceleration of every link frame.

    w_B, wd_B (3,) rad/s, rad/s^2 and a_B (3,) m/s^2 of the platform, all in the axes of B; `k`
    contains the kinematics at the same joints.
    """
    r = local(3)
    c1 = local(3)
    c2 = local(3)
    axis = local(3)
    for i in range(m.n_links):
        parent = m.parent[i]
        if parent < 0:
            wp, wdp, ap = w_B, wd_B, a_B
            for j in range(3):
                r[j] = k.p[i, j]
        else:
            wp, wdp, ap = out.w[parent], out.wd[parent], out.a[parent]
            for j in range(3):
                r[j] = k.p[i, j] - k.p[parent, j]
        cross(wp, r, c1)
        cross(wp, c1, c2)
        cross(wdp, r, c1)
        for j in range(3):
            out.a[i, j] = ap[j] + c1[j] + c2[j]
            out.w[i, j] = wp[j]
            out.wd[i, j] = wdp[j]
        joint = m.joint[i]
        if joint >= 0:
            for j in range(3):
                axis[j] = k.R[i, j, m.axis[i]]
            cross(wp, axis, c1)
            if m.slide[i]:
                for j in range(3):
                    out.a[i, j] += 2.0 * qd[joint] * c1[j] + qdd[joint] * axis[j]
            else:
                for j in range(3):
                    out.w[i, j] += qd[joint] * axis[j]
                    out.wd[i, j] += qdd[joint] * axis[j] + qd[joint] * c1[j]


@njit(cache=True)
def fill_joint_torque(
    m: BodyModel, k: Kinematics, motion: Motion, g_B: Array, f_tip_B: Array, torque: Array
) -> None:
    """Fill torque (MAX_JOINTS,) N m (slides: N) that produces `motion`: the joints' inverse
    dynamics.

    `motion` comes from `fill_motion`, so mass matrix, Coriolis and centrifugal terms and the
    platform's motion are included. g_B (3,) m/s^2 is gravity, f_tip_B (3,) N the force on the robot
    at the tip, both in B. The servos' rotors are not included.
    """
    c, c1, c2 = local(3), local(3), local(3)
    f, t, h, turn = local(3), local(3), local(3), local(3)
    for j in range(MAX_JOINTS):
        torque[j] = 0.0
        for a in range(3):
            torque[j] -= k.J_BT[a, j] * f_tip_B[a]
    for n in range(m.n_links):
        w, wd = motion.w[n], motion.wd[n]
        mat_vec(k.R[n], m.com[n], c)
        cross(w, c, c1)
        cross(w, c1, c2)
        cross(wd, c, c1)
        for a in range(3):
            f[a] = m.mass[n] * (motion.a[n, a] + c1[a] + c2[a] - g_B[a])
            c[a] += k.p[n, a]
        # about the link's centre: R I R^T w' + w x R I R^T w
        mat_t_vec(k.R[n], w, c1)
        mat_vec(m.inertia[n], c1, c2)
        mat_vec(k.R[n], c2, h)
        cross(w, h, t)
        mat_t_vec(k.R[n], wd, c1)
        mat_vec(m.inertia[n], c1, c2)
        mat_vec(k.R[n], c2, h)
        i = n
        while i >= 0:
            joint = m.joint[i]
            if joint >= 0:
                for a in range(3):
                    c1[a] = c[a] - k.p[i, a]
                cross(c1, f, turn)
                for a in range(3):
                    along = f[a] if m.slide[i] else turn[a] + t[a] + h[a]
                    torque[joint] += k.R[i, a, m.axis[i]] * along
            i = m.parent[i]


def compute_joint_inertia(model: NDArray[Any], q: Array) -> Array:
    """Return the mass matrix (n, n) of the joints at q (n,), platform held, without servo rotors.

    `model` is a (1,) array of `BodyModel`.
    """
    k, motion, zero, n = compute_kinematics(model, q), build_motion(), np.zeros(3), len(q)
    out, torque = np.empty((n, n)), np.empty(MAX_JOINTS)
    for j in range(n):
        unit = np.zeros(MAX_JOINTS)
        unit[j] = 1.0
        fill_motion(model[0], k, zero, zero, zero, np.zeros(MAX_JOINTS), unit, motion)
        fill_joint_torque(model[0], k, motion, zero, zero, torque)
        out[:, j] = torque[:n]
    return out
