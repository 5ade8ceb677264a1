"""Reserves of a flying robot: force in each direction, and clearance.

The ground station's page shows them. The force reserve in a direction is the largest additional
force of the rotors at this attitude without any torque: thrusts T + s dT with B dT = (d, 0) stay
within their limits up to s. If the rotors cannot push in a direction without tilting, there is no
reserve in it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_from_quat
from skywright.models.geometry import FAR, compute_clearance
from skywright.run.setup import Setup

if TYPE_CHECKING:
    from skywright.description.loader import Description

DIRECTIONS = 12
"""In the level plane of B, counter-clockwise from ahead; up and down follow."""
PURE = 0.02  # of a direction, largest share of another force or torque (over 1 m)


class Reserve:
    """Computes the reserves of one robot in one world with the nominal model."""

    def __init__(self, description: Description) -> None:
        """Build the queries of distances."""
        setup = Setup(description)
        self.rotors = setup.rotors
        angles = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
        level = np.stack([np.cos(angles), np.sin(angles), np.zeros(DIRECTIONS)])
        wanted = np.zeros((6, DIRECTIONS + 2))
        wanted[:3] = np.concatenate([level, np.array([[0, 0], [0, 0], [1, -1]])], axis=1)
        change = np.linalg.pinv(self.rotors.B) @ wanted  # (n, directions) N per newton
        error = np.max(np.abs(self.rotors.B @ change - wanted), axis=0)
        self._reachable = (error < PURE).tolist()
        self._most, self._least = self.rotors.thrust_max, self.rotors.thrust_min
        self._raises, self._used = change > 0.0, np.abs(change) > 1e-9
        # newtons of force per newton of thrust reserve; a rotor without a share imposes no limit
        self._per_newton = 1.0 / np.where(self._used, np.abs(change), 1.0)
        self._query = setup.clearance_aloft if description.robot.arm is not None else None

    @property
    def measures_clearance(self) -> bool:
        """Whether it measures distances: only for robots with an arm."""
        return self._query is not None

    def measure_force(self, thrust: Array) -> list[float | None]:
        """Return the force reserve (N) in each direction at the current `thrust` (n,) N.

        None if the rotors cannot push without tilting.
        """
        n = len(self._most)
        room_up = np.maximum(self._most - thrust[:n], 0.0)
        room_down = np.maximum(thrust[:n] - self._least, 0.0)
        room = np.where(self._raises, room_up[:, None], room_down[:, None])
        most = np.min(np.where(self._used, room * self._per_newton, math.inf), axis=0)
        told = [round(x, 2) if math.isfinite(x) else None for x in most.tolist()]
        return [
            x if reachable else None for x, reachable in zip(told, self._reachable, strict=True)
        ]

    def measure_clearance(self, row: Any) -> tuple[float, str] | None:
        """Return the smallest distance (m) and its pair; None far from everything.

        `row` is a sample. The ground, and the probe at its surface, are excluded.
        """
        if self._query is None:
            return None
        found = compute_clearance(
            self._query, row["p_WB"], rot_from_quat(row["q_WB"]), row["q"], exclude_probe=True
        )
        if not found.distance < FAR:
            return None
        names = self._query.names
        return float(found.distance), f"{names[found.robot_geom]} and {names[found.other_geom]}"
