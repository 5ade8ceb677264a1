"""Loops of one compliant joint: torque and output position with the switch delta.

Suarez 2020, (14)-(22). The servo's shaft theta answers its reference with the lag T_s, (17), so
that (22), which adds to the measured theta, integrates once by itself; the printed I terms
integrate again. They are stopped while a limit holds the command back.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from skywright.models.compliant_arms import spring_deflection, spring_torque

Record = Any


@njit(cache=True, error_model="numpy")
def hold_joint(b: Record, j: int, q: float) -> None:
    """Command the shaft so that the output link comes to `q` (rad) against its weight."""
    arms, shift = b.arms, 0.0
    if arms.k[j] > 0.0:
        shift = spring_deflection(arms.k[j], arms.linear[j], arms.hardening[j], arms.t_gravity[j])
    arms.q_goal[j] = min(max(q, arms.q_min[j]), arms.q_max[j])
    b.cmd.theta[j] = arms.q_goal[j] + shift
    arms.theta_ref[j] = b.cmd.theta[j]


@njit(cache=True, error_model="numpy")
def step_joint(b: Record, j: int, delta: float, q_ref: float, tau_ref: float) -> None:
    """Command joint j by (22): output position `q_ref` (rad) where delta = 1, torque where 0."""
    arms = b.arms
    theta = b.meas.q[j]
    k = arms.k[j]
    if k == 0.0:  # no spring: the link is the shaft
        hold_joint(b, j, q_ref)
        return
    dtheta = arms.deflection[j]  # (14)
    tau = spring_torque(k, arms.linear[j], arms.hardening[j], dtheta)  # (15)
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
    shift = spring_deflection(k, arms.linear[j], arms.hardening[j], arms.t_gravity[j])
    arms.q_goal[j] = min(max(held - shift, arms.q_min[j]), arms.q_max[j])
