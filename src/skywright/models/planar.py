"""The planar model of Caballero et al. 2018, section II-B, equation (3), of a robot's scene.

Generalised coordinates q = (q1, q3, q5, q0, q7R, q8R, q7L, q8L): position of the platform's centre
of mass along n1 (x) and n3 (z), its pitch, the passive joint, and shoulder and elbow of the right
and left arm; all rotations about n2 (y), zero with everything hanging. Speeds u = dq/dt (2).

    du/dt = A f + B squares + C products + D g

with f = (F3, T2, T7R, T8R, T7L, T8L), the squares of (u5, u0, u7R, u8R, u7L, u8L), and the
products u5 u0, u5 u7R, u5 u8R, u5 u7L, u5 u8L, u0 u7R, u0 u8R, u0 u7L, u0 u8L, u7R u8R, u7L u8L
(those of different arms do not occur). The paper's text prints only fragments of (3). Here it
follows from the chain: a link that hangs at the angle phi points along e = -(sin phi, cos phi), and
each centre of mass is a sum of lengths times such vectors. A test holds it against the spatial
model.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_from_quat
from skywright.core.user_code import njit
from skywright.description.robot.limbs import list_joints, list_limbs
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.scene import Scene

TURNS = np.array([
    [1, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0], [1, 1, 1, 0, 0, 0],
    [1, 1, 1, 1, 0, 0], [1, 1, 0, 0, 1, 0], [1, 1, 0, 0, 1, 1],
])  # fmt: skip
"""Whether (q5, q0, q7R, q8R, q7L, q8L) rotate platform, link, and each upper arm and forearm."""
PAIRS = np.array([[0, 1], [0, 2], [0, 3], [0, 4], [0, 5], [1, 2], [1, 3], [1, 4], [1, 5], [2, 3],
                  [4, 5]])  # fmt: skip
"""Pairs of those angles whose rates occur as products."""


class PlanarLrm(NamedTuple):
    """Masses (kg), inertias about the centres of mass (kg m^2) and lengths (m).

    a platform, b long link, u upper arm, f forearm with hand; `d` is the distance from the
    platform's centre of mass down to the passive joint, `l_` the length of a link, `c_` from its
    joint to its centre of mass. Both arms are equal.
    """

    m_a: float
    m_b: float
    m_u: float
    m_f: float
    i_a: float
    i_b: float
    i_u: float
    i_f: float
    d: float
    l_b: float
    c_b: float
    l_u: float
    c_u: float
    c_f: float


def build_planar_lrm(scene: Scene, robot: Robot) -> PlanarLrm:
    """Read the planar model's parameters.

    Raises InputError unless the robot is a platform with a passive link and two arms of two pitch
    joints, with joints and centres of mass on lines along z.
    """
    joints = list_joints(robot)
    shape = [(j.side, j.link.axis, j.link.passive) for j in joints]
    shape *= not any(limb.link.is_turned for limb in list_limbs(robot))
    arm = [(0, "y", False)] * 2 + [(1, "y", False)] * 2
    if shape != [(-1, "y", True), *arm]:
        raise InputError(
            f"robot {robot.name!r}: the planar model requires a passive pitch joint and "
            "two arms of two pitch joints; found: "
            f"{', '.join(j.name for j in joints) or 'no joints'}"
        )
    model = scene.model
    m_a, c_a, i_a = _composite(model, "platform")
    m_b, c_b, i_b = _composite(model, joints[0].name)
    m_u, c_u, i_u = _composite(model, joints[1].name)
    m_f, c_f, i_f = _composite(model, joints[2].name)
    names = ["platform", *(joint.name for joint in joints[:3])]
    hinge, upper, fore = (_place(model, *names[i : i + 2]) for i in (0, 1, 2))
    for c in (c_a, c_b, c_u, c_f, hinge - c_a, upper, fore):
        if abs(c[0]) > 1e-9:
            raise InputError(
                f"robot {robot.name!r}: the planar model requires joints and centres of "
                "mass on lines along z; set com_x_m and x_m to 0"
            )
    return PlanarLrm(
        m_a, m_b, m_u, m_f, i_a, i_b, i_u, i_f, float(c_a[2] - hinge[2]), float(-upper[2]),
        float(-c_b[2]), float(-fore[2]), float(-c_u[2]), float(-c_f[2]),
    )  # fmt: skip


def _place(model: mujoco.MjModel, base: str, name: str) -> Array:
    """Return the position (3,) m of a body in the frame of `base`; fixed links between them have
    the same axes."""
    p, body = np.zeros(3), model.body(name).id
    while body != model.body(base).id:
        p += model.body_pos[body]
        body = model.body_parentid[body]
    return p


def _composite(model: mujoco.MjModel, name: str) -> tuple[float, Array, float]:
    """Return mass, centre of mass (3,) and inertia about y of a body with the parts fixed to it."""
    root = model.body(name).id
    parts: list[tuple[float, Array, float]] = []
    pending = [(root, np.zeros(3), np.eye(3))]
    while pending:
        body, p, rot = pending.pop()
        turn = rot @ rot_from_quat(model.body_iquat[body])
        inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
        mass = float(model.body_mass[body])
        parts.append((mass, p + rot @ model.body_ipos[body], float(inertia[1, 1])))
        for child in range(model.nbody):
            if (
                model.body_parentid[child] == body
                and child != body
                and not model.body_jntnum[child]
            ):
                q = rot_from_quat(model.body_quat[child])
                pending.append((child, p + rot @ model.body_pos[child], rot @ q))
    mass = sum(m for m, _, _ in parts)
    com = sum((m * c for m, c, _ in parts), np.zeros(3)) / mass
    about = sum(i + m * float((c - com)[0] ** 2 + (c - com)[2] ** 2) for m, c, i in parts)
    return mass, com, about


@njit(cache=True, error_model="numpy")
def fill_equations(p: PlanarLrm, q: Array, M: Array, rhs: Array) -> None:
    """Fill M (8, 8) and the matrix (8, 24) that multiplies (f, squares, products, g)."""
    mass = (p.m_a, p.m_b, p.m_u, p.m_f, p.m_u, p.m_f)
    inertia = (p.i_a, p.i_b, p.i_u, p.i_f, p.i_u, p.i_f)
    lengths = np.zeros((6, 6))  # of each part between the origin and each centre of mass
    lengths[1:, 0], lengths[1, 1], lengths[2:, 1] = p.d, p.c_b, p.l_b
    for arm in (2, 4):
        lengths[arm, arm], lengths[arm + 1, arm], lengths[arm + 1, arm + 1] = p.c_u, p.l_u, p.c_f
    M[:], rhs[:] = 0.0, 0.0
    for body in range(6):
        m, J, curve = mass[body], np.zeros((2, 8)), np.zeros((2, 6, 6))  # dp/dq, d2p/dq2
        J[0, 0] = J[1, 1] = 1.0
        for part in range(body + 1):
            angle = 0.0
            for i in range(6):
                angle += TURNS[part, i] * q[2 + i]
            x, z = lengths[body, part] * math.sin(angle), lengths[body, part] * math.cos(angle)
            for i in range(6):
                J[0, 2 + i] -= TURNS[part, i] * z
                J[1, 2 + i] += TURNS[part, i] * x
                for j in range(6):
                    curve[0, i, j] += TURNS[part, i] * TURNS[part, j] * x
                    curve[1, i, j] += TURNS[part, i] * TURNS[part, j] * z
        for i in range(8):
            for j in range(8):
                M[i, j] += m * (J[0, i] * J[0, j] + J[1, i] * J[1, j])
                if i > 1 and j > 1:
                    M[i, j] += inertia[body] * TURNS[body, i - 2] * TURNS[body, j - 2]
            for k in range(6):
                rhs[i, 6 + k] -= m * (J[0, i] * curve[0, k, k] + J[1, i] * curve[1, k, k])
            for n, (j, k) in enumerate(PAIRS):
                rhs[i, 12 + n] -= 2.0 * m * (J[0, i] * curve[0, j, k] + J[1, i] * curve[1, j, k])
            rhs[i, 23] -= m * J[1, i]
    rhs[0, 0], rhs[1, 0], rhs[2, 1] = math.sin(q[2]), math.cos(q[2]), 1.0
    for i in range(4):
        rhs[4 + i, 2 + i] = 1.0


@njit(cache=True, error_model="numpy")
def fill_terms(u: Array, f: Array, g: float, s: Array) -> None:
    """Fill s (24,) with (f, squares, products, g), the factors of the right-hand side."""
    s[:6], s[23] = f, g
    s[6:12] = u[2:] * u[2:]
    for n, (i, j) in enumerate(PAIRS):
        s[12 + n] = u[2 + i] * u[2 + j]
