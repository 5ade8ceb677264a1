"""The weld of the true pipe, expressed on the surveyed pipe."""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.description.world.spec import Weld, World
from skywright.description.world.surface import (
    Cylinder,
    build_cylinder,
    build_weld_curve,
    roll_points,
    unroll_points,
)


def carry_weld(world: World, weld: Weld, found: Cylinder, near: Array) -> Weld:
    """Return a `weld` of the true `world`'s pipe as it lies on the surface `found`.

    The weld itself is the datum: the pipe's position along its axis and its rotation about it,
    which touches do not determine, shift the origin of the map, not the weld. `near` (2,) m is the
    place (s, c) on `found` around which the line is transferred.
    """
    assert world.pipe is not None
    true = build_cylinder(world.pipe)
    p, _ = roll_points(found, np.array([near[0]]), np.array([near[1]]))
    s, c, _ = unroll_points(true, p)
    middle = build_weld_curve(weld, true.radius).touch(float(c[0]))
    ahead = middle.find_nearest(float(s[0]), float(c[0]))
    points, _ = roll_points(true, *middle.follow(ahead + np.array([-1e-4, 0.0, 1e-4])))
    s, c, _ = unroll_points(found, points)
    around = found.radius * np.unwrap(c / found.radius)
    angle = math.atan2(s[2] - s[0], around[2] - around[0])
    angle -= math.pi * round(angle / math.pi) if abs(angle) > math.pi / 2 else 0.0
    return weld.model_copy(update={
        "angle_deg": math.degrees(angle), "offset_m": float(s[1]),
        "around_deg": math.degrees(c[1] / found.radius),
    })  # fmt: skip
