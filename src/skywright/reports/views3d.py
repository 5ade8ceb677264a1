"""Camera poses of the 3-D views that a page offers."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Mask
from skywright.core.rotations import rot_from_quat
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import World
from skywright.description.world.surface import build_cylinder
from skywright.models.drawing import BOX, Shape


class View(NamedTuple):
    """A camera pose."""

    name: str
    position: Array  # (3,) m
    look_at: Array  # (3,) m


AZIMUTHS_DEG = (0, 45, -45, 90, -90, 135, -135, 180)
"""Turns of the first view about the vertical, as they are preferred."""
FOV = math.radians(45.0)
ASPECT = 1.3  # narrower than most windows, so that all points fit


def build_view(name: str, points: Array, look_at: Array, side: Array, margin: float = 1.15) -> View:
    """Return the nearest camera in direction `side` (3,) from `look_at` that sees all points.

    `points` (n, 3) and `look_at` (3,) in W; the camera stays above the ground.
    """
    back = side / np.linalg.norm(side)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    d = points - look_at
    half = math.tan(FOV / 2)
    across, above = np.abs(d @ right) / (half * ASPECT), np.abs(d @ up) / half
    distance = float(np.max(d @ back + margin * np.maximum(across, above)))
    position = look_at + max(distance, 0.4) * back
    position[2] = max(position[2], 0.2)
    return View(name, position, look_at)


def build_clear_view(
    name: str, points: Array, look_at: Array, side: Array, seen: Array, walls: Sequence[Shape],
    margin: float = 1.15,
) -> View:  # fmt: skip
    """Return the view of `build_view` from the azimuth at which boxes hide least of `seen` (n, 3).

    Of equal azimuths, the nearest to that of `side` is chosen. Only boxes of `walls` count.
    """
    best, least = None, math.inf
    for turn in AZIMUTHS_DEG:
        c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        turned = np.array([c * side[0] - s * side[1], s * side[0] + c * side[1], side[2]])
        view = build_view(name, points, look_at, turned, margin)
        hidden = int(np.count_nonzero(find_hidden(view.position, seen, walls)))
        if hidden < least:
            best, least = view, hidden
    assert best is not None
    return best


def find_hidden(eye: Array, points: Array, walls: Sequence[Shape]) -> Mask:
    """Return the points (n, 3) that a box hides from `eye` (3,)."""
    hidden = np.zeros(len(points), bool)
    for wall in walls:
        if wall.kind != BOX:
            continue
        R = rot_from_quat(wall.quaternion)
        start, way = (eye - wall.position) @ R, (points - eye) @ R
        way = np.where(np.abs(way) < 1e-9, 1e-9, way)
        ends = np.stack([(-wall.size - start) / way, (wall.size - start) / way])
        enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        hidden |= (enter < leave) & (leave > 0.0) & (enter < 1.0)
    return hidden


def build_views(
    robot: Robot, world: World, flown: Array, walls: Sequence[Shape] = ()
) -> list[View]:
    """Return the camera poses; the first is the default. `flown` (n, 3): platform positions.

    `walls`: fixed shapes that must not hide the flight in the first view.
    """
    reach = 0.5 * robot.platform.diameter_m
    around = reach * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-0.4, 0.6)])
    points = (flown[:, None] + around).reshape(-1, 3)
    if world.pipe is None or robot.arm is None:
        look_at = 0.5 * (points.min(axis=0) + points.max(axis=0))
        views = [
            build_clear_view(
                "overview", points, look_at, np.array([-0.5, -1.0, 0.5]), flown, walls
            ),
            build_view("from above", points, look_at, np.array([-1e-3, -1e-2, 1.0])),
        ]
        if get_structures(world).area is not None:  # gaps are visible along the path
            views.append(build_view("from behind", points, look_at, np.array([-1.0, 0.0, 0.15])))
        return views
    cyl = build_cylinder(world.pipe)
    ends = cyl.p_WP + np.outer([-cyl.half_length, cyl.half_length], cyl.R_WP[:, 1])
    distance = np.linalg.norm(flown - cyl.p_WP, axis=1)
    near = flown[distance <= distance.min() + 0.3].mean(axis=0)
    way = near - cyl.p_WP  # from the pipe to the working position
    flat = way * [1, 1, 0]
    size = float(np.linalg.norm(flat))
    flat = flat / size if size > 0.05 else np.array([-1.0, 0.0, 0.0])
    left = np.cross([0.0, 0.0, 1.0], flat)
    touch = cyl.p_WP + cyl.radius * way / max(float(np.linalg.norm(way)), 1e-6)
    close = touch + 0.35 * way
    seen = np.concatenate([points, ends, ends * [1, 1, 0]])
    middle = 0.5 * (0.5 * (seen.min(axis=0) + seen.max(axis=0)) + close)
    # a probe works on the platform's side; hands reach around, above or below
    near_by, rise, work = 0.16, 0.7, touch
    if robot.probe is None:
        near_by, rise, work = cyl.radius + 0.4, 0.0, cyl.p_WP
    spot = work + near_by * np.array([flat, left, -left, [0, 0, 1.0], [0, 0, -1.0]])
    up = np.array([0.0, 0.0, 1.0])
    return [
        build_clear_view(
            "overview", seen, middle, 0.6 * flat + left + 0.4 * up, flown, walls, margin=1.05
        ),
        build_view("robot", near + 1.1 * around, close, 0.5 * flat + left + 0.35 * up),
        build_view(
            "probe" if robot.probe is not None else "pipe",
            spot,
            work,
            0.7 * flat + 0.9 * left + rise * up,
        ),
    ]
