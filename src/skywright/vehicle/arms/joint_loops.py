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

from skywright.models.springs import joint_deflection, joint_torque
from skywright.vehicle.arms.view import ArmsView
from skywright.vehicle.component import helper

SHAFT_TRUST = math.radians(2.0)
"""rad, that the model of a shaft may be off its reading: zero and resolution; more is a stall."""
TRIM_MAX = math.radians(4.0)  # rad, of the integral in free air


@helper
def follow_shafts(v: ArmsView) -> None:
    """Advance the shafts by one period, by (17), from the last commands."""
    share = 1.0 - math.exp(-v.arm.dt / v.arm.servo_tau)
    for j in range(len(v.me.shaft)):
        shaft = v.me.shaft[j] + share * (v.me.theta_ref[j] - v.me.shaft[j])
        v.me.shaft[j] = min(max(shaft, v.shafts.q[j] - SHAFT_TRUST), v.shafts.q[j] + SHAFT_TRUST)


@helper
def hold_joint(v: ArmsView, j: int, q: float, trim: bool) -> None:
    """Command the shaft so that the output link comes to `q` (rad) against its weight.

    What the spring yields to the weight is fed forward, and what it is wound by for a force
    (hand_force.py). With `trim`, in free air, the integral of
    (21) takes up the rest (play, errors of mass and stiffness) where the deflection is measured.
    """
    shift = 0.0
    v.state.q_goal[j] = min(max(q, v.arm.q_min[j]), v.arm.q_max[j])
    if v.arm.k[j] > 0.0:
        shift = joint_deflection(v.arm, j, v.joints.t_gravity[j])
        if trim and v.arm.sensed[j] > 0.0:
            rate = v.me.kp_position / v.arm.servo_tau  # rad/s
            i = v.me.i_position[j] + rate * v.arm.dt * (v.state.q_goal[j] - v.est.q[j])
            v.me.i_position[j] = min(max(i, -TRIM_MAX), TRIM_MAX)
        shift += v.me.i_position[j] + v.me.wind[j]
    v.cmd.theta[j] = v.state.q_goal[j] + shift
    v.me.theta_ref[j] = v.cmd.theta[j]


@helper
def step_joint(v: ArmsView, j: int, delta: float, q_ref: float, tau_ref: float) -> None:
    """Command joint j by (22): output position `q_ref` (rad) where delta = 1, torque where 0."""
    theta = v.me.shaft[j]
    k = v.arm.k[j]
    if k == 0.0:  # no spring: the link is the shaft
        hold_joint(v, j, q_ref, False)
        return
    dtheta = v.joints.deflection[j]  # (14)
    tau = joint_torque(v.arm, j, dtheta)  # (15)
    tau_e = tau_ref - tau  # (18)
    q_e = q_ref - (v.shafts.q[j] - dtheta)  # (20)
    i_tau = v.me.i_torque[j] + (1.0 - delta) * v.me.ki_torque / k * tau_e * v.arm.dt
    i_p = v.me.i_position[j] + delta * v.me.ki_position * q_e * v.arm.dt
    dtheta_tau = v.me.kp_torque / k * tau_e + i_tau  # (19)
    dtheta_p = v.me.kp_position * q_e + i_p  # (21)
    wanted = theta + delta * dtheta_p + (1.0 - delta) * dtheta_tau  # (22)
    # the shaft may lead the link's limits by the spring's deflection, and is as fast as it is
    lowest, highest = v.arm.q_min[j] + min(dtheta, 0.0), v.arm.q_max[j] + max(dtheta, 0.0)
    reach = v.arm.speed_max * v.arm.servo_tau
    lowest, highest = max(lowest, theta - reach), min(highest, theta + reach)
    held = min(max(wanted, min(lowest, theta)), max(highest, theta))
    error = delta * q_e + (1.0 - delta) * tau_e
    if held == wanted or (wanted - held) * error < 0.0:  # anti-windup
        v.me.i_torque[j], v.me.i_position[j] = i_tau, i_p
    v.cmd.theta[j] = held
    v.me.theta_ref[j] = held
    shift = joint_deflection(v.arm, j, v.joints.t_gravity[j])
    v.state.q_goal[j] = min(max(held - shift, v.arm.q_min[j]), v.arm.q_max[j])
