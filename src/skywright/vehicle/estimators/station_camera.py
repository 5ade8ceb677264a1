"""Error-state Kalman filter of inertial unit, total station, tracking camera and range finder.

As filter.py, which it shares the integration with, but nothing tells the pose: the
station tells now and then, late, where the prism was; the camera tells at 200 Hz how the robot
moved, in a frame of its own. Beyond the 15 errors of that filter it estimates how the camera errs
against its calibration (vehicle/localisation.py): drift b, rotation T and scale g = exp(growth) of
the aligned frame, further the range finder's bias and the station's clock:

    camera aligned to W:  a = p_B + b,  b' = (g T - 1) v + drift;   attitude: T R_WB
    station:              z = p_B + R p_BP - v delay                (stamps ahead by `delay`)
    range finder:         d = p_z / R_zz + bias                     (above the ground z = 0)

The errors of rotations are in W: T_true = exp(turn) T. A sample waits until the horizon, which
moves every FUSE_EVERY to a fixed lag behind now, passes its stamp, so that the station's late
samples are in order with the camera's; from there to now only the inertial samples are integrated.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from skywright.core.record import Array, Mat3, Vec3, Vec4
from skywright.core.rotations import exp_so3, log_so3, mat_mat, mat_vec, orthonormalise
from skywright.core.scratch import local
from skywright.core.types import IMU_HISTORY
from skywright.vehicle.bus import Allocated, Body, Clock, Estimate
from skywright.vehicle.component import Estimator, Out, helper
from skywright.vehicle.estimates import EstimatorState, RotorForce
from skywright.vehicle.estimators._kalman import correct, inject, place_point
from skywright.vehicle.estimators._strapdown import (
    BA_,
    BG_,
    COVARIANCE_STEP,
    HOLD_ACCEL,
    HOLD_RATE,
    N_STATE,
    P_,
    R_,
    SPEED_START,
    V_,
    Strapdown,
    integrate,
    predict_now,
    propagate_covariance,
    receive_inertial,
    shear,
)
from skywright.vehicle.readings import Fix, ImuBatch, Odometry, Range

N_FUSION = 24
PENDING = 128
"""Samples of a sensor that may wait for the horizon."""

B_, T_, G_, RANGE_, DELAY_ = 15, 18, 21, 22, 23  # where the further errors start

GATE_FIX = 21.1  # chi-square of 3, exceeded once in 10,000
GATE_ODO = 30.0  # the camera has jumped, not the robot
GATE_RANGE = 16.0
NO_GATE = math.inf
RUN = 5  # rejected fixes in a row: not they are wrong but the filter
DRIFT_START = 1.0  # m
FUSE_EVERY = 0.02  # s: the state is integrated again from the horizon each time that this moves


class StationCamera(Estimator):
    """Fills Estimate from inertial unit, total station, tracking camera and range finder."""

    class Me(Strapdown):
        lag: float  # s, how far the horizon is behind
        p_BP: Vec3  # m, prism
        R_WC: Mat3  # frame and scale of the camera as calibrated
        scale: float  # m of a unit of the camera
        clock: float  # s, station's clock ahead of the robot's, as calibrated
        r_fix: float  # m^2
        r_odo: float  # m^2
        r_odo_R: float  # rad^2
        r_range: float  # m^2
        q_walk_m: float  # m^2 a metre of path, of the camera's drift
        q_walk_s: float  # m^2/s
        q_yaw: float  # rad^2/s, of the camera's frame
        q_tilt: float
        q_scale: float  # 1/s
        std_0: Vec4  # at the start: tilt, heading (rad), scale, clock (s)
        bias_0: float  # m, of the range finder
        # state beyond Strapdown's, at its horizon
        drift: Vec3  # m, of the aligned camera
        T: Mat3  # rotation of the aligned camera against the truth
        growth: float  # log of its scale against the truth
        range_bias: float  # m
        delay: float  # s, station's clock beyond `clock`
        P_full: Annotated[Array, N_FUSION, N_FUSION]
        # samples that wait
        fix_n: int  # received, modulo PENDING the place of the next one
        fix_used: int
        fix_t: Annotated[Array, PENDING]
        fix_p: Annotated[Array, PENDING, 3]
        odo_n: int
        odo_used: int
        odo_t: Annotated[Array, PENDING]
        odo_p: Annotated[Array, PENDING, 3]
        odo_R: Annotated[Array, PENDING, 3, 3]
        range_n: int
        range_used: int
        range_t: Annotated[Array, PENDING]
        range: Annotated[Array, PENDING]
        # what became of them
        last_fix: float  # s, stamp of the newest fix that was fused
        fixes: int
        rejected: int
        rejected_row: int
        late: int  # came after the horizon had passed
        jumps: int  # of the camera

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        imu: ImuBatch,
        fix: Fix,
        odo: Odometry,
        below: Range | None,
        body: Body,
        allocated: Allocated,
        est: Out[Estimate],
        rotor: Out[RotorForce],
        state: Out[EstimatorState],
    ) -> None:
        est.t = clock.t
        before = me.n
        if imu.n > 0:
            receive_inertial(me, imu, body)
            lost = me.h * (me.n - before - imu.n)  # s of samples that were held
            for i in range(3):
                me.P_full[V_ + i, V_ + i] += (HOLD_ACCEL * lost) ** 2
                me.P_full[R_ + i, R_ + i] += (HOLD_RATE * lost) ** 2
        if fix.fresh > 0.0:
            keep_fix(me, fix)
        if odo.fresh > 0.0:
            keep_odometry(me, odo)
        if below is not None and below.fresh > 0.0:
            keep_range(me, below)
        if fix.fresh + odo.fresh > 0.0:
            state.heard = clock.t
        changed = False
        if me.ready < 2.0 and me.fix_used < me.fix_n and me.n > 0:
            start(me)
            changed = me.ready == 2.0
        state.ready = 1.0 if me.ready == 2.0 else 0.0
        tell_state(me, state)
        if me.ready < 2.0:
            return
        if me.h * (me.n - me.n_f) > me.lag + FUSE_EVERY:
            changed = use_pending(me, body.gravity) or changed
        if me.n - me.n_f > IMU_HISTORY - 2 * COVARIANCE_STEP:  # nothing to fuse for long
            advance(me, me.n - IMU_HISTORY // 2, body.gravity)
            changed = True
        if changed:
            for i in range(N_STATE):
                for j in range(N_STATE):
                    me.P[i, j] = me.P_full[i, j]
        predict_now(me, imu, body, allocated, est, rotor, clock.t, before, changed)
        tell_state(me, state)


@helper
def tell_state(me: Any, state: Any) -> None:
    """Fill what is known of the estimate."""
    state.last_fix = me.last_fix
    state.pose_std = math.sqrt(max(me.P_full[0, 0], me.P_full[1, 1], me.P_full[2, 2]))


@helper
def clear(H: Any) -> None:
    """Set all of a matrix to zero."""
    for i in range(H.shape[0]):
        for j in range(H.shape[1]):
            H[i, j] = 0.0


@helper
def _grown(me: Any, out: Any) -> None:
    """Write g T."""
    g = math.exp(me.growth)
    for i in range(3):
        for j in range(3):
            out[i, j] = g * me.T[i, j]


@helper
def advance(me: Any, last: int, gravity: float) -> None:
    """Move the horizon up to inertial sample `last`."""
    P = me.P_full
    dv, turn, M, before = local(3), local(3, 3), local(3, 3), local(3)
    grown, moved, u = local(3, 3), local(3), local(3)
    _grown(me, grown)
    while me.n_f < last:
        first = me.n_f
        end = min(first + COVARIANCE_STEP, last)
        dt = me.h * (end - first)
        for i in range(3):
            before[i] = me.p_f[i]
        integrate(me, first, end, gravity, me.p_f, me.v_f, me.R_f, dv, turn)
        path = 0.0
        for i in range(3):
            moved[i] = me.p_f[i] - before[i]
            path += moved[i] * moved[i]
        path = math.sqrt(path)
        mat_vec(grown, moved, u)
        for i in range(3):
            me.drift[i] += u[i] - moved[i]
            for j in range(3):
                M[i, j] = dt * grown[i, j]
            M[i, i] -= dt
        shear(P, B_, V_, M)
        M[0, 0] = M[1, 1] = M[2, 2] = 0.0
        M[0, 1], M[0, 2], M[1, 2] = u[2], -u[1], u[0]  # d(exp(turn) u) = turn x u
        M[1, 0], M[2, 0], M[2, 1] = -u[2], u[1], -u[0]
        shear(P, B_, T_, M)
        for i in range(3):
            M[i, 0], M[i, 1], M[i, 2] = u[i], 0.0, 0.0
        shear(P, B_, G_, M)
        propagate_covariance(me, P, dv, turn, dt)
        for i in range(3):
            P[B_ + i, B_ + i] += me.q_walk_s * dt + me.q_walk_m * path
            P[T_ + i, T_ + i] += dt * (me.q_yaw if i == 2 else me.q_tilt)
        P[G_, G_] += dt * me.q_scale
        me.n_f = end
    orthonormalise(me.R_f)


@helper
def _inject(me: Any, dx: Any) -> None:
    """Move the estimated error into the state."""
    turn, rot, old = local(3), local(3, 3), local(3, 3)
    inject(me, dx)
    for i in range(3):
        me.drift[i] += dx[B_ + i]
        turn[i] = dx[T_ + i]
    exp_so3(turn, rot)
    for i in range(3):
        for j in range(3):
            old[i, j] = me.T[i, j]
    mat_mat(rot, old, me.T)
    orthonormalise(me.T)
    me.growth += dx[G_]
    me.range_bias += dx[RANGE_]
    me.delay += dx[DELAY_]


@helper
def fuse_fix(me: Any, z: Any) -> None:
    """Fuse where the station saw the prism when the horizon's clock stood at the stamp."""
    H, nu, kept, r, lever = local(3, N_FUSION), local(3), local(3), local(3), local(3)
    dx = local(N_FUSION)
    clear(H)
    place_point(me, me.p_BP, H, lever)
    far = 0.0
    for i in range(3):
        H[i, DELAY_] = -me.v_f[i]
        nu[i] = z[i] - (me.p_f[i] + lever[i] - me.v_f[i] * me.delay)
        far += nu[i] * nu[i] / 3.0
        r[i], kept[i] = me.r_fix, nu[i]
    if correct(me.P_full, H, kept, r, GATE_FIX, dx) < GATE_FIX:
        me.rejected_row = 0
    else:
        me.rejected += 1
        me.rejected_row += 1
        if me.rejected_row < RUN:
            return
        me.rejected_row = 0
        for i in range(3):  # lost: the position is anywhere, what the camera tells of it is not
            me.P_full[P_ + i, P_ + i] += far
            me.P_full[B_ + i, B_ + i] += far
            me.P_full[P_ + i, B_ + i] -= far
            me.P_full[B_ + i, P_ + i] -= far
        correct(me.P_full, H, nu, r, NO_GATE, dx)
    _inject(me, dx)
    me.fixes += 1


