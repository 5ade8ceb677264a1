"""The mixer of Sanchez-Cuevas 2020 as printed, (20)-(22), for comparison with the geometry.

A maps thrusts to force, G and H to torque: force = A T, torque = (L G + c H) T with the rotors'
distance L and the torque per thrust c. No robot flies with these matrices; flights compute them
from the azimuths and tilts of the rotors (`models/rotors.py`).
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from skywright.core.arrays import Array
from skywright.models.rotors import RotorSet

SIGN_H = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
"""H is A with the signs of columns 1, 3 and 5 reversed: their propellers turn counter-clockwise."""


class Mixer(NamedTuple):
    """The blocks of (20), each (3, 6)."""

    A: Array
    G: Array
    H: Array

    def build(self, radius: float, torque_per_thrust: float) -> Array:
        """Return the (6, 6) map from thrusts (N) to force (N) and torque (N m)."""
        return np.vstack([self.A, radius * self.G + torque_per_thrust * self.H])


class WrongEntry(NamedTuple):
    """An entry that differs from the geometry; row and column count from 1, as in the paper."""

    block: str
    row: int
    column: int
    printed: float
    correct: float


def build_printed(alpha: float, beta: float) -> Mixer:
    """Return A (21), G (22) and H literally; angles (rad) are the magnitudes of the tilts."""
    s_b, r3 = math.sin(beta), math.sqrt(3.0)
    sc = math.sin(alpha) * math.cos(beta)  # printed as "sac beta"
    cs = math.cos(alpha) * math.sin(beta)  # printed as "cas beta"
    cc = math.cos(alpha) * math.cos(beta)  # printed as "cac beta"
    x, y = r3 / 2 * s_b, r3 / 2 * sc
    A = np.array(
        [
            [x - sc / 2, sc, -x - sc / 2, x - sc / 2, sc, -x - sc / 2],
            [s_b / 2 + y, -s_b, s_b / 2 + y, s_b / 2 + y, -s_b, s_b / 2 - y],
            [cc, cc, cc, cc, cc, cc],
        ]
    )
    G = np.array(
        [
            [cc / 2, cc, cc / 2, -cc / 2, -cc, -cc / 2],
            [r3 / 2 * cs, 0.0, r3 / 2 * cs, r3 / 2 * cs, 0.0, -r3 / 2 * cs],
            [sc, -sc, cc, -sc, cc, -sc],
        ]
    )
    return Mixer(A, G, A * SIGN_H)


def build_correct(rotors: RotorSet) -> Mixer:
    """Return the blocks from the geometry of the rotors."""
    radius = float(np.linalg.norm(rotors.position[0, :2]))
    axis = rotors.axis.T
    return Mixer(axis, np.cross(rotors.position, rotors.axis).T / radius, -rotors.spin * axis)


def find_wrong_entries(printed: Mixer, correct: Mixer) -> list[WrongEntry]:
    """Return every printed entry that differs from the geometry."""
    found = []
    for name, a, b in zip("AGH", printed, correct, strict=True):
        for row, column in np.argwhere(~np.isclose(a, b, atol=1e-9)):
            entry = float(a[row, column]), float(b[row, column])
            found.append(WrongEntry(name, int(row) + 1, int(column) + 1, *entry))
    return found


def can_hover(mixer: Array, weight: float, t_min: float, t_max: float) -> bool:
    """Return whether thrusts in [t_min, t_max] N carry `weight` (N) level, without other load."""
    wrench = np.array([0.0, 0.0, weight, 0.0, 0.0, 0.0])
    bounds = [(t_min, t_max)] * mixer.shape[1]
    found = linprog(np.zeros(mixer.shape[1]), A_eq=mixer, b_eq=wrench, bounds=bounds)
    return bool(found.status == 0)
