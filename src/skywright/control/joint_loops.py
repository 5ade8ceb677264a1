"""Loops of one compliant joint: torque and output position with the switch delta.

Suarez 2020, (14)-(22). The servo's shaft theta answers its reference with the lag T_s, (17), so
that (22), which adds to theta, integrates once by itself; the printed I terms integrate again. They
are stopped while a limit holds the command back.

theta is that of (17), not the servo's reading: with a resolution of 0.33 deg, a command of the
reading plus K_p q_e rounds to the reading again for errors below 6 deg, and a zero of the encoder
that is off by 0.4 deg makes the joint run until K_p q_e stands against it, 16 deg away.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from skywright.models.springs import joint_deflection, joint_torque

Record = Any

SHAFT_TRUST = math.radians(2.0)
"""rad, that the model of a shaft may be off its reading: zero and resolution; more is a stall."""
TRIM_MAX = math.radians(4.0)  # rad, of the integral in free air


@njit(cache=True, error_model="numpy")
def follow_shafts(b: Record) -> None:
    """Advance the shafts by one period as (17) says of the last commands."""
    arms, meas = b.arms, b.meas
    share = 1.0 - math.exp(-arms.dt / arms.servo_tau)
    for j in range(len(arms.shaft)):
        shaft = arms.shaft[j] + share * (arms.theta_ref[j] - arms.shaft[j])
        arms.shaft[j] = min(max(shaft, meas.q[j] - SHAFT_TRUST), meas.q[j] + SHAFT_TRUST)


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
    theta = arms.shaft[j]
    k = arms.k[j]
    if k == 0.0:  # no spring: the link is the shaft
        hold_joint(b, j, q_ref, False)
        return
    dtheta = arms.deflection[j]  # (14)
    tau = joint_torque(arms, j, dtheta)  # (15)
    tau_e = tau_ref - tau  # (18)
    q_e = q_ref - (b.meas.q[j] - dtheta)  # (20)
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
