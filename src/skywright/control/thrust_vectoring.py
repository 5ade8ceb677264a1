"""Cascade of a coplanar multirotor: the position loop asks for a force, the attitude points to it.

The force law is the same as for a fully actuated platform; thrust goes along z_B, so the attitude's
reference is the direction of the force with the nominal heading (Lee, Leok, McClamroch 2010, CDC,
eq. 12-16, with a tilt limit). Robots with tilted rotors can fly it too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.pid import arm_velocity, attitude_torque, position_force, rest
from skywright.control.signature import LAW
from skywright.core.rotations import cross, norm

Record = Any


@njit(cache=True, error_model="numpy")
def aim_thrust(par: Record, ref: Record, est: Record, body: Record, f_W: Any, R_des: Any) -> float:
    """Limit the wanted force f_W (3,) N in place, fill R_des with z along it; return the thrust.

    The thrust (N) is the part of f_W along the present z_B, within the limits.
    """
    # tilt limit: lateral force at most tan(tilt) times the vertical one, which stays positive
    f_W[2] = min(max(f_W[2], 0.3 * body.mass * body.gravity), par.thrust_max)
    lateral = math.sqrt(f_W[0] * f_W[0] + f_W[1] * f_W[1])
    limit = f_W[2] * math.tan(par.tilt_max)
    if lateral > limit:
        f_W[0] *= limit / lateral
        f_W[1] *= limit / lateral
    z, y, x, heading = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    length = norm(f_W)
    for i in range(3):
        z[i] = f_W[i] / length
        heading[i] = ref.R_WB[i, 0]
    cross(z, heading, y)
    length = norm(y)
    for i in range(3):
        y[i] /= length
    cross(y, z, x)
    thrust = 0.0
    for i in range(3):
        R_des[i, 0], R_des[i, 1], R_des[i, 2] = x[i], y[i], z[i]
        thrust += f_W[i] * est.R_WB[i, 2]
    return min(max(thrust, 0.0), par.thrust_max)


@njit(cache=True, error_model="numpy")
def step(par: Record, mem: Record, ref: Record, est: Record, body: Record, cmd: Record) -> None:
    """Fill `cmd.f_B` = (0, 0, T), `cmd.t_B` and `cmd.qd`."""
    arm_velocity(par, ref, est, body, cmd.qd)
    if ref.active < 0.5:
        rest(mem, cmd)
        return
    f_W = np.empty(3)
    position_force(par, mem, ref, est, body, cmd.saturated, f_W)
    R_des = np.empty((3, 3))
    w_des, wd_des = np.zeros(3), np.zeros(3)
    cmd.f_B[0] = 0.0
    cmd.f_B[1] = 0.0
    cmd.f_B[2] = aim_thrust(par, ref, est, body, f_W, R_des)
    w_des[2] = ref.w_WB_B[2]
    wd_des[2] = ref.wd_WB_B[2]
    attitude_torque(par, mem, R_des, w_des, wd_des, est, body, cmd.f_B, cmd.saturated, cmd.t_B)


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF: one argument, so that a call from Python stays cheap."""
    b = belief[0]
    step(b.par, b.mem, b.ref, b.est, b.body, b.cmd)


@cfunc(LAW, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all laws."""
    b = carray(belief, 1)[0]
    step(b.par, b.mem, b.ref, b.est, b.body, b.cmd)
