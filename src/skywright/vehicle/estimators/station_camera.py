"""Error-state Kalman filter of inertial unit, total station, tracking camera and range finder.

It shares the integration with filter.py, but no sensor measures the pose in W. The station measures
the position of the prism, infrequently and with a delay. The camera measures the motion of the
robot at 200 Hz, in its own frame. Beyond the 15 errors of filter.py, the state has the errors of
the camera relative to its calibration (vehicle/sensors/station.py), namely drift b, rotation T and
scale g = exp(growth) of the aligned frame, the range finder's bias, and the station's clock offset:

    camera aligned to W:  a = p_B + b,  b' = (g T - 1) v + drift;   attitude: T R_WB
    station:              z = p_B + R p_BP - v delay                (stamps ahead by `delay`)
    range finder:         d = p_z / R_zz + bias                     (above the ground z = 0)

Rotation errors are in W: T_true = exp(turn) T. The horizon moves every FUSE_EVERY to a fixed lag
behind the present. A sample is fused when the horizon passes its stamp, so that late samples of the
station are in order with those of the camera. From the horizon to the present only the inertial
samples are integrated.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from skywright.core.record import Array, Mat3, Vec3, Vec4
from skywright.core.rotations import mat_vec
from skywright.core.scratch import local
from skywright.core.types import IMU_HISTORY
from skywright.errors import InputError
from skywright.models.localisation.drift_filter import DriftModel
from skywright.vehicle.bus import Allocated, Body, Clock, Estimate
from skywright.vehicle.component import Estimator, Out, helper
from skywright.vehicle.estimates import POSITION_COLUMNS, EstimatorState, RotorForce
from skywright.vehicle.estimators._deviation import fill_deviation
from skywright.vehicle.estimators._fusion import (
    B_,
    DELAY_,
    G_,
    N_FUSION,
    RANGE_,
    RATE_,
    T_,
    advance,
    align,
    clear,
    fuse_fix,
    fuse_odometry,
    fuse_range,
)
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
    fill_strapdown,
    predict_now,
    receive_inertial,
)
from skywright.vehicle.readings import Fix, ImuBatch, Odometry, Range
from skywright.vehicle.sensors.station import StationCamera as Station

PENDING = 128
"""Most samples of a sensor that wait for the horizon."""
DRIFT_START = 1.0  # m
RATE_TIME = 60.0  # s in which the heading drift's rate walks by its initial sigma: assumed
FUSE_EVERY = 0.02  # s, between moves of the horizon; each integrates the state again from there
LAG = 4.0
"""Lag of the horizon, less the station's shortest latency, over the mean excess of the latency: 98
% of the station's samples arrive sooner, unless the stored samples limit the lag."""
# changes since the calibration, 1 sigma
TILT_SINCE, HEADING_SINCE = math.radians(0.2), math.radians(1.0)
SCALE_SINCE, CLOCK_SINCE = 0.005, 2e-3