@helper
def _align(me: Any, k: int, a: Any, R: Any) -> None:
    """Camera sample `k` in W: position (3,) m and attitude (3, 3)."""
    mat_vec(me.R_WC, me.odo_p[k], a)
    for i in range(3):
        a[i] *= me.scale
    mat_mat(me.R_WC, me.odo_R[k], R)


@helper
def fuse_odometry(me: Any, k: int) -> None:
    """Fuse camera sample `k`; a jump of the camera goes into its drift."""
    H, nu, kept, r, lever = local(6, N_FUSION), local(6), local(6), local(6), local(3)
    a, R, seen, rest = local(3), local(3, 3), local(3, 3), local(3, 3)
    dx, turn = local(N_FUSION), local(3)
    _align(me, k, a, R)
    clear(H)
    for i in range(3):
        turn[i] = 0.0
    place_point(me, turn, H, lever)
    mat_mat(me.T, me.R_f, seen)
    for i in range(3):
        for j in range(3):  # R seen'
            rest[i, j] = R[i, 0] * seen[j, 0] + R[i, 1] * seen[j, 1] + R[i, 2] * seen[j, 2]
    log_so3(rest, turn)
    far = 0.0
    for i in range(3):
        H[i, B_ + i] = 1.0
        nu[i] = a[i] - (me.p_f[i] + lever[i] + me.drift[i])
        far += nu[i] * nu[i] / 3.0
        r[i] = me.r_odo
        # log(T_true R_true (T R)') = turn + T theta
        nu[3 + i] = turn[i]
        H[3 + i, T_ + i] = 1.0
        for j in range(3):
            H[3 + i, R_ + j] = me.T[i, j]
        r[3 + i] = me.r_odo_R
    for i in range(6):
        kept[i] = nu[i]
    if not correct(me.P_full, H, kept, r, GATE_ODO, dx) < GATE_ODO:
        me.jumps += 1
        for i in range(3):
            me.P_full[B_ + i, B_ + i] += far
        correct(me.P_full, H, nu, r, NO_GATE, dx)
    _inject(me, dx)


