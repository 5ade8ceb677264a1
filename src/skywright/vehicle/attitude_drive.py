"""A stream of attitudes and body forces, from a computer with its own position loops."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skywright.core.rotations import rot_z
from skywright.errors import InputError
from skywright.vehicle.bus import Body
from skywright.vehicle.drives import ASKED, DOWN_S, LIGHT, TICK, Drive
from skywright.vehicle.interface import Backend

Array = NDArray[np.float64]


def check_attitude(R_WB: ArrayLike) -> Array:
    """Return a rotation (3, 3); raise InputError for any other matrix."""
    R = np.asarray(R_WB, dtype=float)
    if R.shape != (3, 3) or not np.all(np.isfinite(R)):
        raise InputError(f"R_WB has the shape {R.shape}; valid: (3, 3) finite numbers")
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(R) < 0.0:
        raise InputError("R_WB is not a rotation: R R^T differs from 1 by more than 0.001")
    return R


class AttitudeDrive(Drive):
    """Follows attitudes and forces.

    Position and velocity of the reference follow the estimate, so that the position loops add
    nothing to the commanded acceleration R f / m - g.
    """

    def __init__(self, backend: Backend) -> None:
        super().__init__(backend)
        self._gravity = np.array([0.0, 0.0, -float(backend.world.gravity_mps2)])
        self._R, self._f = np.array(backend.reference["R_WB"]), np.zeros(3)
        self._told, self._stands = False, 0.0
        self._floor = float(backend.estimate["p_WB"][2])
        self._flew = True

    def tell(self, R_WB: Array, f_B: Array) -> None:
        """Set a new reference: attitude (3, 3), force (3,) N in B."""
        self._R, self._f, self.heard = R_WB, f_B, self.backend.t
        if not self._told:
            self._told, self._flew = True, False
        self.yaw, self.rate = math.atan2(R_WB[1, 0], R_WB[0, 0]), 0.0

    @property
    def has_touched_down(self) -> bool:
        """As in Drive, or the robot has flown, is at rest, and its thrust is below its weight."""
        return (self._flew and self._stands >= DOWN_S - 1e-9) or super().has_touched_down

    def lead(self) -> Array:
        """Return the commanded acceleration; if stale, brake."""
        if self.is_stale:
            self._stands = 0.0
            return self._towards(np.zeros(3))
        est, mass = self.backend.estimate, float(self.backend.look(Body).mass)
        self._flew = self._flew or float(est["p_WB"][2]) > self._floor + 0.15
        self.p, self.v = np.array(est["p_WB"]), np.array(est["v_WB"])
        a = self._R @ self._f / mass + self._gravity
        light = a[2] < (LIGHT - 1.0) * -self._gravity[2] and abs(est["v_WB"][2]) < ASKED
        self._stands = self._stands + TICK if light else 0.0
        return np.asarray(a)

    def attitude(self) -> Array:
        """Return the commanded attitude; if stale, level."""
        return rot_z(self.yaw) if self.is_stale else self._R
