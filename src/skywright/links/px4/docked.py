"""Attitude set-points while feet hold the robot against a structure.

In the air PX4 turns the robot until it reaches the attitude of the set-point. A docked robot does
not turn: PX4's rate integral grows with the remaining angle between the set-point and the attitude
that the feet allow, until rotors saturate. Here the set-point starts from PX4's own attitude, and
its angle e from there commands a torque. At rest PX4's loops produce K e + w K times the integral
of e (K, N m/rad: attitude gain times rate gain; w, 1/s: integral gain over rate gain). With

    e' = k (t_law - t_made) / K,   k = 4 w

the torque tracks that of the robot's own law, whose integrals are frozen while docked, with two
poles at 2 w, and e goes to 0. PX4's torque in the air beyond the law's torque is its trim, and is
kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import exp_so3
from skywright.links.mavlink.link import PERIOD
from skywright.links.px4.parameters import Airframe

Array = NDArray[np.float64]

TRIM_S = 1.0  # s, averaging time of the trim
ANGLE_MAX = 0.1  # rad


class DockedAttitude:
    """Chooses the attitude of each set-point (every PERIOD)."""

    def __init__(self, airframe: Airframe) -> None:
        gains = airframe.gains
        self._stiffness = airframe.torque_units * gains.rate_p * gains.attitude_p  # (3,) N m/rad
        self._rate = 4.0 * gains.rate_i / gains.rate_p  # (3,) 1/s
        self._trim, self._angle = np.zeros(3), np.zeros(3)  # N m, rad

    def choose(self, docked: bool, planned: Array, R: Array, law: Array, made: Array) -> Array:
        """Return the attitude: `planned` in the air, near the current one `R` while docked.

        `law` and `made` (3,) N m in B are the torques that the law commands and PX4 produces.
        """
        off = law + self._trim - made
        if not docked:
            self._trim -= PERIOD / TRIM_S * off
            self._angle[:] = 0.0
            return planned
        self._angle += PERIOD * self._rate * off / self._stiffness
        np.clip(self._angle, -ANGLE_MAX, ANGLE_MAX, out=self._angle)
        turn = np.empty((3, 3))
        exp_so3(self._angle, turn)
        return R @ turn
