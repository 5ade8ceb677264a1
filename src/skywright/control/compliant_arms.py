"""Law of compliant arms with position servos (Suarez 2020, sections V-A to V-D).

Runs at the servos' rate and fills `cmd.theta`, the commanded shaft angles.
"""

from __future__ import annotations

from typing import Any

from numba import carray, cfunc, njit

from skywright.control.signature import LAW
from skywright.models.compliant_arms import spring_deflection

Record = Any


@njit(cache=True, error_model="numpy")
def step(b: Record) -> None:
    """Fill `cmd.theta` for the tasks in `ref.task`."""
    arms = b.arms
    for h in range(arms.n_hands):
        for j in range(arms.first[h], arms.first[h] + arms.n):
            hold_joint(b, j, b.ref.q[j])


@njit(cache=True, error_model="numpy")
def hold_joint(b: Record, j: int, q: float) -> None:
    """Command the shaft so that the output link comes to `q` (rad) against its weight."""
    arms, shift = b.arms, 0.0
    if arms.k[j] > 0.0:
        shift = spring_deflection(arms.k[j], arms.linear[j], arms.hardening[j], arms.t_gravity[j])
    b.cmd.theta[j] = min(max(q, arms.q_min[j]), arms.q_max[j]) + shift
    arms.theta_ref[j] = b.cmd.theta[j]


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF."""
    step(belief[0])


@cfunc(LAW, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all laws."""
    step(carray(belief, 1)[0])
