"""Quantities of arms with joint springs, computed from the description.

Suarez 2020: a servo's shaft theta turns the output link q through a spring with the deflection
theta - q (14). Without a deflection encoder, the deflection under the arm's weight is used.
"""

import math
from typing import Any

import numpy as np

from skywright.core.types import MAX_JOINTS
from skywright.description.robot.limbs import list_servos
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import (
    compute_kinematics,
    fill_gravity_torque,
)

Array = Any


def is_compliant(robot: Robot) -> bool:
    """Whether the commands of the robot's arms are shaft angles."""
    return any(servo.mode == "position" for _, servo in list_servos(robot))


def count_command_ticks(robot: Robot) -> int:
    """Return the control ticks between commands to position servos, nearest to their period.

    Of two equally near counts it returns the longer one (24 ms rather than 16 ms for a period of 20
    ms at 125 Hz): a servo accepts a command only after the last period has ended.
    """
    period = list_servos(robot)[0][1].command_period_s * robot.control.rate_hz
    return max(math.floor(period + 0.5 + 1e-9), 1)


def find_swing(model: Any, q: Any) -> Any:
    """Return q (n_joints,) with the passive first joint at its rest angle (level platform).

    `model` is a (1,) array of `BodyModel`. The rest angle has zero gravity torque about the joint;
    bisection finds it between -90 and 90 deg.
    """
    q = np.array(q, dtype=float)
    if model[0]["joint"][0] != 0 or model[0]["motor_speed_max"][0] > 0.0:
        return q
    low, high = -0.5 * math.pi, 0.5 * math.pi
    for _ in range(60):
        q[0] = 0.5 * (low + high)
        if compute_gravity_torque(model, q)[0] > 0.0:  # gravity pulls it back: too large
            high = q[0]
        else:
            low = q[0]
    return q


def compute_gravity_torque(model: Any, q: Any) -> Any:
    """Return the torques (MAX_JOINTS,) N m that hold the arms at rest, platform level."""
    torque = np.zeros(MAX_JOINTS)
    fill_gravity_torque(
        model[0], compute_kinematics(model, q), np.array([0.0, 0.0, -model[0]["gravity"]]), torque
    )
    return torque


def find_hands(model: Any, q: Any) -> Any:
    """Return the hands' positions p_BH (n_hands, 3) m in B at joints q."""
    return compute_kinematics(model, q)["p_BH"][: model[0]["n_hands"]].copy()
