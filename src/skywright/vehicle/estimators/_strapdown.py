"""Strapdown integration of inertial samples, and propagation of the covariance.

The error is (dp, dv, dtheta, db_g, db_a) with the attitude error in W (filter.py). Its transition
matrix F has four off-diagonal blocks. F P F' is therefore computed as one shear of block rows
(`shear`) for each block, instead of two dense 15 x 15 products.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from skywright.core.record import Array, Mat3, Vec3
from skywright.core.rotations import cross, exp_so3, mat_mat, mat_vec, orthonormalise
from skywright.core.scratch import local
from skywright.core.types import IMU_HISTORY
from skywright.vehicle.component import Context, helper
from skywright.vehicle.tip import TipCorrection, fill_tip

P_, V_, R_, BG_, BA_ = 0, 3, 6, 9, 12  # first index of each part of the error
N_STATE = 15
MASK = IMU_HISTORY - 1  # of an index into the ring buffer of samples
COVARIANCE_STEP = 10  # inertial samples, in which R turns by 0.01 rad at 1 rad/s
SPEED_START = 0.3  # m/s, 1 sigma when the filter starts
HOLD_ACCEL, HOLD_RATE = 1.0, 0.2  # m/s^2, rad/s: 1 sigma of the error of a held sample


class Strapdown(TipCorrection):
    """Parameters and state of a filter around an inertial unit."""

    dt: float  # s, control period
    bandwidth: float  # rad/s, of the external force
    rotor_tau: float  # s, nominal rotor lag
    h: float  # s, period of the inertial unit
    p_BI: Vec3  # m, its position in B
    q_v: float  # (m/s^2)^2/Hz, noise density of the accelerometer, squared
    q_R: float  # (rad/s)^2/Hz, of the gyroscope
    q_ba: float  # of the random walks of the biases
    q_bg: float
    p_ba: float  # variance of the turn-on biases
    p_bg: float
    vibration_v: float  # (m/s)^2, vibration of the unit on its mount
    vibration_R: float  # rad^2
    p_slow: Vec3  # m, 1 sigma of slow errors of the localisation, which are not observable
    # the newest state, at the inertial unit
    t: float  # s
    p: Vec3
    v: Vec3
    R: Mat3
    a_W: Vec3  # m/s^2
    # the horizon: the last exposure
    p_f: Vec3
    v_f: Vec3
    R_f: Mat3
    bg: Vec3  # rad/s
    ba: Vec3  # m/s^2
    P: Annotated[Array, 15, 15]  # of (p, v, attitude in W, bg, ba)
    ready: float  # 0: no sample yet, 1: one sample, 2: running
    n: int  # inertial samples so far
    n_f: int  # of them within the horizon
    gyro: Annotated[Array, IMU_HISTORY, 3]
    accel: Annotated[Array, IMU_HISTORY, 3]
    p_BT: Annotated[Array, IMU_HISTORY, 3]


def fill_strapdown(me: Any, context: Context) -> None:
    """Fill the parameters of a Strapdown from data sheets: noise densities, vibration at hover."""
    robot, rotors = context.robot, context.rotors
    s = robot.sensors
    me.dt, me.bandwidth = context.dt, robot.control.observer_bandwidth_rad_s
    me.rotor_tau, me.h = rotors.time_constant, context.h
    me.p_BI = [s.imu_x_m, s.imu_y_m, s.imu_z_m]
    me.q_v, me.q_R = s.accel_noise_mps2_sqrthz**2, s.gyro_noise_rad_s_sqrthz**2
    me.q_ba, me.q_bg = s.accel_walk_mps3_sqrthz**2, s.gyro_walk_rad_s2_sqrthz**2
    me.p_ba, me.p_bg = s.accel_bias_mps2**2, s.gyro_bias_rad_s**2
    # vibration of velocity and attitude: the integral of the unit's rotor vibration at hover
    n, most = len(rotors.thrust_min), robot.rotors.thrust_max_n
    share = context.mass * context.world.gravity_mps2 / (n * most)
    speed = math.sqrt(share * most / rotors.k_f)
    me.vibration_v = 0.5 * n * (s.vibration_mps2 * share / speed) ** 2
    me.vibration_R = 0.5 * n * (s.vibration_rad_s * share / speed) ** 2


@helper
def integrate(
    me: Any, first: int, last: int, gravity: float, p: Any, v: Any, R: Any,
    dv: Any, turn: Any,
) -> None:  # fmt: skip
    """Strapdown integration of the samples first..last-1, in place.

    Writes the integral of R f (m/s) to `dv` (3,) and that of R (s) to `turn` (3, 3). A sample is
    the mean over its period, so the specific force is rotated with the attitude at its middle.
    """
    h = me.h
    for i in range(3):
        dv[i] = 0.0
        for j in range(3):
            turn[i, j] = 0.0
    g0, g1, g2 = me.bg[0], me.bg[1], me.bg[2]
    a0, a1, a2 = me.ba[0], me.ba[1], me.ba[2]
    for n in range(first, last):
        k = n & MASK
        x, y, z = h * (me.gyro[k, 0] - g0), h * (me.gyro[k, 1] - g1), h * (me.gyro[k, 2] - g2)
        fx, fy, fz = me.accel[k, 0] - a0, me.accel[k, 1] - a1, me.accel[k, 2] - a2
        mx = fx + 0.5 * (y * fz - z * fy)
        my = fy + 0.5 * (z * fx - x * fz)
        mz = fz + 0.5 * (x * fy - y * fx)
        # exp of a rotation of some mrad: the series to fifth order is exact to rounding
        s = x * x + y * y + z * z
        a = 1.0 - s * (1.0 / 6.0) * (1.0 - s * 0.05)
        b = 0.5 - s * (1.0 / 24.0)
        for i in range(3):
            r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
            f = h * (r0 * mx + r1 * my + r2 * mz)
            dv[i] += f
            old = v[i]
            v[i] = old + f
            turn[i, 0] += h * r0
            turn[i, 1] += h * r1
            turn[i, 2] += h * r2
            if i == 2:
                v[i] -= h * gravity
            p[i] += 0.5 * h * (old + v[i])
            # row of R (I + a [t] + b [t]^2) = r + a (r x t) + b ((r x t) x t)
            c0, c1, c2 = r1 * z - r2 * y, r2 * x - r0 * z, r0 * y - r1 * x
            R[i, 0] = r0 + a * c0 + b * (c1 * z - c2 * y)
            R[i, 1] = r1 + a * c1 + b * (c2 * x - c0 * z)
            R[i, 2] = r2 + a * c2 + b * (c0 * y - c1 * x)


@helper
def shear(P: Any, i: int, j: int, M: Any) -> None:
    """P <- S P S' with S = I + M in block (i, j): x_i += M x_j."""
    for r in range(3):
        m0, m1, m2 = M[r, 0], M[r, 1], M[r, 2]
        for c in range(P.shape[1]):
            P[i + r, c] += m0 * P[j, c] + m1 * P[j + 1, c] + m2 * P[j + 2, c]
    for r in range(3):
        x, y, z = P[i + r, j], P[i + r, j + 1], P[i + r, j + 2]
        for c in range(3):
            P[i + r, i + c] += x * M[c, 0] + y * M[c, 1] + z * M[c, 2]
    _mirror(P, i)


