"""Ray casts through a scene that ignore the robot."""

import math

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.models.scene import Scene


class Sight:
    """Casts rays in the current state of a simulation."""

    def __init__(self, scene: Scene, data: mujoco.MjData) -> None:
        self._model, self._data = scene.model, data
        root = self._model.body_rootid
        self._robot = set(np.flatnonzero(root == scene.places.platform_body).tolist())
        self._geom = np.zeros(1, np.int32)

    def measure(self, start: Array, direction: Array) -> float:
        """Return the distance (m) from `start` (3,) along a unit vector to the first geometry, inf
        if there is none."""
        gone = 0.0
        for _ in range(32):  # skip each part of the robot on the ray
            far = mujoco.mj_ray(
                self._model, self._data, start + gone * direction, direction, None, 1, -1,
                self._geom,
            )  # fmt: skip
            if far < 0.0:
                return math.inf
            gone += float(far)
            if int(self._model.geom_bodyid[self._geom[0]]) not in self._robot:
                return gone
            gone += 1e-4
        return math.inf

    def sees(self, a: Array, b: Array) -> bool:
        """Return whether the line between two points (3,) m is free, except for the robot."""
        way = b - a
        far = float(np.linalg.norm(way))
        return far < 1e-6 or self.measure(a, way / far) >= far
