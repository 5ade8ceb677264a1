"""Largest tilt of a robot that hovers in place, in every direction, in calm air or wind."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.rotors import build_rotors
from skywright.models.statics import Layout, build_layout, compute_tilt_limit
from skywright.models.wind import DragBody, compute_drag, compute_largest

AXES = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])
TILT_CEILING = 0.5 * math.pi  # rad; upper bound of the search in wind, as in calm air


def compute_hover_tilt(
    robot: Robot, q: Array, gravity: float, *, wind: Array | None = None, air_density: float = 1.2
) -> float:
    """Return the least hover tilt (rad) of roll and pitch to either side, joints at q (rad).

    Rotors up to the robot's `thrust_fraction`; 0 for a robot without lateral force. `wind` (3,) or
    (k, 3) m/s: velocity of the air along the axes of the level robot; the drag of body and rotors
    then reduces the lateral force. Returns the least over all winds, or NaN if the robot does not
    hold even level in one of them.
    """
    layout = build_layout(build_rotors(robot.rotors), robot.rotors.thrust_fraction)
    mass, p_BC, _ = compute_body(build_body_model(robot, gravity), q)
    if wind is None or not np.any(wind) or not layout.full:
        return min(compute_tilt_limit(layout, mass * gravity, p_BC, axis) for axis in AXES)
    p = robot.platform
    areas = np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2])
    body = DragBody(mass, gravity, air_density, p_BC, areas)
    winds = np.repeat(np.atleast_2d(wind), len(AXES), axis=0)
    axes = np.tile(AXES, (len(winds) // len(AXES), 1))

    def holds(tilt: Array) -> Mask:
        thrust = _compute_thrust(layout, body, winds, axes * tilt[:, None])
        inside = (thrust >= layout.t_min - 1e-6) & (thrust <= layout.t_max + 1e-6)
        return np.asarray(inside.all(axis=1))

    return float(np.min(compute_largest(holds, len(axes), TILT_CEILING, steps=50)))


def _compute_thrust(layout: Layout, body: DragBody, wind: Array, turn: Array) -> Array:
    """Return thrusts (m, n) N that hold position in the winds (m, 3) m/s at rotations `turn` (m, 3)
    rad; limits are ignored.

    Drag depends on the rotor speeds and these on the thrusts, so both are iterated.
    """
    R = Rotation.from_rotvec(turn).as_matrix()
    weight_B = body.mass * body.gravity * R[:, 2, :]
    wind_B = np.einsum("mji,mj->mi", R, wind)
    thrust = np.full((len(turn), layout.B.shape[1]), body.mass * body.gravity / layout.B.shape[1])
    for _ in range(6):
        f_drag, t_drag = compute_drag(layout, body, wind_B, thrust)
        wrench = np.hstack([weight_B - f_drag, np.cross(body.p_BC, weight_B) - t_drag])
        thrust = wrench @ layout.P.T
    return thrust
