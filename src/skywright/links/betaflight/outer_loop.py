"""Outer position loop: from a position reference to the sticks of ANGLE mode.

The commanded acceleration is a = a_ref + k_v (v_ref + k_p (p_ref - p) - v) + integral. The thrust m
(a + g) tilts the platform: roll and pitch sticks are angles over the limit, throttle is the thrust
along z of B over the motors' curve, yaw is a rate. The bandwidths follow from that of Betaflight's
attitude loop and the lag of the rotors.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.links.betaflight.airframe import (
    ANGLE_LIMIT_DEG,
    YAW_RATE_DEG_S,
    BetaflightAirframe,
)
from skywright.links.betaflight.packets import Sticks

Array = NDArray[np.float64]

VELOCITY_PER_ATTITUDE = 0.4
"""k_v over the bandwidth of the attitude loop."""
POSITION_PER_VELOCITY = 0.35
"""k_p over k_v."""
INTEGRAL_PER_POSITION = 0.4
"""Rate of the integral over k_p."""
INTEGRAL_MAX = 2.0  # m/s^2
INTEGRAL_NEAR = 0.2  # m, largest error that the integral accepts, to limit its wind-up by a step
YAW_GAIN = 1.5  # 1/s
LEAN_MAX = math.radians(0.9 * ANGLE_LIMIT_DEG)
UP_RANGE = (0.4, 1.6)
"""Range of the commanded vertical thrust over weight."""


class Target(NamedTuple):
    """Reference at an instant, in W."""

    p: Array  # (3,) m
    v: Array
    a: Array
    yaw: float  # rad
    yaw_rate: float


class OuterLoop:
    """The position loop; its only state is the integral."""

    def __init__(self, airframe: BetaflightAirframe, gravity: float) -> None:
        self._airframe, self._gravity = airframe, gravity
        self._kv = VELOCITY_PER_ATTITUDE * airframe.angle_gain
        self._kp = POSITION_PER_VELOCITY * self._kv
        self._ki = INTEGRAL_PER_POSITION * self._kp * self._kp * self._kv
        self.integral = np.zeros(3)  # m/s^2

    def compute(
        self, target: Target, p_WB: Array, v_WB: Array, R_WB: Array, dt: float, integrate: bool
    ) -> Sticks:
        """Return the sticks for a step of `dt` (s); `integrate` is false on the ground."""
        error = target.p - p_WB
        a = target.a + self._kv * (target.v + self._kp * error - v_WB) + self.integral
        if integrate:
            change = self._ki * np.clip(error, -INTEGRAL_NEAR, INTEGRAL_NEAR) * dt
            self.integral = np.clip(self.integral + change, -INTEGRAL_MAX, INTEGRAL_MAX)
        g = self._gravity
        up = g * min(max(1.0 + a[2] / g, UP_RANGE[0]), UP_RANGE[1])
        yaw = math.atan2(R_WB[1, 0], R_WB[0, 0])
        c, s = math.cos(yaw), math.sin(yaw)
        ahead, left = c * a[0] + s * a[1], -s * a[0] + c * a[1]
        flat = math.hypot(ahead, left)
        shrink = min(1.0, up * math.tan(LEAN_MAX) / max(flat, 1e-9))
        ahead, left = ahead * shrink, left * shrink
        pitch = math.atan2(ahead, up)
        roll = -math.asin(left / math.hypot(ahead, left, up))
        force = np.array([c * ahead - s * left, s * ahead + c * left, up])
        thrust = self._airframe.mass * max(float(force @ R_WB[:, 2]), 0.0)
        off = math.remainder(target.yaw - yaw, 2.0 * math.pi)
        rate = target.yaw_rate + YAW_GAIN * off  # counter-clockwise
        limit = math.radians(ANGLE_LIMIT_DEG)
        return Sticks(
            roll / limit, pitch / limit, max(self._airframe.compute_throttle(thrust), 0.02),
            -rate / math.radians(YAW_RATE_DEG_S),
        )  # fmt: skip
