"""Aerodynamic drag of a whole robot in steady wind, and the wind at which a rotor reaches its
limit.

Body: F_i = rho/2 (C_D A)_i |v| v_i per body axis, at B's origin. Rotors: -c w_i v_perp at each hub
(`models.rotors.compute_rotor_drag`). The rotor speeds follow from the thrusts that hold the robot,
so loads and drag are iterated together.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.core.compiled import helper
from skywright.models.statics import Layout
from skywright.models.vectors import compute_cross

FASTEST = 40.0
"""m/s; upper bound of the search, reported for any larger limit."""


class DragBody(NamedTuple):
    """Data of a robot's drag and weight."""

    mass: float  # kg
    gravity: float  # m/s^2
    air_density: float  # kg/m^3
    p_BC: Array  # (3,) m
    drag_area: Array  # (3,) m^2, C_D A along the axes of B


@helper
def compute_body_drag(drag_area: Array, air_density: float, v_air_B: Array, f_out: Array) -> None:
    """Write the body's drag (3,) N in B at velocity `v_air_B` (3,) m/s relative to the air."""
    speed = math.sqrt(v_air_B[0] ** 2 + v_air_B[1] ** 2 + v_air_B[2] ** 2)
    for i in range(3):
        f_out[i] = -0.5 * air_density * drag_area[i] * speed * v_air_B[i]


def compute_drag(
    layout: Layout, body: DragBody, wind_B: Array, thrust: Array
) -> tuple[Array, Array]:
    """Return (force, torque about B's origin), (m, 3) each, on a resting robot.

    `wind_B` (m, 3) m/s is the air's velocity in B, `thrust` (m, n) N, minus the preload, sets the
    rotor speeds.
    """
    speed = np.linalg.norm(wind_B, axis=1, keepdims=True)
    f_body = 0.5 * body.air_density * body.drag_area * speed * wind_B
    r = layout.rotors
    along = wind_B @ r.axis.T
    across = wind_B[:, None, :] - along[:, :, None] * r.axis
    omega = np.sqrt(np.maximum(thrust + layout.preload, 0.0) / r.k_f)
    f_hub = r.drag_coefficient * omega[:, :, None] * across
    return f_body + f_hub.sum(axis=1), compute_cross(r.position, f_hub).sum(axis=1)


def compute_hold(
    layout: Layout,
    body: DragBody,
    wind_W: Array,
    f_push_W: Array | None = None,
    p_push_B: Array | None = None,
    lean: float | Array = 0.0,
) -> tuple[Array, Array]:
    """Return (thrust (m, n) N, tilt (m,) rad) that hold position in the winds (m, 3) m/s.

    `f_push_W` (m, 3) N at `p_push_B` (3,) m: force of the robot on its environment. Yaw is zero.
    Robots with lateral force hold their attitude, leaning `lean` (rad; one or (m,)) against the
    horizontal load. The others take the tilt at which thrust along z_B balances the load (a
    fixed point, since drag turns with the body). Thrusts may exceed the limits; the caller checks
    them.
    """
    m, n = len(wind_W), layout.B.shape[1]
    push = np.zeros((m, 3)) if f_push_W is None else f_push_W
    point = np.zeros(3) if p_push_B is None else p_push_B
    weight = body.mass * body.gravity
    up = np.array([0.0, 0.0, 1.0])
    leans = np.broadcast_to(lean, m)
    level = layout.full and not leans.any()
    thrust = np.full((m, n), weight / n)
    tilt = np.zeros(m)
    R = np.broadcast_to(np.eye(3), (m, 3, 3)).copy()
    for _ in range(4 if level else 8):
        wind_B = np.einsum("mji,mj->mi", R, wind_W)
        f_drag, t_drag = compute_drag(layout, body, wind_B, thrust)
        f_push_B = np.einsum("mji,mj->mi", R, push)
        load_W = push - np.einsum("mij,mj->mi", R, f_drag)  # in addition to the weight
        need_W = load_W + weight * up
        if layout.full and not level:
            flat = load_W * np.array([1.0, 1.0, 0.0])
            size = np.linalg.norm(flat, axis=1, keepdims=True)
            toward = np.where(size > 1e-12, flat / np.maximum(size, 1e-12), 0.0)
            R = _leaning(np.cos(leans)[:, None] * up + np.sin(leans)[:, None] * toward)
            tilt = leans.copy()
        elif not layout.full:
            R = _leaning(need_W)
            tilt = np.arccos(np.clip(R[:, 2, 2], -1.0, 1.0))
        up_B = R[:, 2, :]
        f = weight * up_B + f_push_B - f_drag
        t = compute_cross(body.p_BC, weight * up_B) + compute_cross(point, f_push_B) - t_drag
        thrust = np.hstack([f, t]) @ layout.P.T
    return thrust, tilt


def _leaning(z_W: Array) -> Array:
    """Return R_WB (m, 3, 3) with z_B along `z_W` (m, 3) and the least rotation from level."""
    z = z_W / np.linalg.norm(z_W, axis=1, keepdims=True)
    c = np.clip(z[:, 2], -0.999, 1.0)
    x, y = z[:, 0], z[:, 1]
    k = 1.0 / (1.0 + c)
    rows = [1 - k * x * x, -k * x * y, x, -k * x * y, 1 - k * y * y, y, -x, -y, c]
    return np.column_stack(rows).reshape(-1, 3, 3)


def compute_largest(
    holds: Callable[[Array], Mask], count: int, ceiling: float, steps: int = 25
) -> Array:
    """Return (count,) the largest x in [0, ceiling] such that `holds` is true up to x.

    `holds(x)` maps (count,) to booleans. A coarse scan finds the first failure of each entry and a
    bisection refines it. NaN if `holds` is false at zero.
    """
    lo, hi = np.zeros(count), np.full(count, ceiling)
    start = holds(np.zeros(count))
    open_ = start.copy()
    for x in np.linspace(0.0, ceiling, steps + 1)[1:]:
        if not open_.any():
            break
        good = holds(np.full(count, x))
        failed = open_ & ~good
        hi[failed] = x
        open_ &= good
        lo[open_] = x
    for _ in range(18):
        mid = 0.5 * (lo + hi)
        good = holds(mid) & ~open_
        lo = np.where(good, mid, lo)
        hi = np.where(~good & ~open_, mid, hi)
    return np.where(start, lo, np.nan)


def compute_wind_limits(
    layout: Layout, body: DragBody, directions: Array, tilt_max: float
) -> Array:
    """Return the wind (m,) m/s toward each direction (m,) rad that the robot can hold.

    Robots with lateral force stay level; the others tilt by at most `tilt_max` rad. NaN if the
    robot does not hold in calm air; at most FASTEST.
    """
    d = np.column_stack([np.cos(directions), np.sin(directions), np.zeros(len(directions))])

    def holds(speed: Array) -> Mask:
        thrust, tilt = compute_hold(layout, body, speed[:, None] * d)
        return is_held(layout, thrust, tilt, tilt_max)

    return compute_largest(holds, len(directions), FASTEST)


def is_held(layout: Layout, thrust: Array, tilt: Array, tilt_max: float) -> Mask:
    """Whether thrusts (m, n) are within the limits and tilts (m,) within `tilt_max`."""
    inside = (thrust >= layout.t_min - 1e-6) & (thrust <= layout.t_max + 1e-6)
    return np.asarray(inside.all(axis=1) & (tilt <= tilt_max + 1e-9))
