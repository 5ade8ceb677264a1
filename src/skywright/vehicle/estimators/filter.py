"""Error-state Kalman filter of inertial unit and external localisation, with a delayed horizon.

External localisation is motion capture (`fuse`) or fixes of a point (_position_fix.py).

State: position p and velocity v of the inertial unit in W, attitude R_WB, gyroscope bias b_g and
accelerometer bias b_a in B. The error is (dp, dv, dtheta, db_g, db_a), 15 numbers, with the
attitude error in W: R_true = exp(dtheta) R (Sola, Quaternion kinematics for the error-state Kalman
filter, 2017, arXiv 1711.02508, section 7, "global angular errors").

Delay: a motion-capture sample is fused into the state at its exposure, then the later inertial
samples are integrated again. The covariance is kept at the horizon only, so each inertial sample
enters it once and no past covariance is stored. For samples in order this equals a filter without
delay, followed by a prediction. The state is integrated at the rate of the inertial unit (1 kHz),
the covariance in steps of at most COVARIANCE_STEP samples.

Integration and covariance step are in _strapdown.py.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Mat3, Vec3
from skywright.core.rotations import log_so3, mat_t_mat, mat_vec
from skywright.core.scratch import local
from skywright.core.types import IMU_HISTORY
from skywright.vehicle.bus import Allocated, Body, Clock, Estimate
from skywright.vehicle.component import Component, Estimator, InOut, Out, helper
from skywright.vehicle.estimates import POSITION_COLUMNS, EstimatorState, RotorForce
from skywright.vehicle.estimators._deviation import fill_deviation
from skywright.vehicle.estimators._kalman import correct, inject, place_point
from skywright.vehicle.estimators._noise import (
    EARLY,
    KNOWN_AFTER,
    LEAST,
    MOST,
    ROW,
    Scatter,
    compute_product,
    compute_scatter,
    is_leaving,
    keep_innovation,
    widen,
)
from skywright.vehicle.estimators._position_fix import (
    FixNoise,
    fuse_fix,
    judge_again,
    move_to_fix,
    start_from_fix,
)
from skywright.vehicle.estimators._strapdown import (
    BA_,
    BG_,
    MASK,
    N_STATE,
    P_,
    R_,
    SPEED_START,
    V_,
    Strapdown,
    advance,
    fill_strapdown,
    predict_now,
    receive_inertial,
)
from skywright.vehicle.estimators.station_camera import StationCamera
from skywright.vehicle.readings import Fix, ImuBatch, MocapSample
from skywright.vehicle.tip import TIP_WALK, correct_tip

GATE = 22.46  # chi-square of 6 degrees of freedom at 99.9 %
RESTART_AFTER = ROW  # rejected samples in a row that agree with each other
AGREE_P, AGREE_R = 0.1, 0.2  # m, rad: largest difference of two samples that agree
AGREE_SIGMAS = 4.0  # of the noise of fixes, in addition
AGREE_SPEED = 10.0  # m/s, of the robot between two fixes that agree
LATE = 16  # inertial samples by which a fix may arrive later than its latency
SHEET_WORTH = 5.0  # samples that correspond to a data sheet, whose noise is 20 % off
LEAST_NOISE = 1e-10  # m^2 and rad^2: keeps the innovation covariance of a perfect sensor regular


class Filter(Estimator):
    """Fills Estimate from the inertial unit and from motion capture or fixes of a point."""

    columns = POSITION_COLUMNS

    class Me(Strapdown, FixNoise, Scatter):
        r_p: float  # m^2, motion capture
        r_R: float  # rad^2
        sheet_p: float  # m^2, as the data sheet has it
        sheet_R: float  # rad^2
        # state of the gate
        nu: Annotated[Array, 6]  # whitened innovation of the last fused sample
        nis: float  # squared normalised innovation of the last sample
        last_fix: float  # s, of the newest sample that was fused
        fused: int
        rejected_row: int
        late: int  # fixes that arrived after the horizon had passed their time
        keep: int  # inertial samples that stay behind the present if no fix arrives
        refused: int  # samples in a row that the gate rejected
        restarts: int
        last_p: Vec3
        last_t: float  # s, of the newest fix
        last_R: Mat3

    @classmethod
    def assemble(cls, table: Any, context: Any) -> list[Component]:
        """Return the filter for the world's localisation."""
        if context.world.localisation == "total-station":
            return StationCamera.assemble(StationCamera.Table(), context)
        return super().assemble(table, context)

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Read the data sheets' values."""
        fill_strapdown(me, context)
        m, fix, s = context.world.mocap, context.world.gnss.errors, context.robot.sensors
        # correlated errors of fixes look like motion: they enter the stated deviation only
        me.p_slow = [fix.drift_level_m, fix.drift_level_m, fix.drift_up_m]
        if context.world.localisation != "gnss":
            me.p_slow = 0.0
        me.p_BF = [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
        delay = context.world.gnss.latency_s
        if context.world.localisation != "gnss":
            delay = m.latency_s
        # a fix that is under way must not find the horizon beyond its time
        me.keep = max(IMU_HISTORY // 4, math.ceil(delay / me.h) + LATE)
        noise = [fix.noise_level_m, fix.noise_level_m, fix.noise_up_m]
        me.r_fix = np.maximum(noise, 1e-5) ** 2
        me.r_heading = max(math.radians(fix.heading_noise_deg), 1e-5) ** 2
        me.r_p = max(m.position_noise_m**2, LEAST_NOISE)
        me.r_R = max(m.attitude_noise_rad**2, LEAST_NOISE)
        me.sheet_p, me.sheet_R = me.r_p, me.r_R
        me.more_fix = me.more_heading = 1.0
        me.q_c, me.P_c = TIP_WALK**2, 1e-4
        me.r_c = 2.0 * me.r_p

    @staticmethod
    def step(
        me: Me,
        clock: Clock,
        imu: ImuBatch,
        mocap: InOut[MocapSample] | None,
        fix: Fix | None,
        body: Body,
        allocated: Allocated,
        est: Out[Estimate],
        rotor: Out[RotorForce],
        state: Out[EstimatorState],
    ) -> None:
        est.t = clock.t
        before, changed = me.n, False
        if imu.n > 0:
            receive_inertial(me, imu, body)
        if mocap is not None and mocap.fresh > 0.0:
            state.heard = clock.t
            changed = use_mocap(me, mocap, imu.t, body.gravity)
        if fix is not None and fix.fresh > 0.0:
            state.heard = clock.t
            changed = changed or use_fix(me, fix, imu.t, body.gravity)
        state.ready = 1.0 if me.ready == 2.0 else 0.0
        if me.ready < 2.0:
            return
        if me.n - me.n_f > IMU_HISTORY // 2:  # no sample for long: stay within the ring buffer
            advance(me, me.n - me.keep, body.gravity)
            changed = True
        predict_now(me, imu, body, allocated, est, rotor, clock.t, before, changed)
        state.rejected, state.restarts = float(me.refused), float(me.restarts)
        state.fix_age = clock.t - me.last_fix
        fill_deviation(me, me.P, body.gravity, state)


@helper
def fuse(me: Any, mocap: Any) -> bool:
    """Fuse a motion-capture sample taken at the horizon; returns False if the gate rejects it.

    The filter estimates the noise from the residuals (compute_product), starting from the data
    sheet.
    """
    H, nu, r, lever = local(6, N_STATE), local(6), local(6), local(3)
    rot, turn, dx, before = local(3, 3), local(3), local(N_STATE), local(6)
    for i in range(6):
        for j in range(N_STATE):
            H[i, j] = 0.0
    for i in range(3):
        turn[i] = 0.0
    place_point(me, turn, H, lever)
    for i in range(3):
        for j in range(3):  # R_meas R_f'
            rot[i, j] = (
                mocap.R_WB[i, 0] * me.R_f[j, 0]
                + mocap.R_WB[i, 1] * me.R_f[j, 1]
                + mocap.R_WB[i, 2] * me.R_f[j, 2]
            )
    log_so3(rot, turn)
    for i in range(3):
        nu[i] = mocap.p_WB[i] - (me.p_f[i] + lever[i])
        r[i] = me.r_p
        nu[3 + i] = turn[i]
        H[3 + i, R_ + i] = 1.0
        r[3 + i] = me.r_R
    for i in range(6):
        before[i] = nu[i]
    me.nis = correct(me.P, H, nu, r, GATE, dx)
    if not me.nis < GATE:
        keep_innovation(me, before, mocap.t)
        return False
    gain = 1.0 / min(me.fused + SHEET_WORTH, KNOWN_AFTER)
    for i in range(6):
        me.nu[i] = nu[i]
        found = compute_product(before, H, dx, i)
        if i < 3:
            me.r_p += gain / 3.0 * (found - me.r_p)
        else:
            me.r_R += gain / 3.0 * (found - me.r_R)
    me.r_p, me.r_R = max(me.r_p, LEAST_NOISE), max(me.r_R, LEAST_NOISE)
    me.r_c = 2.0 * me.r_p  # of the tip: includes the error of the platform's position
    inject(me, dx)
    return True


@helper
def fuse_again(me: Any, mocap: Any) -> bool:
    """Fuse a rejected sample with the noise of the samples in its row, if they scatter by more.

    Returns False, with the noise as before, if they do not, or if the sample is rejected again.
    """
    p, turn = compute_scatter(me, 0, 3, ROW), compute_scatter(me, 3, 3, ROW)
    if not (p <= MOST * me.sheet_p and turn <= MOST * me.sheet_R):
        return False  # also if one is not a number
    if p < LEAST * me.r_p and turn < LEAST * me.r_R:
        return False
    r_p, r_R, fused = me.r_p, me.r_R, me.fused
    me.r_p, me.r_R = max(p, r_p), max(turn, r_R)
    widen(me, me.r_p / r_p, me.r_R / r_R)
    me.fused = ROW  # the samples that the noise is now known from
    me.rejected -= 1
    if fuse(me, mocap):
        return True
    me.r_p, me.r_R, me.fused = r_p, r_R, fused
    return False  # the covariance is set anew


@helper
def agrees_with_last(me: Any, mocap: Any) -> bool:
    """Return whether a sample agrees with the last one given here, and store it as the last."""
    rot, turn = local(3, 3), local(3)
    mat_t_mat(me.last_R, mocap.R_WB, rot)
    log_so3(rot, turn)
    far = angle = 0.0
    for i in range(3):
        far += (mocap.p_WB[i] - me.last_p[i]) ** 2
        angle += turn[i] ** 2
        me.last_p[i] = mocap.p_WB[i]
        for j in range(3):
            me.last_R[i, j] = mocap.R_WB[i, j]
    return far < AGREE_P**2 and angle < AGREE_R**2


@helper
def start_at(me: Any, mocap: Any, n: int) -> None:
    """Start at rest at a motion-capture sample taken at inertial sample `n`."""
    lever = local(3)
    mat_vec(mocap.R_WB, me.p_BI, lever)
    for i in range(N_STATE):
        for j in range(N_STATE):
            me.P[i, j] = 0.0
    for i in range(3):
        me.p_f[i] = mocap.p_WB[i] + lever[i]
        me.v_f[i] = 0.0
        me.bg[i] = me.ba[i] = 0.0
        for j in range(3):
            me.R_f[i, j] = mocap.R_WB[i, j]
        me.P[P_ + i, P_ + i] = me.r_p
        me.P[V_ + i, V_ + i] = SPEED_START**2
        me.P[R_ + i, R_ + i] = me.r_R
        me.P[BG_ + i, BG_ + i] = me.p_bg
        me.P[BA_ + i, BA_ + i] = me.p_ba
    me.n_f = n
    me.ready = 2.0
    me.rejected_row = 0


@helper
def use_mocap(me: Any, mocap: Any, t: float, gravity: float) -> bool:
    """Advance the horizon to the exposure and fuse the sample; returns False if nothing changed."""
    n = me.n - int((t - mocap.t) / me.h + 0.5)
    if n > me.n or n < 0 or n <= me.n - IMU_HISTORY:
        return False  # outside the stored inertial samples
    if me.ready < 2.0:  # the filter starts at two samples that agree: one may be an artefact
        agrees = agrees_with_last(me, mocap)
        if me.ready == 1.0 and agrees:
            start_at(me, mocap, n)
        me.ready = max(me.ready, 1.0)
        return me.ready == 2.0
    if n < me.n_f:
        me.late += 1
        return False
    advance(me, n, gravity)
    good = fuse(me, mocap)
    if not good:
        me.refused += 1
        me.rejected_row = me.rejected_row + 1 if agrees_with_last(me, mocap) else 1
        if me.rejected_row >= RESTART_AFTER:  # they agree with each other: noise or filter is wrong
            good = fuse_again(me, mocap)
            if not good:
                start_at(me, mocap, n)
                me.restarts += 1
    if good:
        me.last_fix = mocap.t
        me.fused += 1
        me.rejected_row = me.refused = 0
    correct_tip(me, mocap, me.c_B, me.p_f, me.R_f, me.p_BI, me.p_BT[(n - 1) & MASK])
    return True


@helper
def use_fix(me: Any, fix: Any, t: float, gravity: float) -> bool:
    """Advance the horizon to the time of a fix and fuse it; returns False if nothing changed."""
    n = me.n - int((t - fix.t) / me.h + 0.5)
    if me.ready == 2.0 and n < me.n_f:
        me.late += 1
    if n > me.n or n < me.n_f or n <= me.n - IMU_HISTORY:
        return False
    far = spread = 0.0
    for i in range(3):
        far += (fix.p[i] - me.last_p[i]) ** 2
        spread += me.r_fix[i]
        me.last_p[i] = fix.p[i]
    moved = AGREE_SPEED * (fix.t - me.last_t) if me.ready == 2.0 else 0.0  # it starts at rest
    me.last_t = fix.t
    agrees = far < (AGREE_P + moved) ** 2 + AGREE_SIGMAS**2 * spread
    if me.ready < 2.0:
        if me.ready == 1.0 and agrees:
            start_from_fix(me, fix, n, gravity, SPEED_START)
        me.ready = max(me.ready, 1.0)
        return me.ready == 2.0
    advance(me, n, gravity)
    good = fuse_fix(me, fix)
    if not good:
        me.refused += 1
        me.rejected_row = me.rejected_row + 1 if agrees else 1
        if me.rejected_row >= EARLY and is_leaving(me):
            move_to_fix(me, fix, gravity)
            me.restarts += 1
        elif me.rejected_row >= RESTART_AFTER:
            good = judge_again(me, fix)
            if not good:
                move_to_fix(me, fix, gravity)
                me.restarts += 1
    if good:
        me.last_fix = fix.t
        me.fused += 1
        me.rejected_row = me.refused = 0
    return True
