"""Wrench and rotor thrusts of a motion: recursive Newton-Euler on the link tree.

All vectors are expressed in the axes of B; accelerations are inertial. (Featherstone, Rigid Body
Dynamics Algorithms, 2008, section 5.3, in its classical form.) A test compares the result with
MuJoCo's inverse dynamics.
"""

from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.compiled import helper
from skywright.core.rotations import cross, mat_t_vec, mat_vec
from skywright.core.user_code import njit
from skywright.models.allocation import Allocator, usable_limit
from skywright.models.body_records import BodyModel, Kinematics
from skywright.models.link_motion import Motion, fill_motion
from skywright.models.rotors import compute_rotor_drag
from skywright.models.wind import compute_body_drag


class Loads(NamedTuple):
    """Rotors with their usable range, and the external loads."""

    B: Array  # (6, n) wrench per thrust
    P: Array  # (n, 6) thrust per wrench
    t_min: Array  # (n,) N
    t_max: Array  # (n,) N, thrust fraction applied
    full: int  # 1 if force and torque are independent
    preload: Array  # (n,) N, of the allocation; the limits exclude it
    position: Array  # (n, 3) m, hubs
    axis: Array  # (n, 3)
    k_f: float
    drag_coefficient: float
    drag_area: Array  # (3,) m^2
    air_density: float
    wind_W: Array  # (3,) m/s, steady wind for which the plan reserves thrust


def build_loads(
    allocator: Allocator,
    position: Array,
    axis: Array,
    drag_coefficient: float,
    thrust_fraction: float = 1.0,
    drag_area: Array | None = None,
    air_density: float = 1.2,
    wind_W: Array | None = None,
) -> Loads:
    """Collect the inputs of `compute_thrusts`; without `wind_W` the air is at rest."""
    return Loads(
        B=allocator.B,
        P=allocator.P,
        t_min=allocator.t_min,
        t_max=usable_limit(allocator, thrust_fraction),
        full=allocator.full,
        preload=allocator.preload,
        position=position,
        axis=axis,
        k_f=allocator.k_f,
        drag_coefficient=drag_coefficient,
        drag_area=np.zeros(3) if drag_area is None else np.asarray(drag_area, dtype=float),
        air_density=air_density,
        wind_W=np.zeros(3) if wind_W is None else np.asarray(wind_W, dtype=float),
    )


@njit(cache=True)
def _add_body(
    mass: float, c: Array, frame: Array, inertia: Array, w: Array, wd: Array, a: Array,
    g_B: Array, f: Array, t: Array,
) -> None:  # fmt: skip
    """Add a body's wrench about B's origin.

    c (3,): com in B; frame: R_B(inertia's axes); w, wd, a: motion of the com.
    """
    force = np.empty(3)
    local = np.empty(3)
    h = np.empty(3)
    hd = np.empty(3)
    tmp = np.empty(3)
    for j in range(3):
        force[j] = mass * (a[j] - g_B[j])
        f[j] += force[j]
    cross(c, force, tmp)
    for j in range(3):
        t[j] += tmp[j]
    mat_t_vec(frame, w, local)
    mat_vec(inertia, local, tmp)
    mat_vec(frame, tmp, h)
    mat_t_vec(frame, wd, local)
    mat_vec(inertia, local, tmp)
    mat_vec(frame, tmp, hd)
    cross(w, h, tmp)
    for j in range(3):
        t[j] += hd[j] + tmp[j]


