"""A simple estimator from motion capture and gyroscope, with delay compensation.

Translation: a third-order observer (position, velocity, external force) per axis that predicts with
the nominal rotor force and corrects with each motion-capture sample at the time of its exposure.
The gains are those of a critically damped g-h-k filter: all three poles at theta = exp(-w T) for a
sample T after the previous one (Brookner, Tracking and Kalman Filtering Made Easy, 1998, eq.
1.3-10). They follow from one bandwidth w at any sample rate and through drop-outs. Attitude: the
gyroscope is integrated, motion capture corrects angle and bias
(complementary filter on SO(3), Mahony et al. 2008). Tip: forward kinematics plus a slow
correction in B that absorbs calibration error, flexibility and spring.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import (
    exp_so3,
    log_so3,
    mat_mat,
    mat_t_mat,
    mat_t_vec,
    mat_vec,
    orthonormalise,
)
from skywright.core.scratch import local
from skywright.vehicle.bus import Allocated, Body, Clock, Estimate
from skywright.vehicle.component import Estimator, Out, helper
from skywright.vehicle.estimates import EstimatorState, RotorForce
from skywright.vehicle.readings import ImuBatch, MocapSample
from skywright.vehicle.tip import fill_tip

HISTORY = 128
"""Control ticks of estimates kept for delayed samples: 0.1 s, the largest latency, is 100 ticks
at 1000 Hz."""


class Observer(Estimator):
    """Fills Estimate from motion capture and gyroscope."""

    needs_motion_capture = True

    class Me(Record):
        dt: float  # s, control period
        bandwidth: float  # rad/s
        rotor_tau: float  # s, nominal rotor lag
        gyro: Vec3  # rad/s, mean of the newest samples
        bias: Vec3  # rad/s, gyroscope
        c_B: Vec3  # m, tip correction (kinematic error, flexibility, spring)
        ready: float
        head: int
        p: Annotated[Array, HISTORY, 3]
        R: Annotated[Array, HISTORY, 3, 3]
        p_BT: Annotated[Array, HISTORY, 3]

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the bandwidth and the rotor lag."""
        me.dt, me.bandwidth = context.dt, context.robot.control.observer_bandwidth_rad_s
        me.rotor_tau = context.rotors.time_constant

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        imu: ImuBatch,
        mocap: MocapSample,
        body: Body,
        allocated: Allocated,
        est: Out[Estimate],
        rotor: Out[RotorForce],
        state: Out[EstimatorState],
    ) -> None:
        est.t, state.pose_std = clock.t, math.nan
        if imu.n > 0:
            for i in range(3):
                me.gyro[i] = 0.0
                for k in range(imu.n):
                    me.gyro[i] += imu.gyro[k, i] / imu.n
        if mocap.fresh > 0.0:
            state.heard = clock.t
        if me.ready == 0.0:
            if mocap.fresh == 0.0:
                return
            start(me, mocap, body.p_BT, est)
            state.ready = 1.0
        predict(me, body, allocated, est, rotor)
        i = me.head
        for a in range(3):
            me.p[i, a] = est.p_WB[a]
            me.p_BT[i, a] = body.p_BT[a]
            for c in range(3):
                me.R[i, a, c] = est.R_WB[a, c]
        me.head = (me.head + 1) % HISTORY
        if mocap.fresh > 0.0:
            correct(me, mocap, clock.t, body.mass, est)
        fill_tip(est, body, me.c_B)


@helper
def start(me: Any, mocap: Any, p_BT: Any, est: Any) -> None:
    """Start at rest at the first motion-capture sample."""
    for a in range(3):
        est.p_WB[a] = mocap.p_WB[a]
        est.v_WB[a] = 0.0
        est.f_ext_W[a] = 0.0
        me.c_B[a] = 0.0
        for c in range(3):
            est.R_WB[a, c] = mocap.R_WB[a, c]
    for n in range(HISTORY):
        for a in range(3):
            me.p[n, a] = est.p_WB[a]
            me.p_BT[n, a] = p_BT[a]
            for c in range(3):
                me.R[n, a, c] = est.R_WB[a, c]
    me.head = 0
    me.ready = 1.0


