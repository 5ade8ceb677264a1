"""A control law of your own: LQR of the platform's position, its gains tabled over the mass.

    skywright run waypoints --robot othex --set mission.law=examples/laws/lqr.py:Lqr
    skywright run waypoints --robot othex --set mission.law=examples/laws/lqr.py:Lqr \\
        --set mission.law.q=20000

The attitude follows law (3) of Tognon 2018, with the bandwidths of [robot.control]. SI and radians;
W is the world, B the body.
"""

from typing import Annotated

import numpy as np
from scipy.linalg import solve_continuous_are

from skywright.core.record import Array, Vec3
from skywright.core.scratch import local
from skywright.core.spec import Positive
from skywright.vehicle.bus import Allocated, Body, Estimate, Reference, WrenchCommand
from skywright.vehicle.component import Law, Out
from skywright.vehicle.loops import (
    ArmLoop,
    ArmTable,
    AttitudeLoop,
    AttitudeTable,
    arm_velocity,
    fill_arm,
    fill_attitude,
    hold_attitude,
    to_body,
)

N = 5  # masses in the table


class Lqr(Law):
    """f_W = m (a_des + g) + K(m) (position error, velocity error); for fully actuated robots."""

    needs_full_actuation = True

    class Table(AttitudeTable, ArmTable):
        """[mission.law]: weights of the cost; bandwidths of the loops taken from Skywright."""

        q: Positive = 10000.0  # of the position's error (1/m^2)
        q_dot: Positive = 400.0  # of the velocity's ((s/m)^2)
        r: Positive = 1.0  # of the force (1/N^2)
        range: Positive = 0.3  # the table covers the mass times 1 -+ this

    class Me(AttitudeLoop, ArmLoop):
        mass: Annotated[Array, N]  # kg
        K: Annotated[Array, N, 2]  # N/m and N s/m
        error: Vec3  # m, the last one: a memory, as an integral would be

    def build(self, me, table, context):
        """Solve the Riccati equation for each mass of the table, once, before the flight."""
        fill_attitude(me, table, context)
        fill_arm(me, table, context)
        me.mass[:] = context.mass * np.linspace(1.0 - table.range, 1.0 + table.range, N)
        A, Q = np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([table.q, table.q_dot])
        for i, mass in enumerate(me.mass):
            B = np.array([[0.0], [1.0 / mass]])
            P = solve_continuous_are(A, B, Q, np.eye(1) * table.r)
            me.K[i] = (B.T @ P)[0] / table.r

    @staticmethod
    def step(
        me: Me, ref: Reference, est: Estimate, body: Body, allocated: Allocated,
        cmd: Out[WrenchCommand],
    ) -> None:  # fmt: skip
        """Run at the control rate, compiled; `compiled = False` in the class runs it as Python."""
        arm_velocity(me, ref, est, body, cmd.qd)
        if ref.active < 0.5:  # motors off
            for i in range(3):
                cmd.f_B[i] = cmd.t_B[i] = me.theta[i] = 0.0
            return
        k, d = np.interp(body.mass, me.mass, me.K[:, 0]), np.interp(body.mass, me.mass, me.K[:, 1])
        f_W = local(3)  # an array on the stack: steps do not allocate
        for i in range(3):
            me.error[i] = ref.p_WB[i] - est.p_WB[i]
            f_W[i] = body.mass * ref.a_WB[i] + k * me.error[i]
            f_W[i] += d * (ref.v_WB[i] - est.v_WB[i])
        f_W[2] += body.mass * body.gravity
        to_body(est, f_W, cmd.f_B)
        hold_attitude(me, ref, est, body, allocated.saturated, cmd)
