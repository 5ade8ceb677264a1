"""Law of compliant arms with position servos (Suarez 2020, sections V-B to V-E).

Runs at the servos' rate and fills `cmd.theta`, the commanded shaft angles, for what `ref.task` asks
of each hand (core/types.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from skywright.control.hand_force import (
    let_out,
    squeeze_force,
    step_force,
    step_hold_position,
)
from skywright.control.hand_motion import (
    move_hand,
    start_hand,
    step_position,
    step_to_marker,
    step_velocity,
)
from skywright.control.joint_loops import follow_shafts, hold_joint, step_joint
from skywright.control.signature import LAW
from skywright.core.types import (
    TASK_FORCE,
    TASK_JOINTS,
    TASK_LOOPS,
    TASK_POSITION,
    TASK_SQUEEZE,
    TASK_VISUAL,
)
from skywright.models.arm_singularity import watch_singularity

Record = Any


@njit(cache=True, error_model="numpy")
def is_force(task: int) -> bool:
    """Whether a task asks for a force (core/types.py)."""
    return TASK_FORCE <= task <= TASK_SQUEEZE


@njit(cache=True, error_model="numpy")
def step(b: Record) -> None:
    """Fill `cmd.theta` for the tasks in `ref.task`."""
    arms, ref = b.arms, b.ref
    dr, f_ref, zero = np.zeros(3), np.zeros(3), np.zeros(3)
    follow_shafts(b)
    for h in range(arms.n_hands):
        task = int(ref.task[h])
        for a in range(3):
            f_ref[a] = ref.f_WH[h, a]
        if arms.chain:
            # a force is led in all of the arm's plane: what counts is the worst direction there
            watch_singularity(b, h, zero if task == TASK_FORCE else f_ref)
        if not is_force(task):
            let_out(b, h)
        if task == TASK_JOINTS or (task != TASK_LOOPS and arms.chain == 0):
            for j in range(arms.first[h], arms.first[h] + arms.n):
                hold_joint(b, j, ref.q[j], True)
            arms.task_last[h] = TASK_JOINTS
            continue
        if arms.chain and task != arms.task_last[h]:
            start_hand(b, h)
        if task == TASK_LOOPS:
            for j in range(arms.first[h], arms.first[h] + arms.n):
                if task != arms.task_last[h]:
                    arms.i_torque[j] = arms.i_position[j] = 0.0
                step_joint(b, j, ref.delta[j], ref.q[j], ref.tau[j])
            arms.task_last[h] = task
            continue
        arms.task_last[h] = task
        if is_force(task):
            gamma = 1.0
            dr[:] = 0.0
            arms.saturated[h] = 0.0
            if task == TASK_SQUEEZE:
                squeeze_force(b, h, f_ref)
            if task != TASK_FORCE:  # (31): gamma dr_F + (1 - gamma) dr_P
                gamma = min(max(ref.gamma[h], 0.0), 1.0)
                step_hold_position(b, h, gamma, dr)
            step_force(b, h, f_ref, gamma, task != TASK_FORCE)
        elif task == TASK_POSITION:
            step_position(b, h, dr)
        elif task == TASK_VISUAL:
            step_to_marker(b, h, dr)
        else:
            step_velocity(b, h, dr)
        move_hand(b, h, dr, not is_force(task))


@njit(cache=True, error_model="numpy")
def step_belief(belief: Any) -> None:
    """`step` on a (1,) array of BELIEF."""
    step(belief[0])


@cfunc(LAW, cache=True)
def step_c(belief: Any) -> None:
    """`step` behind the one signature of all laws."""
    step(carray(belief, 1)[0])