@helper
def _drift(P: Any, dt: float) -> None:
    """P <- S P S' with x_p += dt x_v."""
    for r in range(3):
        for c in range(P.shape[1]):
            P[r, c] += dt * P[3 + r, c]
    for r in range(3):
        for c in range(3):
            P[r, c] += dt * P[r, 3 + c]
    _mirror(P, 0)


@helper
def _mirror(P: Any, i: int) -> None:
    """Copy block row `i` to block column `i`."""
    for c in range(P.shape[1]):
        for r in range(3):
            P[c, i + r] = P[i + r, c]


@helper
def propagate_covariance(me: Any, P: Any, dv: Any, turn: Any, dt: float) -> None:
    """Advance `P` by `dt`: dp' = dv, dv' = -[R f] dtheta - R db_a, dtheta' = -R db_g, plus noise.

    Half of the drift before and half after makes the step second-order accurate. Rows of `P` beyond
    the 15 belong to states that are constant here.
    """
    M = local(3, 3)
    M[0, 0] = M[1, 1] = M[2, 2] = 0.0
    M[0, 1], M[0, 2], M[1, 2] = dv[2], -dv[1], dv[0]
    M[1, 0], M[2, 0], M[2, 1] = -dv[2], dv[1], -dv[0]
    _drift(P, 0.5 * dt)
    shear(P, V_, R_, M)
    for i in range(3):
        for j in range(3):
            M[i, j] = -turn[i, j]
    shear(P, V_, BA_, M)
    shear(P, R_, BG_, M)
    _drift(P, 0.5 * dt)
    for i in range(3):
        P[V_ + i, V_ + i] += dt * me.q_v
        P[R_ + i, R_ + i] += dt * me.q_R
        P[BG_ + i, BG_ + i] += dt * me.q_bg
        P[BA_ + i, BA_ + i] += dt * me.q_ba


@helper
def advance(me: Any, last: int, gravity: float) -> None:
    """Move the horizon (state and covariance) up to inertial sample `last`."""
    dv, turn = local(3), local(3, 3)
    while me.n_f < last:
        first = me.n_f
        end = min(first + COVARIANCE_STEP, last)
        integrate(me, first, end, gravity, me.p_f, me.v_f, me.R_f, dv, turn)
        propagate_covariance(me, me.P, dv, turn, me.h * (end - first))
        me.n_f = end
    orthonormalise(me.R_f)