@njit(cache=True, error_model="numpy")
def compute_wrench(
    m: BodyModel, k: Kinematics, R_WB: Array, w_B: Array, wd_B: Array, a_W: Array, qd: Array,
    qdd: Array, f_tip_W: Array, motion: Motion, f: Array, t: Array,
) -> None:  # fmt: skip
    """Fill force f (3,) N and torque t (3,) N m of the rotors about B's origin, in B.

    f_tip_W (3,) N is the force on the robot at the tip (from a surface: outward).
    """
    g_W = np.zeros(3)
    g_W[2] = -m.gravity
    g_B = np.empty(3)
    a_B = np.empty(3)
    c = np.empty(3)
    a_c = np.empty(3)
    c1 = np.empty(3)
    c2 = np.empty(3)
    mat_t_vec(R_WB, g_W, g_B)
    mat_t_vec(R_WB, a_W, a_B)
    fill_motion(m, k, w_B, wd_B, a_B, qd, qdd, motion)
    # platform, inertia about the origin: m (a_O + wd x c + w x (w x c)) and c x m (a_O - g)
    cross(w_B, m.com0, c1)
    cross(w_B, c1, c2)
    cross(wd_B, m.com0, c1)
    for j in range(3):
        f[j] = m.mass0 * (a_B[j] - g_B[j] + c1[j] + c2[j])
        c[j] = m.mass0 * (a_B[j] - g_B[j])
    cross(m.com0, c, t)
    mat_vec(m.inertia0, w_B, c)
    cross(w_B, c, c1)
    mat_vec(m.inertia0, wd_B, c)
    for j in range(3):
        t[j] += c[j] + c1[j]
    for i in range(m.n_links):
        w, wd = motion.w[i], motion.wd[i]
        mat_vec(k.R[i], m.com[i], c)
        cross(w, c, c1)
        cross(w, c1, c2)
        cross(wd, c, c1)
        for j in range(3):
            a_c[j] = motion.a[i, j] + c1[j] + c2[j]
            c[j] += k.p[i, j]
        _add_body(m.mass[i], c, k.R[i], m.inertia[i], w, wd, a_c, g_B, f, t)
    mat_t_vec(R_WB, f_tip_W, c)
    cross(k.p_BT, c, c1)
    for j in range(3):
        f[j] -= c[j]
        t[j] -= c1[j]


@helper
def _add_wind(loads: Loads, R_WB: Array, v_W: Array, w_B: Array, f: Array, t: Array) -> None:
    """Subtract the drag of the wind allowance at hover rotor speeds from the required wrench."""
    v_air = np.empty(3)
    rel = np.empty(3)
    d = np.empty(3)
    dt = np.empty(3)
    for j in range(3):
        rel[j] = v_W[j] - loads.wind_W[j]
    mat_t_vec(R_WB, rel, v_air)
    compute_body_drag(loads.drag_area, loads.air_density, v_air, d)
    for j in range(3):
        f[j] -= d[j]
    n = loads.P.shape[0]
    lift = max(f[2], 0.0)
    speed = np.empty(n)
    total = 0.0
    for i in range(n):
        total += loads.axis[i, 2]
    for i in range(n):
        # rotors that oppose each other run at the speed of their preload
        lifted = loads.preload[i] if loads.preload[i] > 0.0 else lift / max(total, 1e-6)
        speed[i] = np.sqrt(lifted / loads.k_f)
    compute_rotor_drag(loads.position, loads.axis, speed, loads.drag_coefficient, v_air, w_B, d, dt)
    for j in range(3):
        f[j] -= d[j]
        t[j] -= dt[j]


@helper
def compute_thrusts(
    loads: Loads, R_WB: Array, v_W: Array, w_B: Array, f: Array, t: Array, thrust: Array
) -> tuple[float, int]:
    """Fill the thrusts (n,) N of the required wrench plus wind drag; return (margin, rotor).

    margin is the distance of the worst rotor from its nearer limit as a fraction of the usable
    range, negative outside (minus infinity for a NaN thrust). Robots without independent lateral
    force tilt to produce it: their thrust along z_B equals the magnitude of the whole force.
    """
    _add_wind(loads, R_WB, v_W, w_B, f, t)
    n = thrust.shape[0]
    fx, fy, fz = f[0], f[1], f[2]
    if loads.full == 0:
        fz = np.sqrt(fx * fx + fy * fy + fz * fz)
        fx = 0.0
        fy = 0.0
    margin, worst = 1e9, 0
    for i in range(n):
        p = loads.P[i]
        x = p[0] * fx + p[1] * fy + p[2] * fz + p[3] * t[0] + p[4] * t[1] + p[5] * t[2]
        thrust[i] = x
        if not np.isfinite(x):
            return -np.inf, i
        room = min(x - loads.t_min[i], loads.t_max[i] - x) / (loads.t_max[i] - loads.t_min[i])
        if room < margin:
            margin, worst = room, i
    return margin, worst
