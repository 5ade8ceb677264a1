"""Poses of the robot's bodies at given coordinates, and their velocities along an edge.

The platform stays level. A passive joint is in the static equilibrium of its load.
"""

import math

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import cross, mat_mat, mat_vec
from skywright.core.user_code import njit
from skywright.models.kinematic_tree import HINGE
from skywright.planning.motion.space import (
    JOINT0,
    YAW,
    Scratch,
    ScratchRecord,
    Space,
    SpaceRecord,
)


@helper
def _rodrigues(a: Array, angle: float, out: Array) -> None:
    c, s = math.cos(angle), math.sin(angle)
    k = 1.0 - c
    x, y, z = a[0], a[1], a[2]
    out[0, 0] = c + k * x * x
    out[1, 1] = c + k * y * y
    out[2, 2] = c + k * z * z
    out[0, 1], out[1, 0] = k * x * y - s * z, k * x * y + s * z
    out[0, 2], out[2, 0] = k * x * z + s * y, k * x * z - s * y
    out[1, 2], out[2, 1] = k * y * z - s * x, k * y * z + s * x


@helper
def _copy(a: Array, out: Array) -> None:
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, j]


@helper
def compute_pose(space: SpaceRecord, c: Array, d: Array, pose: ScratchRecord) -> None:
    """Fill `pose` at coordinates c (n,), with the velocities for c' = d (n,)."""
    t = space
    u, du = pose.u, pose.du
    for i in range(space.nu):
        x, dx = space.offset[i], 0.0
        for j in range(space.n):
            m = space.map[i, j]
            if m != 0.0:
                x += m * c[j]
                dx += m * d[j]
        u[i], du[i] = x, dx
    for i in range(3):
        pose.p[0, i], pose.v[0, i] = u[i], du[i]
        pose.w[0, i] = 0.0
        for j in range(3):
            pose.R[0, i, j] = 1.0 if i == j else 0.0
    if u[YAW] != 0.0:
        cy, sy = math.cos(u[YAW]), math.sin(u[YAW])
        pose.R[0, 0, 0], pose.R[0, 1, 1] = cy, cy
        pose.R[0, 0, 1], pose.R[0, 1, 0] = -sy, sy
    pose.w[0, 2] = du[YAW]
    local, turn, a, r, x = pose.local, pose.turn, pose.a3, pose.r3, pose.x3
    for b in range(1, t.nb):
        up = t.parent[b]
        mat_vec(pose.R[up], t.pos[b], r)
        cross(pose.w[up], r, x)
        for i in range(3):
            pose.p[b, i] = pose.p[up, i] + r[i]
            pose.v[b, i] = pose.v[up, i] + x[i]
            pose.w[b, i] = pose.w[up, i]
        mat_mat(pose.R[up], t.rot[b], local)
        j = t.joint[b]
        if j < 0 or b == space.passive:
            _copy(local, pose.R[b])
        elif t.kind[b] == HINGE:
            _rodrigues(t.axis[b], u[JOINT0 + j], turn)
            mat_mat(local, turn, pose.R[b])
            mat_vec(local, t.axis[b], a)
            for i in range(3):
                pose.w[b, i] += du[JOINT0 + j] * a[i]
        else:
            _copy(local, pose.R[b])
            mat_vec(local, t.axis[b], a)
            for i in range(3):
                pose.p[b, i] += u[JOINT0 + j] * a[i]
                r[i] = u[JOINT0 + j] * a[i]
            cross(pose.w[up], r, x)
            for i in range(3):
                pose.v[b, i] += x[i] + du[JOINT0 + j] * a[i]
    if space.passive >= 0:
        _hang(space, pose, a, r, x, local, turn)


