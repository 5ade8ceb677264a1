"""Mount of the camera of the replay's first-person view."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_y
from skywright.description.robot.spec import Robot
from skywright.models.compliant_arms import find_hands, is_compliant
from skywright.models.drawing import Drawing
from skywright.models.rigid_body import build_body_model, compute_tip, posture

WIDE_DEG = 80.0  # vertical field of view of a common first-person camera
AHEAD = math.radians(15.0)  # down, for a robot without an arm
STEEP = 0.9  # z component of forward beyond which the picture's top is the robot's front
OFF = 0.01  # m, in front of the hull
BEFORE = 0.06  # m, in front of the shoulders on a link that hangs below the hull


class Mount(NamedTuple):
    """A camera fixed to a part of the robot; vectors in the part's frame (B for the platform)."""

    part: int  # index of the part in the drawing; 0: the platform
    position: Array  # (3,) m
    forward: Array  # (3,) unit
    up: Array  # (3,) unit, of the picture
    fov_deg: float  # vertical


def find_mount(robot: Robot, drawing: Drawing) -> Mount:
    """Return the robot's own camera, or one on the hull's front rim that points at the tools.

    The rim is at the top or bottom, where tip or hands work; in the working posture the point
    between them is at the centre of the picture. A link that hangs below the hull and carries both
    arms would block the view: then the camera is between their shoulders.
    """
    if robot.camera is not None:
        c, R = robot.camera, robot.camera.rotation
        return Mount(0, np.array([c.x_m, c.y_m, c.z_m]), R[:, 2], -R[:, 1], c.field_of_view_deg)
    hub = next((s for s in drawing.parts[0].shapes if s.name == "hub"), None)
    radius, half = (float(hub.size[0]), float(hub.size[1])) if hub is not None else (0.0, 0.0)
    rim = np.array([radius + OFF, 0.0, -half])
    forward = rot_y(AHEAD)[:, 0]
    carrier = _find_carrier(drawing)
    if robot.arm is not None:
        model, q = build_body_model(robot), posture(robot, "working")
        hands = find_hands(model, q) if is_compliant(robot) else compute_tip(model, q)[0][None]
        work = hands.mean(axis=0)
        rim[2] = math.copysign(half, work[2])
        if carrier:
            shoulders = [p.position for p in drawing.parts if p.parent == carrier]
            rim = np.mean(shoulders, axis=0) + [BEFORE, 0.0, 0.0]
            work = work - _find_origin(drawing, carrier)
        forward = (work - rim) / np.linalg.norm(work - rim)
    top = np.array([1.0, 0.0, 0.0]) if abs(forward[2]) > STEEP else np.array([0.0, 0.0, 1.0])
    if forward[2] > STEEP:
        top = -top
    up = top - (top @ forward) * forward
    return Mount(carrier, rim, forward, up / np.linalg.norm(up), WIDE_DEG)


def _find_carrier(drawing: Drawing) -> int:
    """Return the part farthest from the hull that carries both hands; 0 if there are fewer than
    two."""
    ways = [
        _list_carriers(drawing, i) for i, p in enumerate(drawing.parts) if p.name.startswith("hand")
    ]
    common = set.intersection(*map(set, ways)) if len(ways) > 1 else {0}
    return max(common)


def _list_carriers(drawing: Drawing, part: int) -> list[int]:
    """Return the parts from the hull to `part`."""
    parent = drawing.parts[part].parent
    return ([] if parent < 0 else _list_carriers(drawing, parent)) + [part]


def _find_origin(drawing: Drawing, part: int) -> Array:
    """Return the origin of a part's frame in B with joints at zero."""
    way = _list_carriers(drawing, part)[1:]
    return np.sum([drawing.parts[i].position for i in way], axis=0)
