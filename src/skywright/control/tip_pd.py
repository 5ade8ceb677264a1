"""Feedback of tip position and tip velocity alone, across the arm's elasticity.

Tognon et al. 2018, section V, after De Luca and Book (Springer Handbook of Robotics, 2008, ch. 13):
for a joint with an elastic transmission this is unstable for every gain, while link position with
motor velocity (`push_and_slide`) is stable for suitable ones. Kept to show it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.pid import (
    arm_velocity,
    attitude_torque,
    force_from_errors,
    position_force,
    rest,
    to_body,
)
from skywright.control.signature import LAW

Record = Any

DERIVATIVE = 0.004
"""s, time constant of the derivative of the measured tip. The estimate's own tip velocity comes
from rigid kinematics and does not see the arm bend, which is the point here."""

_STARTED, _P, _V = 0, 1, 4  # places in mem.user: flag, last tip position, tip velocity


@njit(cache=True, error_model="numpy")
def tip_velocity(par: Record, mem: Record, est: Record, v: Any) -> None:
    """Filtered derivative of the tip's measured position: v += dt / (tau + dt) (dp / dt - v)."""
    u = mem.user
    for i in range(3):
        if u[_STARTED] > 0.5:
            rate = (est.p_WT[i] - u[_P + i]) / par.dt
            u[_V + i] += par.dt / (DERIVATIVE + par.dt) * (rate - u[_V + i])
        u[_P + i] = est.p_WT[i]
        v[i] = u[_V + i]
    u[_STARTED] = 1.0


@njit(cache=True, error_model="numpy")
def step(par: Record, mem: Record, ref: Record, est: Record, body: Record, cmd: Record) -> None:
    """Laws (2), (3); while the tip is tracked f_W = ... + K^D (v_E^d - v_E) + K^P e_E + sigma."""
    arm_velocity(par, ref, est, body, cmd.qd)
    v, f_W = np.empty(3), np.empty(3)
    tip_velocity(par, mem, est, v)
    if ref.active < 0.5:
        rest(mem, cmd)
        return
    if ref.track_tip > 0.5:
        e = np.empty(3)
        for i in range(3):
            e[i] = ref.p_WT[i] - est.p_WT[i]
            v[i] = ref.v_WT[i] - v[i]
        force_from_errors(par, mem, ref, body, e, v, cmd.saturated, f_W)
    else:
        position_force(par, mem, ref, est, body, cmd.saturated, f_W)
    to_body(est, f_W, cmd.f_B)
    attitude_torque(
        par, mem, ref.R_WB, ref.w_WB_B, ref.wd_WB_B, est, body, cmd.f_B, cmd.saturated, cmd.t_B
    )


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
