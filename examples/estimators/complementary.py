"""An estimator of your own: motion capture for the position, gyroscope for the attitude.

    skywright run waypoints --robot othex \\
        --set mission.estimator=examples/estimators/complementary.py:Complementary

Position and velocity follow the samples with two gains (an alpha-beta filter, both poles at
exp(-w T)); the attitude integrates the gyroscope and is pulled to the samples. It has no inertial
prediction and does not know the delay of a sample, which the built-in filter does.
"""

import math

from skywright.core.record import Mat3, Record, Vec3
from skywright.core.rotations import exp_so3, log_so3, mat_mat, mat_t_mat, orthonormalise
from skywright.core.scratch import local
from skywright.core.spec import Positive, Spec
from skywright.vehicle.bus import Body, Clock, Estimate
from skywright.vehicle.component import Estimator, Out
from skywright.vehicle.estimates import EstimatorState
from skywright.vehicle.readings import ImuBatch, MocapSample
from skywright.vehicle.tip import fill_tip


class Complementary(Estimator):
    """Fills Estimate."""

    needs_motion_capture = True

    class Table(Spec):
        """[mission.estimator]"""

        bandwidth_rad_s: Positive = 40.0  # of position and velocity
        attitude_bandwidth_rad_s: Positive = 10.0

    class Me(Record):
        dt: float  # s
        bandwidth: float
        attitude: float
        ready: float
        c_B: Vec3  # m, correction of the tip: none here
        step_R: Mat3

    def build(self, me, table, context):
        """Take the bandwidths."""
        me.dt, me.bandwidth = context.dt, table.bandwidth_rad_s
        me.attitude = table.attitude_bandwidth_rad_s

    @staticmethod
    def step(
        me: Me, clock: Clock, imu: ImuBatch, mocap: MocapSample, body: Body, est: Out[Estimate],
        state: Out[EstimatorState],
    ) -> None:  # fmt: skip
        """Run at the control rate, compiled."""
        est.t = clock.t
        turn, rot, error = local(3), local(3, 3), local(3)
        for i in range(3):
            if imu.n > 0:
                est.w_WB_B[i] = imu.gyro[imu.n - 1, i]
            turn[i] = me.dt * est.w_WB_B[i]
            est.p_WB[i] += me.dt * est.v_WB[i]
        exp_so3(turn, me.step_R)
        mat_mat(est.R_WB, me.step_R, rot)
        for i in range(3):
            for j in range(3):
                est.R_WB[i, j] = rot[i, j]
        if mocap.fresh > 0.0:
            pole = math.exp(-me.bandwidth * mocap.period) if me.ready > 0.0 else 0.0
            mat_t_mat(est.R_WB, mocap.R_WB, rot)
            log_so3(rot, error)
            share = 1.0 - math.exp(-me.attitude * mocap.period) if me.ready > 0.0 else 1.0
            for i in range(3):
                error[i] *= share
                far = mocap.p_WB[i] - est.p_WB[i]
                est.p_WB[i] += (1.0 - pole * pole) * far
                if me.ready > 0.0:
                    est.v_WB[i] += (1.0 - pole) * (1.0 - pole) / mocap.period * far
            exp_so3(error, me.step_R)
            mat_mat(est.R_WB, me.step_R, rot)
            for i in range(3):
                for j in range(3):
                    est.R_WB[i, j] = rot[i, j]
            orthonormalise(est.R_WB)
            me.ready = state.ready = 1.0
            state.heard = clock.t
        fill_tip(est, body, me.c_B)
