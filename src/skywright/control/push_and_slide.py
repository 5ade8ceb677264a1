"""Tognon et al. 2018, section V: the dislocated PID of a fully actuated platform with an arm.

Attitude and arm follow their nominal trajectories, laws (3) and (2). The platform's force closes
the position loop at the tip, law (4), with the platform's velocity as damping: position of the
link's far end and velocity of its driven end, which is stable across the arm's elasticity.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.pid import arm_velocity, attitude_torque, position_force, rest, to_body
from skywright.control.signature import LAW

Record = Any


@njit(cache=True, error_model="numpy")
def step(par: Record, mem: Record, ref: Record, est: Record, body: Record, cmd: Record) -> None:
    """Laws (2), (3), (4): fill `cmd.f_B`, `cmd.t_B`, `cmd.qd`."""
    arm_velocity(par, ref, est, body, cmd.qd)
    if ref.active < 0.5:
        rest(mem, cmd)
        return
    f_W = np.empty(3)
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