@helper
def predict(me: Any, body: Any, allocated: Any, est: Any, rotor: Any) -> None:
    """Propagate the estimate over one control period with gyroscope and nominal force."""
    dt = me.dt
    decay = math.exp(-dt / me.rotor_tau)
    acc = local(3)
    for i in range(3):
        made = allocated.f_B_alloc[i]
        rotor.f_B[i] = made + (rotor.f_B[i] - made) * decay
    mat_vec(est.R_WB, rotor.f_B, acc)
    mass = body.mass
    for i in range(3):
        acc[i] = (acc[i] + est.f_ext_W[i]) / mass
    acc[2] -= body.gravity
    turn, step, rot = local(3), local(3, 3), local(3, 3)
    for i in range(3):
        est.p_WB[i] += dt * (est.v_WB[i] + 0.5 * dt * acc[i])
        est.v_WB[i] += dt * acc[i]
        est.w_WB_B[i] = me.gyro[i] - me.bias[i]
        turn[i] = dt * est.w_WB_B[i]
    exp_so3(turn, step)
    mat_mat(est.R_WB, step, rot)
    for i in range(3):
        for j in range(3):
            est.R_WB[i, j] = rot[i, j]


@helper
def correct(me: Any, mocap: Any, t: float, mass: float, est: Any) -> None:
    """Correct by a new motion-capture sample, compared with the estimate at its exposure."""
    dt = me.dt
    back = int((t - mocap.t) / dt + 0.5)
    back = min(max(back, 0), HISTORY - 1)
    h = (me.head - 1 - back) % HISTORY
    period = min(max(mocap.period, dt), 0.2)
    theta = math.exp(-me.bandwidth * period)
    g = 1.0 - theta**3
    hv = 1.5 * (1.0 - theta) ** 2 * (1.0 + theta) / period
    k = (1.0 - theta) ** 3 / (period * period) * mass
    shift = local(3)
    for i in range(3):
        e = mocap.p_WB[i] - me.p[h, i]
        shift[i] = g * e
        est.p_WB[i] += shift[i]
        est.v_WB[i] += hv * e
        est.f_ext_W[i] += k * e
    # attitude: error in B at the exposure; a second-order filter with both poles at theta
    rot, turn, step = local(3, 3), local(3), local(3, 3)
    mat_t_mat(me.R[h], mocap.R_WB, rot)
    log_so3(rot, turn)
    ga = 1.0 - theta * theta
    gb = (1.0 - theta) ** 2 / period
    for i in range(3):
        me.bias[i] -= gb * turn[i] * 0.1  # the bias is slow: a tenth of the filter's speed
        turn[i] *= ga
    exp_so3(turn, step)
    mat_mat(est.R_WB, step, rot)
    for i in range(3):
        for j in range(3):
            est.R_WB[i, j] = rot[i, j]
    orthonormalise(est.R_WB)
    # tip correction, in B
    pred, err = local(3), local(3)
    for i in range(3):
        err[i] = me.p_BT[h, i] + me.c_B[i]
    mat_vec(me.R[h], err, pred)
    for i in range(3):
        pred[i] = mocap.p_WT[i] - me.p[h, i] - pred[i]
    mat_t_vec(me.R[h], pred, err)
    gc = 1.0 - theta
    for i in range(3):
        me.c_B[i] += gc * err[i]
    # apply the corrections to the past estimates too: later samples are compared with them
    for n in range(back + 1):
        j = (me.head - 1 - n) % HISTORY
        mat_mat(me.R[j], step, rot)
        for a in range(3):
            me.p[j, a] += shift[a]
            for c in range(3):
                me.R[j, a, c] = rot[a, c]