@helper
def fuse_range(me: Any, distance: float) -> None:
    """Fuse the distance to the ground below; what is not the ground is gated."""
    H, nu, r, lever = local(3, N_FUSION), local(1), local(1), local(3)
    dx, one = local(N_FUSION), local(1, N_FUSION)
    clear(H)
    for i in range(3):
        dx[i] = 0.0
    place_point(me, dx, H, lever)
    z, up = me.p_f[2] + lever[2], me.R_f[2, 2]
    if up < 0.5:
        return
    for i in range(N_FUSION):
        one[0, i] = H[2, i] / up
    # d(R_zz) = turn_x R_yz - turn_y R_xz
    one[0, R_] -= z / (up * up) * me.R_f[1, 2]
    one[0, R_ + 1] += z / (up * up) * me.R_f[0, 2]
    one[0, RANGE_] = 1.0
    nu[0], r[0] = distance - (z / up + me.range_bias), me.r_range
    if correct(me.P_full, one, nu, r, GATE_RANGE, dx) < GATE_RANGE:
        _inject(me, dx)


@helper
def keep_fix(me: Any, fix: Any) -> None:
    """Put a fix where it waits for the horizon; stamps on the robot's clock."""
    k = me.fix_n % PENDING
    me.fix_t[k] = fix.t - me.clock
    for i in range(3):
        me.fix_p[k, i] = fix.p[i]
    me.fix_n += 1
    me.fix_used = max(me.fix_used, me.fix_n - PENDING)


