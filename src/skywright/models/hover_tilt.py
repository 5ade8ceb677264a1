"""How far a robot can tilt while it hovers in place, whichever way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.rotors import build_rotors
from skywright.models.statics import build_layout, compute_tilt_limit
from skywright.robots.spec import Robot

AXES = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])


def compute_hover_tilt(robot: Robot, q: NDArray[np.float64], gravity: float) -> float:
    """Return the least hover tilt (rad) of roll and pitch to either side, joints at q (rad).

    Rotors up to the robot's `thrust_fraction`; 0 for a robot without lateral force.
    """
    layout = build_layout(build_rotors(robot.rotors), robot.rotors.thrust_fraction)
    mass, p_BC, _ = compute_body(build_body_model(robot, gravity), q)
    return min(compute_tilt_limit(layout, mass * gravity, p_BC, axis) for axis in AXES)