@helper
def _hang(
    space: SpaceRecord, pose: ScratchRecord, a: Array, r: Array, x: Array, old: Array, turn: Array
) -> None:
    """Rotate the load of the passive joint into its equilibrium (it was placed at angle 0).

    In equilibrium the centre of mass m lies below the joint: angle = atan2(a . (m x g), m . g),
    with the components of m and gravity g normal to the axis a.
    """
    t, k = space, space.passive
    mat_vec(pose.R[k], t.axis[k], a)
    m0 = m1 = m2 = d0 = d1 = d2 = 0.0
    for b in range(k, t.nb):
        if not _hangs(t, b, k):
            continue
        mat_vec(pose.R[b], t.com[b], r)
        # relative to the joint's body, so that the platform's rotation cancels
        w0 = pose.w[b, 0] - pose.w[k, 0]
        w1 = pose.w[b, 1] - pose.w[k, 1]
        w2 = pose.w[b, 2] - pose.w[k, 2]
        p0, p1, p2 = (
            pose.p[b, 0] - pose.p[k, 0],
            pose.p[b, 1] - pose.p[k, 1],
            pose.p[b, 2] - pose.p[k, 2],
        )
        q0 = pose.w[k, 1] * p2 - pose.w[k, 2] * p1
        q1 = pose.w[k, 2] * p0 - pose.w[k, 0] * p2
        q2 = pose.w[k, 0] * p1 - pose.w[k, 1] * p0
        m = t.mass[b]
        m0 += m * (p0 + r[0])
        m1 += m * (p1 + r[1])
        m2 += m * (p2 + r[2])
        d0 += m * (pose.v[b, 0] - pose.v[k, 0] - q0 + w1 * r[2] - w2 * r[1])
        d1 += m * (pose.v[b, 1] - pose.v[k, 1] - q1 + w2 * r[0] - w0 * r[2])
        d2 += m * (pose.v[b, 2] - pose.v[k, 2] - q2 + w0 * r[1] - w1 * r[0])
    along = m0 * a[0] + m1 * a[1] + m2 * a[2]
    m0, m1, m2 = m0 - along * a[0], m1 - along * a[1], m2 - along * a[2]
    g0, g1, g2 = a[2] * a[0], a[2] * a[1], a[2] * a[2] - 1.0  # -z, normal to the axis
    sine = a[0] * (m1 * g2 - m2 * g1) + a[1] * (m2 * g0 - m0 * g2) + a[2] * (m0 * g1 - m1 * g0)
    angle = math.atan2(sine, m0 * g0 + m1 * g1 + m2 * g2)
    square = m0 * m0 + m1 * m1 + m2 * m2
    rate = (
        -(a[0] * (m1 * d2 - m2 * d1) + a[1] * (m2 * d0 - m0 * d2) + a[2] * (m0 * d1 - m1 * d0))
        / square
    )
    pose.u[JOINT0 + t.joint[k]], pose.du[JOINT0 + t.joint[k]] = angle, rate
    _rodrigues(a, angle, turn)
    px, py, pz = pose.p[k, 0], pose.p[k, 1], pose.p[k, 2]
    vx, vy, vz = pose.v[k, 0], pose.v[k, 1], pose.v[k, 2]
    wx, wy, wz = pose.w[k, 0], pose.w[k, 1], pose.w[k, 2]
    for b in range(k, t.nb):
        if not _hangs(t, b, k):
            continue
        for i in range(3):
            for j in range(3):
                old[i, j] = pose.R[b, i, j]
        mat_mat(turn, old, pose.R[b])
        # position and velocities relative to the joint's body rotate with it
        r[0], r[1], r[2] = pose.p[b, 0] - px, pose.p[b, 1] - py, pose.p[b, 2] - pz
        x[0] = pose.v[b, 0] - vx - (wy * r[2] - wz * r[1])
        x[1] = pose.v[b, 1] - vy - (wz * r[0] - wx * r[2])
        x[2] = pose.v[b, 2] - vz - (wx * r[1] - wy * r[0])
        p = pose.p[b]
        mat_vec(turn, r, p)
        v = pose.v[b]
        mat_vec(turn, x, v)
        r[0], r[1], r[2] = pose.w[b, 0] - wx, pose.w[b, 1] - wy, pose.w[b, 2] - wz
        w = pose.w[b]
        mat_vec(turn, r, w)
        sx, sy, sz = wx + rate * a[0], wy + rate * a[1], wz + rate * a[2]
        q0, q1, q2 = p[0], p[1], p[2]
        v[0] += vx + sy * q2 - sz * q1
        v[1] += vy + sz * q0 - sx * q2
        v[2] += vz + sx * q1 - sy * q0
        w[0] += sx
        w[1] += sy
        w[2] += sz
        p[0] += px
        p[1] += py
        p[2] += pz


@helper
def _hangs(t: SpaceRecord, body: int, joint: int) -> bool:
    while body > joint:
        body = t.parent[body]
    return body == joint


@njit(cache=True, error_model="numpy")
def fill_motion(space: Space, scratch: Scratch, c: Array, cd: Array, u: Array, du: Array) -> None:
    """Fill u and du (m, 4 + nj), platform (x, y, z, yaw) and joints, for rows c and cd (m, n).

    A passive joint is in equilibrium.
    """
    for i in range(c.shape[0]):
        compute_pose(space[0], c[i], cd[i], scratch[0])
        for j in range(u.shape[1]):
            u[i, j], du[i, j] = scratch[0].u[j], scratch[0].du[j]