@helper
def keep_odometry(me: Any, odo: Any) -> None:
    """Put a camera sample where it waits."""
    k = me.odo_n % PENDING
    me.odo_t[k] = odo.t
    for i in range(3):
        me.odo_p[k, i] = odo.p[i]
        for j in range(3):
            me.odo_R[k, i, j] = odo.R[i, j]
    me.odo_n += 1
    me.odo_used = max(me.odo_used, me.odo_n - PENDING)


@helper
def keep_range(me: Any, found: Any) -> None:
    """Put a distance where it waits."""
    k = me.range_n % PENDING
    me.range_t[k], me.range[k] = found.t, found.distance
    me.range_n += 1
    me.range_used = max(me.range_used, me.range_n - PENDING)


@helper
def _place(me: Any, t: float) -> int:
    """Inertial samples taken up to time `t`."""
    return me.n - math.floor((me.t - t) / me.h + 0.5)


@helper
def start(me: Any) -> None:
    """Begin at rest from the oldest fix that waits and the camera sample nearest to it.

    The attitude is the camera's: it and the camera's rotation T err together.
    """
    t = me.fix_t[me.fix_used % PENDING]
    n = _place(me, t)
    best, k = math.inf, -1
    for s in range(me.odo_used, me.odo_n):
        if abs(me.odo_t[s % PENDING] - t) < best:
            best, k = abs(me.odo_t[s % PENDING] - t), s
    if k < 0 or n <= me.n - IMU_HISTORY or n > me.n or n < 0:
        if me.fix_n - me.fix_used > 1:
            me.fix_used += 1
        return
    a, R, lever, P = local(3), local(3, 3), local(3), me.P_full
    _align(me, k % PENDING, a, R)
    for i in range(3):
        for j in range(3):
            me.R_f[i, j] = R[i, j]
    clear(P)
    d = local(3)
    for i in range(3):
        d[i] = me.p_BP[i] - me.p_BI[i]
    mat_vec(R, d, lever)
    p = local(3)
    mat_vec(R, me.p_BI, p)  # from B to the inertial unit
    for i in range(3):
        me.p_f[i] = me.fix_p[me.fix_used % PENDING, i] - lever[i]
        me.v_f[i] = me.bg[i] = me.ba[i] = 0.0
        me.drift[i] = a[i] - (me.p_f[i] - p[i])
        for j in range(3):
            me.T[i, j] = 1.0 if i == j else 0.0
        frame = me.std_0[1 if i == 2 else 0] ** 2
        P[P_ + i, P_ + i] = me.r_fix
        P[V_ + i, V_ + i] = SPEED_START**2
        P[R_ + i, R_ + i] = frame + me.r_odo_R
        P[BG_ + i, BG_ + i], P[BA_ + i, BA_ + i] = me.p_bg, me.p_ba
        P[B_ + i, B_ + i] = DRIFT_START**2
        P[T_ + i, T_ + i] = frame
        P[T_ + i, R_ + i] = P[R_ + i, T_ + i] = -frame
    P[G_, G_], P[RANGE_, RANGE_] = me.std_0[2] ** 2, me.bias_0**2
    P[DELAY_, DELAY_] = me.std_0[3] ** 2
    me.growth = me.range_bias = me.delay = 0.0
    me.fix_used += 1
    me.odo_used, me.range_used = k + 1, me.range_n
    me.last_fix, me.rejected_row = t, 0
    me.n_f, me.ready = n, 2.0


