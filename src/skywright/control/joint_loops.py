"""Loops of one compliant joint: torque and output position with the switch delta.

Suarez 2020, (14)-(22). The servo's shaft theta answers its reference with the lag T_s, (17), so
that (22), which adds to the measured theta, integrates once by itself; the printed I terms
integrate again. They are stopped while a limit holds the command back.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from skywright.models.compliant_arms import joint_deflection, joint_torque

Record = Any

TRIM_MAX = math.radians(4.0)  # rad, of the integral in free air


@njit(cache=True, error_model="numpy")
def hold_joint(b: Record, j: int, q: float, trim: bool) -> None:
    """Command the shaft so that the output link comes to `q` (rad) against its weight.

    What the spring yields to the weight is fed forward, and what it is wound by for a force
    (control/hand_force.py). With `trim`, in free air, the integral of
    (21) takes up the rest (play, errors of mass and stiffness) where the deflection is measured.
    """
    arms, shift = b.arms, 0.0
    arms.q_goal[j] = min(max(q, arms.q_min[j]), arms.q_max[j])
    if arms.k[j] > 0.0:
        shift = joint_deflection(arms, j, arms.t_gravity[j])
        if trim and arms.sensed[j] > 0.0:
            rate = arms.kp_position / arms.servo_tau  # rad/s
            i = arms.i_position[j] + rate * arms.dt * (arms.q_goal[j] - b.est.q[j])
            arms.i_position[j] = min(max(i, -TRIM_MAX), TRIM_MAX)
        shift += arms.i_position[j] + arms.wind[j]
    b.cmd.theta[j] = arms.q_goal[j] + shift
    arms.theta_ref[j] = b.cmd.theta[j]


@njit(cache=True, error_model="numpy")
def step_joint(b: Record, j: int, delta: float, q_ref: float, tau_ref: float) -> None:
    """Command joint j by (22): output position `q_ref` (rad) where delta = 1, torque where 0."""
    arms = b.arms
    theta = b.meas.q[j]
    k = arms.k[j]
    if k == 0.0:  # no spring: the link is the shaft
        hold_joint(b, j, q_ref, False)
        return
    dtheta = arms.deflection[j]  # (14)
    tau = joint_torque(arms, j, dtheta)  # (15)
    tau_e = tau_ref - tau  # (18)
    q_e = q_ref - (theta - dtheta)  # (20)
    i_tau = arms.i_torque[j] + (1.0 - delta) * arms.ki_torque / k * tau_e * arms.dt
    i_p = arms.i_position[j] + delta * arms.ki_position * q_e * arms.dt
    dtheta_tau = arms.kp_torque / k * tau_e + i_tau  # (19)
    dtheta_p = arms.kp_position * q_e + i_p  # (21)
    wanted = theta + delta * dtheta_p + (1.0 - delta) * dtheta_tau  # (22)
    # the shaft may lead the link's limits by the spring's deflection, and is as fast as it is
    lowest, highest = arms.q_min[j] + min(dtheta, 0.0), arms.q_max[j] + max(dtheta, 0.0)
    reach = arms.speed_max * arms.servo_tau
    lowest, highest = max(lowest, theta - reach), min(highest, theta + reach)
    held = min(max(wanted, min(lowest, theta)), max(highest, theta))
    error = delta * q_e + (1.0 - delta) * tau_e
    if held == wanted or (wanted - held) * error < 0.0:  # anti-windup
        arms.i_torque[j], arms.i_position[j] = i_tau, i_p
    b.cmd.theta[j] = held
    arms.theta_ref[j] = held
    shift = joint_deflection(arms, j, arms.t_gravity[j])
    arms.q_goal[j] = min(max(held - shift, arms.q_min[j]), arms.q_max[j])
