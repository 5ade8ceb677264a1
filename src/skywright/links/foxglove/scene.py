"""The scene of a flight for Foxglove: meshes in the frames of /tf, and force arrows."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from foxglove.messages import (
    ArrowPrimitive,
    Color,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    TriangleListPrimitive,
    Vector3,
)
from numpy.typing import NDArray

from skywright.links.broadcast.topics import name_frame
from skywright.models.drawing import Drawing
from skywright.reports.frames import NO_FORCE, Arrow
from skywright.reports.scene3d import Scene3d
from skywright.vehicle.topics import MAP

METRE_A_NEWTON = 0.03
"""m, length of an arrow per newton."""
MEASURED, DEMANDED = (0.90, 0.35, 0.10, 1.0), (0.20, 0.46, 0.84, 0.6)
SHAFT, HEAD = 0.012, 0.03  # m, diameters


def build_scene(scene: Scene3d, drawing: Drawing) -> SceneUpdate:
    """Return robot and world: one entity per mesh, in the frame of its part, which /tf moves."""
    entities = []
    for i, mesh in enumerate(scene.meshes):
        vertices = _decode(mesh["v"], "<f4").reshape(-1, 3)
        r, g, b = (c / 255.0 for c in mesh["rgb"])
        triangles = TriangleListPrimitive(
            pose=_pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])),
            points=[Point3(x=float(x), y=float(y), z=float(z)) for x, y, z in vertices],
            indices=[int(k) for k in _decode(mesh["f"], "<u4")],
            color=Color(r=r, g=g, b=b, a=float(mesh["a"])),
        )
        frame = name_frame(drawing, mesh["part"])
        entities.append(
            SceneEntity(id=f"mesh {i}", frame_id=frame, frame_locked=True, triangles=[triangles])
        )
    return SceneUpdate(entities=entities)


def build_forces(arrows: list[Arrow], row: NDArray[Any]) -> SceneUpdate:
    """Return the forces of a row (1,): commanded and measured, drawn in W."""
    entities = []
    for i, arrow in enumerate(arrows):
        origin, force = arrow.read(row)
        size = float(np.linalg.norm(force[0]))
        drawn = []
        if np.isfinite(origin).all() and np.isfinite(size) and size >= NO_FORCE:
            r, g, b, a = DEMANDED if arrow.demanded else MEASURED
            drawn = [
                ArrowPrimitive(
                    pose=_pose(origin[0], turn_x_to(force[0] / size)),
                    shaft_length=METRE_A_NEWTON * size, shaft_diameter=SHAFT,
                    head_length=2.0 * SHAFT, head_diameter=HEAD, color=Color(r=r, g=g, b=b, a=a),
                )
            ]  # fmt: skip
        entities.append(SceneEntity(id=f"force {i}", frame_id=MAP, arrows=drawn))
    return SceneUpdate(entities=entities)


def turn_x_to(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternion (4,) wxyz of the smallest rotation of x to a unit vector (3,)."""
    q = np.array([1.0 + v[0], 0.0, -v[2], v[1]])
    length = float(np.linalg.norm(q))
    return q / length if length > 1e-9 else np.array([0.0, 0.0, 0.0, 1.0])


def _decode(text: str, kind: str) -> NDArray[Any]:
    return np.frombuffer(base64.b64decode(text), kind)


def _pose(p: Any, q: Any) -> Pose:
    w, x, y, z = (float(c) for c in q)
    return Pose(
        position=Vector3(x=float(p[0]), y=float(p[1]), z=float(p[2])),
        orientation=Quaternion(x=x, y=y, z=z, w=w),
    )
