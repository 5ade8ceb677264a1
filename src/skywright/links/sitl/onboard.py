"""Data from the autopilot for the onboard computer: pose, and wrench of the rotors.

The robot's own estimator continues to run: joints, tip, external force and, if the world has no
other localisation for the autopilot, the pose that is sent to the autopilot. The laws receive the
autopilot's estimate of the platform.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from skywright.core.record import Array, Mat3, Record, Vec3
from skywright.core.rotations import exp_so3, mat_mat, mat_vec
from skywright.core.scratch import local
from skywright.core.types import MAX_ROTORS
from skywright.vehicle.bus import Allocated, Clock, Estimate
from skywright.vehicle.component import Component, InOut, helper, table
from skywright.vehicle.estimates import EstimatorState

AHEAD_S = 0.1
"""s for which a pose is extrapolated with its velocity and rates."""


class AutopilotPose(Component):
    """Replaces the estimator's pose by the autopilot's and moves the tip accordingly.

    A pose older than `AHEAD_S` is not extrapolated further.
    """

    slot = "estimate"

    class Me(Record):
        given: float  # 1: a pose was received
        t: float  # s, of p and v
        t_turn: float  # s, of R and w
        heard: float  # s, when its position was last valid
        std: float  # m; NaN: not reported
        p_WB: Vec3
        v_WB: Vec3
        R_WB: Mat3
        w_WB_B: Vec3
        own_ready: float  # from the robot's own estimator
        own_p: Vec3
        own_R: Mat3
        own_std: float

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Start without a pose."""
        me.std = me.own_std = math.nan
        for i in range(3):
            me.R_WB[i, i] = me.own_R[i, i] = 1.0

    @staticmethod
    def step(me: Me, clock: Clock, est: InOut[Estimate], state: InOut[EstimatorState]) -> None:
        me.own_ready, me.own_std = state.ready, state.pose_std
        if state.ready < 0.5:
            return
        for i in range(3):
            me.own_p[i] = est.p_WB[i]
            for j in range(3):
                me.own_R[i, j] = est.R_WB[i, j]
        state.ready = me.given
        if me.given < 0.5:
            return
        state.heard, state.pose_std = me.heard, me.std
        turn, step, R = local(3, 3), local(3), local(3, 3)
        ahead = min(max(clock.t - me.t_turn, 0.0), AHEAD_S)
        for i in range(3):
            step[i] = me.w_WB_B[i] * ahead
        exp_so3(step, turn)
        mat_mat(me.R_WB, turn, R)
        ahead = min(max(clock.t - me.t, 0.0), AHEAD_S)
        move_estimate(me, est, R, ahead)


@helper
def move_estimate(me: Any, est: Any, R: Any, ahead: float) -> None:
    """Set attitude R, and the position `ahead` (s) of the reported one, in the estimate."""
    turn, arm, told, tip = local(3, 3), local(3), local(3), local(3, 3)
    for i in range(3):  # turn = R R_own', in W
        for j in range(3):
            turn[i, j] = (
                R[i, 0] * me.own_R[j, 0] + R[i, 1] * me.own_R[j, 1] + R[i, 2] * me.own_R[j, 2]
            )
    for i in range(3):
        arm[i] = est.p_WT[i] - me.own_p[i]
    mat_vec(turn, arm, told)
    for i in range(3):
        arm[i] = est.v_WT[i] - est.v_WB[i]
        est.p_WB[i] = me.p_WB[i] + ahead * me.v_WB[i]
        est.p_WT[i] = est.p_WB[i] + told[i]
    mat_vec(turn, arm, told)
    mat_mat(turn, est.R_WT, tip)
    for i in range(3):
        est.v_WB[i] = me.v_WB[i]
        est.v_WT[i] = me.v_WB[i] + told[i]
        est.w_WB_B[i] = me.w_WB_B[i]
        for j in range(3):
            est.R_WB[i, j] = R[i, j]
            est.R_WT[i, j] = tip[i, j]


class AutopilotRotors(Component):
    """Replaces the wrench of the robot's allocation by that of the autopilot's commands."""

    slot = "allocate"

    class Me(Record):
        B: int  # address of the wrenches per newton
        n: int
        saturated: float  # 1: a rotor is at its limit
        thrust: Annotated[Array, MAX_ROTORS]  # N, commanded

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Store the nominal rotors."""
        a = context.allocator
        me.B, me.n = context.keep(a.B), len(a.t_min)

    @staticmethod
    def step(me: Me, out: InOut[Allocated]) -> None:
        B = table(me.B, 6, me.n)
        out.saturated = me.saturated
        for r in range(3):
            f = t = 0.0
            for i in range(me.n):
                f += B[r, i] * me.thrust[i]
                t += B[r + 3, i] * me.thrust[i]
            out.f_B_alloc[r], out.t_B_alloc[r] = f, t
