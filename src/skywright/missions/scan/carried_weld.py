"""The weld of the true pipe as it lies on the pipe that a survey found."""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.spec import Weld, World
from skywright.description.world.surface import (
    Cylinder,
    build_cylinder,
    build_weld_line,
    roll_points,
    unroll_points,
)


def carry_weld(world: World, found: Cylinder, near: Array) -> Weld | None:
    """Return the weld of the true `world` as it lies on the surface `found`.

    The weld itself is the datum: what touches cannot show, the pipe's place along its axis and its
    turn about it, shifts where the map counts from, not where the weld is. `near` (2,) m is the
    place (s, c) on `found` around which the line is carried over.
    """
    weld, pipe = world.weld, world.pipe
    if weld is None or pipe is None or not weld.present:
        return weld
    true = build_cylinder(pipe)
    line = build_weld_line(weld)
    p, _ = roll_points(found, np.array([near[0]]), np.array([near[1]]))
    s, c, _ = unroll_points(true, p)
    middle = (float(s[0]) - line.s) * math.sin(line.angle) + (float(c[0]) - line.c) * math.cos(
        line.angle
    )
    along = middle + np.linspace(-0.05, 0.05, 21)
    points, _ = roll_points(true, *line.follow(along))
    s, c, _ = unroll_points(found, points)
    turn = 2.0 * math.pi * found.radius
    c = found.radius * np.unwrap(c / found.radius)
    c = c + turn * np.round((near[1] - c.mean()) / turn)
    (us, uc), at = _fit_line(s, c)
    angle = math.atan2(us, uc)
    return weld.model_copy(update={
        "angle_deg": math.degrees(angle), "offset_m": float(at[0] - at[1] * math.tan(angle))
    })  # fmt: skip


def _fit_line(s: Array, c: Array) -> tuple[Array, Array]:
    """Direction (2,), with c growing, and middle (2,) of points on a line."""
    q = np.column_stack([s, c])
    middle = q.mean(axis=0)
    way = np.linalg.svd(q - middle)[2][0]
    return way * (1.0 if way[1] >= 0.0 else -1.0), middle