@helper
def receive_inertial(me: Any, imu: Any, body: Any) -> None:
    """Append this tick's inertial samples; the first one also fills a gap of lost packets."""
    before = me.n
    missing = int((imu.t - me.t) / me.h + 0.5) - imu.n
    me.t = imu.t
    if missing > 0 and me.ready == 2.0:
        if missing > IMU_HISTORY // 2:
            me.ready = 0.0
        else:
            for i in range(3):
                me.P[V_ + i, V_ + i] += (HOLD_ACCEL * missing * me.h) ** 2
                me.P[R_ + i, R_ + i] += (HOLD_RATE * missing * me.h) ** 2
    else:
        missing = 0
    for n in range(-missing, imu.n):
        k = me.n & MASK
        m = max(n, 0)
        for i in range(3):
            me.gyro[k, i] = imu.gyro[m, i]
            me.accel[k, i] = imu.accel[m, i]
        me.n += 1
    for n in range(before, me.n):
        for i in range(3):
            me.p_BT[n & MASK, i] = body.p_BT[i]


@helper
def fill_estimate(me: Any, imu: Any, t: float, est: Any) -> None:
    """Fill pose and velocity of B from the state at the inertial unit, predicted to time `t`."""
    w, lever, turn = local(3), local(3), local(3)
    for i in range(3):
        if imu.n > 0:
            mean = 0.0
            for k in range(imu.n):
                mean += imu.gyro[k, i] / imu.n
            est.w_WB_B[i] = mean - me.bg[i]
        w[i] = est.w_WB_B[i]
    late = max(t - me.t, 0.0)  # age of the newest data; zero without a link
    if late > 0.0:
        rot = local(3, 3)
        for i in range(3):
            turn[i] = late * w[i]
        exp_so3(turn, rot)
        mat_mat(me.R, rot, est.R_WB)
    else:
        for i in range(3):
            for j in range(3):
                est.R_WB[i, j] = me.R[i, j]
    orthonormalise(est.R_WB)
    cross(w, me.p_BI, turn)
    mat_vec(est.R_WB, turn, lever)
    for i in range(3):
        v = me.v[i] + late * me.a_W[i]
        est.p_WB[i] = me.p[i] + late * (me.v[i] + 0.5 * late * me.a_W[i])
        est.v_WB[i] = v - lever[i]
    mat_vec(est.R_WB, me.p_BI, lever)
    for i in range(3):
        est.p_WB[i] -= lever[i]


@helper
def estimate_force(
    me: Any, body: Any, allocated: Any, est: Any, rotor: Any, dv: Any, span: float
) -> None:
    """Fill the external force: mass times specific force, minus the rotors' force; low-passed.

    `dv` is the integral of the specific force in W over `span` seconds.
    """
    decay = math.exp(-me.dt / me.rotor_tau)
    f_W = local(3)
    for i in range(3):
        made = allocated.f_B_alloc[i]
        rotor.f_B[i] = made + (rotor.f_B[i] - made) * decay
    mat_vec(me.R, rotor.f_B, f_W)
    k = 1.0 - math.exp(-me.bandwidth * me.dt)
    for i in range(3):
        f = dv[i] / span
        me.a_W[i] = f
        est.f_ext_W[i] += k * (body.mass * f - f_W[i] - est.f_ext_W[i])
    me.a_W[2] -= body.gravity


@helper
def predict_now(
    me: Any,
    imu: Any,
    body: Any,
    allocated: Any,
    est: Any,
    rotor: Any,
    t: float,
    before: int,
    changed: bool,
) -> None:
    """Integrate the state up to the newest inertial sample and fill the estimate.

    `before` is the inertial sample of the present state. If the state at the horizon has
    `changed`, the integration starts again from there.
    """
    gravity = body.gravity
    dv, turn = local(3), local(3, 3)
    if changed:
        for i in range(3):
            me.p[i], me.v[i] = me.p_f[i], me.v_f[i]
            for j in range(3):
                me.R[i, j] = me.R_f[i, j]
        if before > me.n_f:
            integrate(me, me.n_f, before, gravity, me.p, me.v, me.R, dv, turn)
        before = max(before, me.n_f)
    if before < me.n:
        integrate(me, before, me.n, gravity, me.p, me.v, me.R, dv, turn)
        estimate_force(me, body, allocated, est, rotor, dv, me.h * (me.n - before))
    fill_estimate(me, imu, t, est)
    fill_tip(est, body, me.c_B)


@helper
def head_covariance(me: Any, gravity: float, P: Any) -> None:
    """Write the covariance of the newest state into `P` (15, 15), for tests of consistency.

    The rotors make the inertial unit vibrate relative to the body. The resulting error of velocity
    and attitude is bounded, not a random walk; it is therefore added here and not integrated.
    """
    p, v, R, dv, turn = local(3), local(3), local(3, 3), local(3), local(3, 3)
    for i in range(3):
        p[i], v[i] = me.p_f[i], me.v_f[i]
        for j in range(3):
            R[i, j] = me.R_f[i, j]
    for i in range(N_STATE):
        for j in range(N_STATE):
            P[i, j] = me.P[i, j]
    n = me.n_f
    while n < me.n:
        end = min(n + COVARIANCE_STEP, me.n)
        integrate(me, n, end, gravity, p, v, R, dv, turn)
        propagate_covariance(me, P, dv, turn, me.h * (end - n))
        n = end
    for i in range(3):
        P[V_ + i, V_ + i] += me.vibration_v
        P[R_ + i, R_ + i] += me.vibration_R
