"""Joint springs: (15) of Suarez 2020, with their hardening and the play of the servos' gears.

Functions of a joint take the nominal arms (ArmModel).
"""

import math
from typing import Any

from skywright.core.compiled import helper
from skywright.core.user_code import njit


@njit(cache=True, error_model="numpy")
def spring_torque(k: float, linear: float, hardening: float, deflection: float) -> float:
    """Return the torque (N m) of a joint's spring: stiffness k within +-linear, harder beyond."""
    over = abs(deflection) - linear
    torque = k * deflection
    if linear > 0.0 and over > 0.0:
        torque += math.copysign((hardening - 1.0) * k * over, deflection)
    return torque


@njit(cache=True, error_model="numpy")
def spring_deflection(k: float, linear: float, hardening: float, torque: float) -> float:
    """Return the deflection (rad) under a torque (N m): the inverse of `spring_torque`."""
    deflection = torque / k
    if linear > 0.0 and abs(deflection) > linear:
        beyond = (abs(torque) - k * linear) / (k * hardening)
        deflection = math.copysign(linear + beyond, torque)
    return deflection


@helper
def joint_torque(arm: Any, j: int, deflection: float) -> float:
    """Return the torque (N m) of joint j at a measured deflection: (15) behind the gear's play."""
    over = max(abs(deflection) - arm.slack[j], 0.0)
    return spring_torque(arm.k[j], arm.linear[j], arm.hardening[j], math.copysign(over, deflection))


@helper
def joint_deflection(arm: Any, j: int, torque: float) -> float:
    """Return the deflection (rad) of joint j under a torque (N m): inverse of `joint_torque`.

    Near zero torque, where the play may rest on either side, the deflection is interpolated
    linearly.
    """
    play = arm.slack[j]
    if play > 0.0:
        play *= min(max(torque / (arm.k[j] * play), -1.0), 1.0)
    return play + spring_deflection(arm.k[j], arm.linear[j], arm.hardening[j], torque)


@helper
def spring_stiffness(k: float, linear: float, hardening: float, deflection: float) -> float:
    """Return the stiffness (N m/rad) of a joint's spring at a deflection."""
    return k * hardening if linear > 0.0 and abs(deflection) > linear else k
