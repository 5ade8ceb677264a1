"""Response of a platform to force and torque while a joint without a servo swings freely.

Generalised velocity (v_B, w_B, q') in B with the mass matrix M. The rotors' torque controls w; x =
(v_B, q') follows from the dynamics. Eliminating x,

    t = I_eff w' + h_w - u_w - A (h_x - u_x),   A = M_wx M_xx^-1,   I_eff = M_ww - A M_xw,

with the gravity forces h and all other forces u. Without such a joint I_eff is the inertia about
the centre of mass and A (h_x - u_x) the moment of the rotors' force, as for any rigid body. With a
link that swings about y, I_eff is the composite inertia in roll and that of the bare platform in
pitch.
"""

from typing import Annotated, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper
from skywright.core.record import Array, Mat3, Record, Vec3
from skywright.core.rotations import cross, mat_vec
from skywright.core.scratch import local
from skywright.core.user_code import njit
from skywright.description.robot.limbs import list_joints
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.arm_body import Deviation
from skywright.models.body_records import MAX_LINKS, Body, BodyModel, Kinematics
from skywright.models.rigid_body import compute_kinematics, fill_body
from skywright.models.scene import build_scene


class FloatingInertia(Record):
    """Effective inertia and coupling terms of the platform while a joint swings freely, in B."""

    swing: int  # index in q of the joint without a servo, -1: none
    axis: Vec3  # of that joint
    I_eff: Mat3  # kg m^2, torque over angular acceleration
    A: Annotated[Array, 3, 4]  # N m per N of force at B and per N m about the joint
    L_s: Vec3  # kg m, momentum of a unit rate of the joint
    M_ws: Vec3  # kg m^2, its angular momentum about the origin of B
    M_ss: float  # kg m^2, inertia about the joint of the swinging part


@njit(cache=True, error_model="numpy")
def fill_floating(m: BodyModel, k: Kinematics, body: Body, w: FloatingInertia) -> None:
    """Fill I_eff, A, L_s, M_ws, M_ss and axis of `w`.

    `k` and `body` come from `fill_kinematics` and `fill_body` at the same joints.
    """
    mass, c = body.mass, body.p_BC
    _fill_swing(m, k, w)
    y, col = local(3), local(3)
    d = 1.0
    if w.swing >= 0:
        d = w.M_ss
        for a in range(3):
            d -= w.L_s[a] * w.L_s[a] / mass
    for r in range(3):
        # row r of M_w,v = m [c]x
        for a in range(3):
            y[a] = 0.0
        y[(r + 1) % 3] = -mass * c[(r + 2) % 3]
        y[(r + 2) % 3] = mass * c[(r + 1) % 3]
        s = 0.0
        if w.swing >= 0:
            s = w.M_ws[r]
            for a in range(3):
                s -= y[a] * w.L_s[a] / mass
            s /= d
        for a in range(3):
            w.A[r, a] = (y[a] - s * w.L_s[a]) / mass
        w.A[r, 3] = s
    for r in range(3):
        for a in range(3):
            col[a] = w.A[r, a]
        # A M_xw = m A_v [c]x^T + A_s M_ws^T
        cross(c, col, y)
        for a in range(3):
            w.I_eff[r, a] = body.I_B[r, a] - mass * y[a] - w.A[r, 3] * w.M_ws[a]


@helper
def _fill_swing(m: BodyModel, k: Kinematics, w: FloatingInertia) -> None:
    """Inertial coupling of joint `w.swing` with the platform, summed over the links it moves."""
    for a in range(3):
        w.L_s[a], w.M_ws[a], w.axis[a] = 0.0, 0.0, 0.0
    w.M_ss = 0.0
    if w.swing < 0:
        return
    carried = local(MAX_LINKS)
    c, rate, moment, pivot = local(3), local(3), local(3), local(3)
    for i in range(m.n_links):
        carried[i] = 0.0
        if m.joint[i] == w.swing:
            carried[i] = 1.0
            for a in range(3):
                w.axis[a] = k.R[i, a, m.axis[i]]
                pivot[a] = k.p[i, a]
        elif m.parent[i] >= 0:
            carried[i] = carried[m.parent[i]]
        if carried[i] == 0.0:
            continue
        mat_vec(k.R[i], m.com[i], c)
        for a in range(3):
            c[a] += k.p[i, a] - pivot[a]
        cross(w.axis, c, rate)  # velocity of the link's centre at a unit rate
        for a in range(3):
            c[a] += pivot[a]
            w.L_s[a] += m.mass[i] * rate[a]
        cross(c, rate, moment)
        for a in range(3):
            turn = 0.0  # R I R^T axis
            for n in range(3):
                along = 0.0
                for e in range(3):
                    for f in range(3):
                        along += m.inertia[i, n, e] * k.R[i, f, e] * w.axis[f]
                turn += k.R[i, a, n] * along
            w.M_ws[a] += m.mass[i] * moment[a] + turn
            w.M_ss += m.mass[i] * rate[a] * rate[a] + turn * w.axis[a]


def compute_floating(model: NDArray[Any], q: Array, swing: int = -1) -> tuple[Any, Any]:
    """Return both records at joints q (n,); `swing`: index of the free joint."""
    k, body = compute_kinematics(model, q), np.zeros(1, Body.dtype)
    floating = np.zeros(1, FloatingInertia.dtype)
    floating[0]["swing"] = swing
    fill_body(model[0], k, body[0])
    fill_floating(model[0], k, body[0], floating[0])
    return body[0], floating[0]


def compute_free_inertia(robot: Robot, world: World, q: Array) -> Array:
    """Return (3,) kg m^2: effective inertia about the axes of B above all resonance frequencies.

    Joints with a spring, bending links and joints without a servo are free; the rest of the robot
    is rigid. The effective inertia for a fast loop is between this and `I_eff`.
    """
    scene = build_scene(robot, world, Deviation())
    model = scene.model
    data = mujoco.MjData(model)
    data.qpos[:7] = [0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0]
    data.qpos[scene.places.joint_qpos] = q
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    loose = {limb.name for limb in list_joints(robot) if limb.servo < 0}
    free = [0, 1, 2]
    for i in range(model.njnt):
        name = model.joint(i).name
        if name.endswith((" flex", " lateral")) or name in loose:
            free.append(int(model.jnt_dofadr[i]))
    turn = [3, 4, 5]
    coupling = M[np.ix_(turn, free)]
    inertia = M[np.ix_(turn, turn)] - coupling @ np.linalg.solve(M[np.ix_(free, free)], coupling.T)
    return np.asarray(np.diag(inertia))