@helper
def use_pending(me: Any, gravity: float) -> bool:
    """Move the horizon to what waits and is old enough, in order of time, and fuse it."""
    until, changed = me.t - me.lag, False
    while True:
        t, kind = math.inf, -1
        if me.fix_used < me.fix_n and me.fix_t[me.fix_used % PENDING] < t:
            t, kind = me.fix_t[me.fix_used % PENDING], 0
        if me.odo_used < me.odo_n and me.odo_t[me.odo_used % PENDING] < t:
            t, kind = me.odo_t[me.odo_used % PENDING], 1
        if me.range_used < me.range_n and me.range_t[me.range_used % PENDING] < t:
            t, kind = me.range_t[me.range_used % PENDING], 2
        if kind < 0 or t > until:
            return changed
        n = _place(me, t)
        if n < me.n_f - 1:  # by a sample: rounding
            me.late += 1
        else:
            advance(me, min(n, me.n), gravity)
            if kind == 0:
                fuse_fix(me, me.fix_p[me.fix_used % PENDING])
                me.last_fix = t
            elif kind == 1:
                fuse_odometry(me, me.odo_used % PENDING)
            else:
                fuse_range(me, me.range[me.range_used % PENDING])
            changed = True
        if kind == 0:
            me.fix_used += 1
        elif kind == 1:
            me.odo_used += 1
        else:
            me.range_used += 1
