"""Law of compliant arms with position servos (Suarez 2020, sections V-B to V-E).

Runs at the servos' rate and fills the shafts' commanded angles for what HandsReference asks of each
hand (the tasks in core/types.py).
"""

from __future__ import annotations

import math
from typing import Any

from skywright.core.scratch import local
from skywright.core.types import (
    TASK_FORCE,
    TASK_JOINTS,
    TASK_LOOPS,
    TASK_POSITION,
    TASK_SQUEEZE,
    TASK_VISUAL,
)
from skywright.vehicle.arms.hand_force import (
    let_out,
    squeeze_force,
    step_force,
    step_hold_position,
)
from skywright.vehicle.arms.hand_motion import (
    move_hand,
    start_hand,
    step_position,
    step_to_marker,
    step_velocity,
)
from skywright.vehicle.arms.joint_loops import follow_shafts, hold_joint, step_joint
from skywright.vehicle.arms.joints import build_arm_model, fill_home
from skywright.vehicle.arms.ports import (
    ArmModel,
    HandForce,
    Hands,
    HandsReference,
    HandState,
    Joints,
    Marker,
)
from skywright.vehicle.arms.singularity import watch_singularity
from skywright.vehicle.arms.view import ArmsMemory, ArmsView
from skywright.vehicle.bus import Estimate, Reference, ShaftCommand
from skywright.vehicle.component import ArmsLaw, Out, helper
from skywright.vehicle.readings import Shafts


class Compliant(ArmsLaw):
    """Joint angles, hands led on lines or at velocities, forces, and both together."""

    Me = ArmsMemory

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Fill the gains, from the servos' lag T_s, their period T and the robot's keys.

        Torque, (19) in (22) on (17): theta' = dtheta/T_s and tau' = k theta' with the link held, so
        Kp = w T_s / k gives the bandwidth w; Ki = Kp w / 4 makes the double integrator that (22)
        becomes critically damped. `kp_torque` is w T_s, `ki_torque` w^2 T_s / 4 (over k at each
        joint). Position, (21): the free link rings on its spring, weakly damped, and the encoder
        sits beyond it; `kp_position` and `ki_position` are of a bandwidth (rad/s) that is slow
        against it. Force: displacement = integral of w C (f_ref - f) with C the arm's own
        compliance, so that f answers at w; its phase margin is 60 deg with the lag T_s and 1.5 T of
        sampling.
        """
        arm, c = build_arm_model(context.robot, context.springs)[0], context.robot.control
        lag, period = float(arm["servo_tau"]), float(arm["dt"])
        me.kp_torque = c.torque_bandwidth_rad_s * lag
        me.ki_torque = 0.25 * c.torque_bandwidth_rad_s**2 * lag
        me.kp_position = c.deflection_bandwidth_rad_s * lag
        me.ki_position = 0.25 * c.deflection_bandwidth_rad_s**2 * lag
        me.ki_force = (math.pi / 6.0) / (lag + 1.5 * period)
        me.ki_hold = c.deflection_bandwidth_rad_s
        state = context.records[HandState, ""]
        state["speed_hand"] = c.hand_speed_max_mps
        for held in (me.theta_ref, state["q_goal"], context.records[ShaftCommand, ""]["theta"]):
            fill_home(held, context)

    @staticmethod
    def step(
        me: ArmsMemory,
        arm: ArmModel,
        joints: Joints,
        hands: Hands,
        force: HandForce,
        marker: Marker,
        tasks: HandsReference,
        ref: Reference,
        est: Estimate,
        shafts: Shafts,
        state: Out[HandState],
        cmd: Out[ShaftCommand],
    ) -> None:
        v = ArmsView(
            me, arm, joints, hands, force, marker, tasks, ref, est, shafts, state, cmd
        )  # fmt: skip
        f_ref, dr, zero = local(3), local(3), local(3)
        zero[:] = 0.0
        dr[:] = 0.0
        follow_shafts(v)
        for h in range(arm.n_hands):
            lead_hand(v, h, f_ref, dr, zero)


@helper
def is_force(task: int) -> bool:
    """Whether a task commands a force (core/types.py)."""
    return TASK_FORCE <= task <= TASK_SQUEEZE


@helper
def lead_hand(v: ArmsView, h: int, f_ref: Any, dr: Any, zero: Any) -> None:
    """Command the joints of one arm for its task; f_ref and dr (3,) are scratch."""
    task = int(v.tasks.task[h])
    for a in range(3):
        f_ref[a] = v.tasks.f_WH[h, a]
    if v.arm.chain:
        # a force is led in all of the arm's plane: what counts is the worst direction there
        watch_singularity(v, h, zero if task == TASK_FORCE else f_ref)
    if not is_force(task):
        let_out(v, h)
    if task == TASK_JOINTS or (task != TASK_LOOPS and v.arm.chain == 0):
        for j in range(v.arm.first[h], v.arm.first[h] + v.arm.n):
            hold_joint(v, j, v.ref.q[j], True)
        v.state.task_last[h] = TASK_JOINTS
        return
    if v.arm.chain and task != v.state.task_last[h]:
        start_hand(v, h)
    if task == TASK_LOOPS:
        for j in range(v.arm.first[h], v.arm.first[h] + v.arm.n):
            if task != v.state.task_last[h]:
                v.me.i_torque[j] = v.me.i_position[j] = 0.0
            step_joint(v, j, v.tasks.delta[j], v.ref.q[j], v.tasks.tau[j])
        v.state.task_last[h] = task
        return
    v.state.task_last[h] = task
    if is_force(task):
        gamma = 1.0
        dr[:] = 0.0
        v.state.saturated[h] = 0.0
        if task == TASK_SQUEEZE:
            squeeze_force(v, h, f_ref)
        if task != TASK_FORCE:  # (31): gamma dr_F + (1 - gamma) dr_P
            gamma = min(max(v.tasks.gamma[h], 0.0), 1.0)
            step_hold_position(v, h, gamma, dr)
        step_force(v, h, f_ref, gamma, task != TASK_FORCE)
    elif task == TASK_POSITION:
        step_position(v, h, dr)
    elif task == TASK_VISUAL:
        step_to_marker(v, h, dr)
    else:
        step_velocity(v, h, dr)
    move_hand(v, h, dr, not is_force(task))
