"""Pure joint-space control: every degree of freedom tracks its own nominal trajectory.

Tognon et al. 2018, section V, name it as the simple solution and reject it: the tip is nowhere fed
back, so errors of the kinematic model, the servos and the structure go to the tip in full. Laws
(2) and (3) as in `push_and_slide`; the force is law (4) with the platform's position error in place
of the tip's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.pid import arm_velocity, attitude_torque, force_from_errors, rest, to_body
from skywright.control.signature import LAW

Record = Any


@njit(cache=True, error_model="numpy")
def step(par: Record, mem: Record, ref: Record, est: Record, body: Record, cmd: Record) -> None:
    """Laws (2), (3) and f_W = -g_1 + M_11 a^n + K^D (v^n - v) + K^P (p_R^n - p_R) + sigma."""
    arm_velocity(par, ref, est, body, cmd.qd)
    if ref.active < 0.5:
        rest(mem, cmd)
        return
    e, v, f_W = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        e[i] = ref.p_WB[i] - est.p_WB[i]
        v[i] = ref.v_WB[i] - est.v_WB[i]
    force_from_errors(par, mem, ref, body, e, v, cmd.saturated, f_W)
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
