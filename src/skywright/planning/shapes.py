"""Motions of a robot between two configurations in a scene of user-defined shapes."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_limits
from skywright.description.world.spec import World
from skywright.errors import InfeasibleError, InputError
from skywright.models.hover import read_numbers
from skywright.models.kinematic_tree import BOX, CAPSULE, build_planning_scene, build_shapes
from skywright.models.rigid_body import joint_names, posture
from skywright.models.scene import build_scene
from skywright.planning.motion.space import MAX_OBSTACLES
from skywright.planning.motion.transit import Configuration, Transit, plan_transit

FARTHEST = 1000.0
"""m from W's origin, in each coordinate, for start and goal: a long path takes long to check."""


class Box(NamedTuple):
    """A box with its centre (3,) m in W and three edges (3,) m, rotated by R_W (3, 3)."""

    centre: ArrayLike
    size: ArrayLike
    R_W: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Cylinder(NamedTuple):
    """A cylinder with its axis from `start` to `end` (3,) m in W; its ends are rounded."""

    start: ArrayLike
    end: ArrayLike
    radius: float  # m


class Sphere(NamedTuple):
    """A sphere with its centre (3,) m in W."""

    centre: ArrayLike
    radius: float  # m


Shape = Box | Cylinder | Sphere


def plan_between(
    robot: Robot,
    world: World,
    start: Sequence[float] | Configuration,
    goal: Sequence[float] | Configuration,
    shapes: Sequence[Shape],
    margin: float,
    seed: int,
) -> Transit:
    """Plan among `shapes` on the ground of `world`; skywright.plan_motion has the arguments."""
    wide = read_numbers(margin)
    if wide is None or wide.shape or not 0.0 < wide < math.inf:
        raise InputError(f"margin {margin!r}: valid: a distance above 0 in m")
    try:
        number = operator.index(seed)
    except TypeError:
        number = -1
    if number < 0:
        raise InputError(f"seed {seed!r}: valid: an integer of at least 0")
    if isinstance(shapes, Box | Cylinder | Sphere):  # a tuple, but no list of shapes
        name = type(shapes).__name__
        raise InputError(f"shapes: one {name}; valid: a list of Box, Cylinder and Sphere")
    if not isinstance(shapes, Sequence) or isinstance(shapes, str | bytes):
        raise InputError(f"shapes: {shapes!r}; valid: a list of Box, Cylinder and Sphere")
    if len(shapes) > MAX_OBSTACLES:
        raise InputError(f"{len(shapes)} shapes: a scene holds at most {MAX_OBSTACLES}")
    scene = build_planning_scene(build_scene(robot, world), robot, get_limits(world))
    rows = [_build_row(i, shape) for i, shape in enumerate(shapes)]
    names = tuple(f"shape {i} ({type(s).__name__.lower()})" for i, s in enumerate(shapes))
    scene = scene._replace(world=build_shapes(rows), world_names=names)
    begin, stop = _read_end("start", start, robot), _read_end("goal", goal, robot)
    for name, end in (("start", begin), ("goal", stop)):
        beyond = (end.q < scene.q_min) | (end.q > scene.q_max)
        if np.any(beyond):
            j = int(np.argmax(beyond))
            raise InputError(
                f"{name}: joint {scene.joints[j]} at {end.q[j]:.3f} rad; valid: "
                f"{scene.q_min[j]:.3f} to {scene.q_max[j]:.3f}"
            )
    found = plan_transit(
        scene, begin, stop, build_stream(number, "planner"), float(wide),
        passive="pendulum" if robot.pendulum is not None else None,
    )  # fmt: skip
    if found.blocked_by is not None:
        raise InfeasibleError(f"no plan: {found.blocked_by}", found.blocked_by)
    return found


def _read_end(name: str, end: Sequence[float] | Configuration, robot: Robot) -> Configuration:
    """Return a configuration; (x, y, z, yaw) has the arm folded."""
    names = joint_names(robot)
    if isinstance(end, Configuration):
        p, yaw, q = (read_numbers(value) for value in end)
        if q is None:
            raise InputError(f"{name}: q = {end.q!r}; valid: {len(names)} angles (rad)")
        if q.shape != (len(names),):
            raise InputError(
                f"{name}: q has {q.size} angles; {robot.name!r} has {len(names)} joints"
            )
    else:
        given = read_numbers(end)
        if given is None or given.shape != (4,):
            raise InputError(f"{name}: {end!r}; valid: x, y, z (m) and yaw (rad), four numbers")
        p, yaw, q = given[:3], given[3], posture(robot, "folded")
    if p is None or p.shape != (3,) or yaw is None or np.shape(yaw):
        raise InputError(f"{name}: {end!r}; valid: p_WB of three numbers (m), yaw a number (rad)")
    if not np.all(np.isfinite([*p, yaw, *q])):
        raise InputError(f"{name}: {end!r}; every number must be finite")
    if np.max(np.abs(p)) > FARTHEST:
        raise InputError(f"{name}: {end!r}; valid: x, y and z within {FARTHEST:g} m of W's origin")
    return Configuration(p, float(yaw), q)


def _build_row(i: int, shape: Shape) -> tuple[int, int, Array, Array, Array, Array, float]:
    """Return a shape as the planner's row; raises InputError that names the invalid value."""
    if not isinstance(shape, Box | Cylinder | Sphere):
        raise InputError(f"shape {i}: {shape!r}; valid: a Box, Cylinder or Sphere")
    at = f"shape {i}: {type(shape).__name__}"
    if isinstance(shape, Box):
        p, size = _read_vector(f"{at}.centre", shape.centre), _read_vector(f"{at}.size", shape.size)
        if not np.all(size > 0.0):
            raise _refuse(f"{at}.size", shape.size, "three lengths above 0 (m)")
        R = read_numbers(shape.R_W)
        turned = R is not None and R.shape == (3, 3) and np.allclose(R @ R.T, np.eye(3), atol=1e-6)
        if R is None or not turned or np.linalg.det(R) < 0.0:
            raise _refuse(f"{at}.R_W", shape.R_W, "a rotation matrix (3, 3)")
        return -1, BOX, p, p, R, 0.5 * size, 0.0
    names = ("start", "end") if isinstance(shape, Cylinder) else ("centre", "centre")
    a, b = (_read_vector(f"{at}.{name}", getattr(shape, name)) for name in names)
    if isinstance(shape, Cylinder) and np.array_equal(a, b):
        raise _refuse(f"{at}.end", shape.end, "a point other than start; a ball is a Sphere")
    radius = read_numbers(shape.radius)
    if radius is None or radius.shape or not 0.0 < radius < math.inf:
        raise _refuse(f"{at}.radius", shape.radius, "a length above 0 (m)")
    return -1, CAPSULE, a, b, np.eye(3), np.zeros(3), float(radius)


def _read_vector(at: str, value: ArrayLike) -> Array:
    out = read_numbers(value)
    if out is None or out.shape != (3,) or not np.all(np.isfinite(out)):
        raise _refuse(at, value, "three finite numbers (m)")
    return out


def _refuse(at: str, value: object, valid: str) -> InputError:
    shown = " ".join(repr(value).split())  # arrays have several lines
    return InputError(f"{at} = {shown}; valid: {valid}")
