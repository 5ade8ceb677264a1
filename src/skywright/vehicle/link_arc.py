"""Take-off and landing of a robot whose arms lie on the ground at the end of a swinging link.

The end on the ground stays in place while the platform flies on a circle about it: forward and up
until the link hangs (take-off), backward and down until it lies again (landing; Suarez 2020,
section VI-B). Both begin and end above the robot's position on the ground, so that missions need
not distinguish this robot from others.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.description.robot.limbs import list_joints, list_limbs
from skywright.description.robot.spec import Robot
from skywright.models.rigid_body import compute_kinematics, posture
from skywright.vehicle.rest_to_rest import duration, quintic

Array = NDArray[np.float64]


LYING = 0.03  # m, height above the lowest joint up to which a joint counts as on the ground
ARC_SPEED = 0.5  # share of the speed limit while the link's end is on the ground
PRESS = 0.05  # m, goal of a landing below the ground, so that friction holds the end
NEAR, TOUCH_SPEED = 0.1, 0.1  # m above the first touch; m/s from there on
SETTLE = 2.0  # s, for the thrust to fade on the ground


class ArcPath(NamedTuple):
    """Rows of a take-off or landing, one every `period`."""

    forward: Array  # (n,) m
    height: Array  # (n,) m, of the platform's origin
    swing: Array  # (n,) rad, of the link's joint


class LinkArc(NamedTuple):
    """Circle of the joint that carries the link, about the end on the ground; in the plane x-z."""

    swing: int  # index of the joint in q
    landed: float  # rad, its angle on the ground
    joint: Array  # (3,) m, in B
    radius: float  # m
    lean: float  # rad, of the line from the end on the ground to the joint, on the ground
    top: float  # m, height of the platform's origin when the link hangs and its end touches

    def compute_path(self, angle: Array) -> tuple[Array, Array]:
        """Return (forward (n,), height (n,)) m of the platform at lean `angle` (n,) rad.

        `forward` is zero where the link hangs, and negative behind that position.
        """
        drop = self.radius * (1.0 - np.cos(angle))
        return -self.radius * np.sin(angle), self.top - drop


def compute_link_arc(robot: Robot, model: NDArray[Any]) -> LinkArc | None:
    """Return the arc of a robot with a swinging link, None for other robots."""
    if robot.pendulum is None:
        return None
    landed = posture(robot, "landed")
    k = compute_kinematics(model, landed)
    limbs = list_limbs(robot)
    swing = next(j for j, limb in enumerate(list_joints(robot)) if limb.servo < 0)
    joint = k["p"][0].copy()
    # of the joints and ends near the ground, the one farthest from the link's joint
    points = np.vstack([k["p"][1 : len(limbs)], k["p_BT"]])
    thick = np.array([limb.link.radius_m for limb in limbs[1:]] + [limbs[-1].link.radius_m])
    low = points[:, 2] < np.min(points[:, 2]) + LYING
    away = points[low] - joint
    reach = np.hypot(away[:, 0], away[:, 2])
    i = int(np.argmax(reach))
    radius, end = float(reach[i]), float(thick[low][i])
    lean = math.acos((robot.platform.gear_height_m + joint[2] - end) / radius)
    return LinkArc(swing, float(landed[swing]), joint, radius, lean, float(radius + end - joint[2]))


def plan_take_off(
    arc: LinkArc, height: float, speed: float, acceleration: float, period: float
) -> ArcPath:
    """Return the path along the arc, up to `height` (m), and back over the start."""
    lean = arc.lean * (1.0 - _glide(arc.radius * arc.lean, ARC_SPEED * speed, acceleration, period))
    forward, z = arc.compute_path(lean)
    up = arc.top + _glide(height - arc.top, speed, acceleration, period)[1:] * (height - arc.top)
    back = _glide(-forward[0], speed, acceleration, period)[1:] * forward[0]
    n, m = len(up), len(back)
    return ArcPath(
        np.concatenate([forward, np.zeros(n), back]),
        np.concatenate([z, up, np.full(m, up[-1])]),
        np.append(arc.landed * lean / arc.lean, np.zeros(n + m)),
    )


def plan_landing(
    arc: LinkArc, height: float, speed: float, acceleration: float, period: float,
    here: bool = False,
) -> ArcPath:  # fmt: skip
    """Return the path from `height` (m) forward, down to the first touch, along the arc, to rest.

    It ends on the ground below its start; `here` omits the forward motion.
    """
    near = min(arc.top + NEAR, height)
    down = height + _glide(height - near, speed, acceleration, period) * (near - height)
    last = arc.top - PRESS
    touch = near + _glide(near - last, TOUCH_SPEED, acceleration, period)[1:] * (last - near)
    share = _glide(arc.radius * arc.lean, ARC_SPEED * speed, acceleration, period)[1:]
    share = np.append(share, np.ones(round(SETTLE / period)))
    forward, z = arc.compute_path(arc.lean * share)
    ahead = np.zeros(0)
    if not here:
        ahead = (1.0 - _glide(-forward[-1], speed, acceleration, period)) * forward[-1]
    n, m = len(down) - 1 + len(touch), len(ahead)
    return ArcPath(
        np.concatenate([ahead, np.zeros(n), forward]),
        np.concatenate([np.full(m, height), down[1:], touch, z - PRESS]),
        np.append(np.zeros(n + m), arc.landed * share),
    )


def _glide(distance: float, speed: float, acceleration: float, period: float) -> Array:
    """Return the share (n,) of a rest-to-rest motion, from 0 to 1, a row every `period` s."""
    n = max(math.ceil(duration(abs(distance), speed, acceleration) / period), 1)
    return quintic(np.linspace(0.0, 1.0, n + 1))[0]
