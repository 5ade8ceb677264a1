"""Gains of the backstepping law from bandwidths.

The law (25), (26) with (42) to (44) of Sanchez-Cuevas 2020 is a PID (see control/backstepping.py),
so its three gains k_1, k_2, lambda follow from the PID's stiffness, damping and integral:

    K_p = 1 + lambda + k_1 k_2,   K_d = k_1 + k_2,   K_i = k_2 lambda
"""

from __future__ import annotations

from typing import Any

from scipy.optimize import brentq

from skywright.description.robot.spec import Robot
from skywright.errors import InputError


def compute_backstepping_gains(
    bandwidth: float, damping: float, integral: float
) -> tuple[float, float, float]:
    """Return k_1, k_2 (1/s) and lambda (1/s^2), all positive.

    K_p = w^2, K_d = 2 zeta w, K_i = w_i w^2 as in the other laws. k_2 is the largest root of
    1 + K_i / k_2 + (K_d - k_2) k_2 = K_p. Raises InputError where no positive gains make that PID:
    k_1 k_2 is at most (zeta w)^2, so K_p - 1 beyond it needs more damping.
    """
    kp, kd, ki = bandwidth**2, 2.0 * damping * bandwidth, integral * bandwidth**2

    def excess(k2: float) -> float:
        return 1.0 + ki / k2 + (kd - k2) * k2 - kp

    low, high = 0.5 * kd, kd
    if not excess(low) >= 0.0 >= excess(high):
        raise InputError(
            f"no backstepping gains for a bandwidth of {bandwidth:g} rad/s with damping "
            f"{damping:g} and integral {integral:g} rad/s: valid is a bandwidth above 1 rad/s with "
            "a damping from 1 and an integral well below it"
        )
    k2 = float(brentq(excess, low, high, xtol=1e-12))
    return kd - k2, k2, ki / k2


def fill_backstepping(par: Any, robot: Robot) -> None:
    """Write the gains into a PARAMETERS record; raises InputError where there are none.

    The force loop takes the arm's bandwidth: it integrates, and the servos answer a speed as a
    critically damped pair of poles at 1 / T_v does, a lag of 2 T_v = 0.08 s. At 3 rad/s that costs
    14 deg of phase. The probe's spring makes a speed of the tip a rate of force.
    """
    c = robot.control
    par["k_p"] = compute_backstepping_gains(
        c.position_bandwidth_rad_s, c.position_damping, c.position_integral_rad_s
    )
    par["k_R"] = compute_backstepping_gains(
        c.attitude_bandwidth_rad_s, c.attitude_damping, c.attitude_integral_rad_s
    )
    par["k_force"] = c.arm_bandwidth_rad_s