class StationCamera(Estimator):
    """Fills Estimate from inertial unit, total station, tracking camera and range finder."""

    columns = POSITION_COLUMNS

    class Me(Strapdown):
        lag: float  # s, of the horizon behind the present
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
        q_rate: float  # (rad/s)^2/s
        rate_0: float  # rad/s, at the start
        std_0: Vec4  # at the start: tilt, heading (rad), scale, clock (s)
        bias_0: float  # m, of the range finder
        # state beyond Strapdown's, at its horizon
        drift: Vec3  # m, of the aligned camera
        T: Mat3  # rotation of the aligned camera against the truth
        growth: float  # logarithm of its scale against the truth
        range_bias: float  # m
        delay: float  # s, station's clock beyond `clock`
        rate: float  # rad/s, of the drift of the camera's heading
        P_full: Annotated[Array, N_FUSION, N_FUSION]
        # samples that wait for the horizon
        fix_n: int  # received; modulo PENDING the index of the next one
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
        # counters
        last_fix: float  # s, stamp of the newest fix that was fused
        fixes: int
        rejected: int
        rejected_row: int
        late: int  # came after the horizon had passed
        jumps: int  # of the camera
        often: float  # jumps of the last OFTEN_S, exponentially weighted
        last_odo: float  # s, stamp of the newest camera sample that was fused
        restarts: int  # inflations of the covariance of the inertial states or of the position

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the data sheets' values."""
        self._me, self._records = me, context.records
        fill_strapdown(me, context)
        prism, camera = context.robot.prism, context.robot.tracking_camera
        me.p_BP = [prism.x_m, prism.y_m, prism.z_m]
        finder = context.robot.range_finder
        rate = camera.rate_hz if finder is None else max(camera.rate_hz, finder.rate_hz)
        me.lag = compute_lag(context.world.total_station, rate, me.h)
        me.r_odo = max(camera.noise_m, 1e-5) ** 2
        me.r_odo_R = max(camera.attitude_noise_rad, 1e-5) ** 2
        drift = DriftModel(0.0, 0.0, 0.0, 0.0)
        me.q_yaw, me.q_tilt, me.q_scale = 0.0, drift.tilt**2, drift.scale**2
        me.rate_0 = math.radians(camera.yaw_rate_deg_per_min) / 60.0
        me.q_rate = me.rate_0**2 / RATE_TIME
        if context.robot.range_finder is not None:
            r = context.robot.range_finder
            me.r_range = max(r.noise_m, 1e-5) ** 2 + r.resolution_m**2 / 12.0
            me.bias_0 = r.bias_m

    def before_tick(self, t: float, n_ticks: int) -> None:
        """Before the first tick: read the result of the calibration."""
        me = self._me
        if me.scale > 0.0:
            return
        found = self._records[Station.Aligned, ""][0]
        me.R_WC, me.scale = found["R_WC"], found["scale"]
        me.clock = found["clock"]
        me.r_fix = max(float(found["station_noise"]), 1e-4) ** 2
        me.q_walk_m = max(float(found["per_sqrt_m"]), 1e-3) ** 2
        me.q_walk_s = max(float(found["per_sqrt_s"]), 1e-4) ** 2
        me.std_0 = [
            math.hypot(found["rotation_std"], TILT_SINCE),
            math.hypot(found["rotation_std"], HEADING_SINCE),
            math.hypot(found["scale_std"], SCALE_SINCE),
            math.hypot(found["offset_std"], CLOCK_SINCE),
        ]

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        imu: ImuBatch,
        aligned: Station.Aligned,
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
            lost = me.h * (me.n - before - imu.n)  # s, gap that a held sample fills
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
        state.fix_age = clock.t - me.last_fix
        if me.ready < 2.0:
            return
        if me.h * (me.n - me.n_f) > me.lag + FUSE_EVERY:
            changed = use_pending(me, body.gravity) or changed
        if me.n - me.n_f > IMU_HISTORY - 2 * COVARIANCE_STEP:  # no sample to fuse for long
            keep = max(IMU_HISTORY // 2, math.ceil(me.lag / me.h))
            advance(me, me.n - keep, body.gravity)
            changed = True
        if changed:
            for i in range(N_STATE):
                for j in range(N_STATE):
                    me.P[i, j] = me.P_full[i, j]
        predict_now(me, imu, body, allocated, est, rotor, clock.t, before, changed)
        state.rejected, state.restarts = float(me.rejected_row), float(me.restarts)
        state.fix_age = clock.t - me.last_fix
        fill_deviation(me, me.P_full, body.gravity, state)


def compute_lag(station: Any, rate: float, h: float) -> float:
    """Return the lag (s) of the horizon for the latency of a `station` (its table).

    The stored inertial samples, of period `h` (s), and those of the faster one of camera and range
    finder, at `rate` (Hz), limit it. Raises InputError if the mean latency exceeds the limit.
    """
    stored = min((IMU_HISTORY - 2 * COVARIANCE_STEP) * h, PENDING / rate)
    most = stored - 2.0 * FUSE_EVERY
    low, mean = station.latency_min_s, station.latency_mean_s
    if mean > most:
        raise InputError(
            f"world.total_station.latency_mean_s = {mean:g}; this robot's estimator stores the "
            f"samples of its sensors for {stored:.2f} s, so at most "
            f"{most:.2f} is valid; give a shorter latency"
        )
    return float(min(low + LAG * (mean - low), most))


@helper
def keep_fix(me: Any, fix: Any) -> None:
    """Store a fix until the horizon reaches it; its stamp is converted to the robot's clock."""
    k = me.fix_n % PENDING
    me.fix_t[k] = fix.t - me.clock
    for i in range(3):
        me.fix_p[k, i] = fix.p[i]
    me.fix_n += 1
    me.fix_used = max(me.fix_used, me.fix_n - PENDING)


@helper
def keep_odometry(me: Any, odo: Any) -> None:
    """Store a camera sample until the horizon reaches it."""
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
    """Store a distance until the horizon reaches it."""
    k = me.range_n % PENDING
    me.range_t[k], me.range[k] = found.t, found.distance
    me.range_n += 1
    me.range_used = max(me.range_used, me.range_n - PENDING)


@helper
def _place(me: Any, t: float) -> int:
    """Return the number of inertial samples taken up to time `t`."""
    return me.n - math.floor((me.t - t) / me.h + 0.5)


@helper
def start(me: Any) -> None:
    """Start at rest from the oldest waiting fix and the camera sample nearest to it in time.

    The attitude is that of the camera, so its error and that of the rotation T are correlated.
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
    align(me, k % PENDING, a, R)
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
    P[DELAY_, DELAY_], P[RATE_, RATE_] = me.std_0[3] ** 2, me.rate_0**2
    me.growth = me.range_bias = me.delay = me.rate = 0.0
    me.fix_used += 1
    me.odo_used, me.range_used = k + 1, me.range_n
    me.last_fix, me.rejected_row = t, 0
    me.n_f, me.ready = n, 2.0


@helper
def use_pending(me: Any, gravity: float) -> bool:
    """Fuse the waiting samples that are older than the lag, in order, at the moving horizon."""
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
        if n < me.n_f - 1:  # one sample is allowed for rounding
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
