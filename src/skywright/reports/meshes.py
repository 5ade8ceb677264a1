"""Triangle meshes of simple solids and ribbons, for the 3-D views."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.rotations import rot_from_quat
from skywright.models.drawing import Shape


class Mesh(NamedTuple):
    """Vertices (n, 3) in m and triangles (m, 3), counter-clockwise seen from outside."""

    vertices: Array
    faces: Ints


def build_mesh(shape: Shape, segments: int = 28) -> Mesh:
    """Return the mesh of a shape in the frame of its part. Raises ValueError for a plane."""
    if shape.mesh is not None:  # separate vertices per triangle for flat shading
        vertices, faces = shape.mesh
        mesh = Mesh(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
    elif shape.kind == "box":
        mesh = _box(shape.size)
    elif shape.kind == "sphere":
        mesh = _revolve(*_arc(shape.size[0], 0.0, 0.0), segments)
    elif shape.kind == "capsule":
        mesh = _revolve(*_arc(shape.size[0], shape.size[1], shape.size[1]), segments)
    elif shape.kind == "cylinder":
        mesh = _cylinder(shape.size[0], shape.size[1], segments)
    else:
        raise ValueError(f"no mesh for a {shape.kind}")
    R = rot_from_quat(shape.quaternion)
    return Mesh(mesh.vertices @ R.T + shape.position, mesh.faces)


def merge_meshes(meshes: list[Mesh]) -> Mesh:
    """Merge meshes into one."""
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    faces = [m.faces + start for m, start in zip(meshes, starts, strict=True)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(faces))


def build_ribbon(points: Array, normals: Array, width: float) -> Mesh:
    """Return a flat band of `width` (m) along points (n, 3) on a surface with normals (n, 3)."""
    along = np.gradient(points, axis=0)
    across = np.cross(normals, along)
    across *= 0.5 * width / np.linalg.norm(across, axis=1, keepdims=True)
    n = len(points)
    vertices = np.concatenate([points - across, points + across])
    i = np.arange(n - 1)
    faces = np.concatenate(
        [np.column_stack([i, i + 1, i + n]), np.column_stack([i + 1, i + n + 1, i + n])]
    )
    return Mesh(vertices, faces)


def _arc(radius: float, low: float, high: float) -> tuple[Array, Array]:
    """Return the profile (r, z) of two half spheres, the lower one at -low, the upper one at
    +high."""
    angle = np.linspace(-math.pi / 2, math.pi / 2, 12)
    z = radius * np.sin(angle) + np.where(angle < 0, -low, high)
    return radius * np.cos(angle), z


def _revolve(r: Array, z: Array, segments: int) -> Mesh:
    """Revolve the profile (r, z) about z, with shared vertices for smooth shading."""
    turn = np.linspace(0.0, 2 * math.pi, segments, endpoint=False)
    rows = len(r)
    vertices = np.stack(
        [np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn)), np.outer(z, np.ones(segments))],
        axis=-1,
    ).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(segments), indexing="ij")
    a, b = (i * segments + j).ravel(), (i * segments + (j + 1) % segments).ravel()
    faces = np.concatenate(
        [np.column_stack([a, b, b + segments]), np.column_stack([a, b + segments, a + segments])]
    )
    return Mesh(vertices, faces)


def _cylinder(radius: float, half: float, segments: int) -> Mesh:
    """Build wall and lids with separate vertices, for sharp edges."""
    wall = _revolve(np.full(2, radius), np.array([-half, half]), segments)
    top = _revolve(np.array([radius, 0.0]), np.full(2, half), segments)
    bottom = _revolve(np.array([0.0, radius]), np.full(2, -half), segments)
    return merge_meshes([wall, top, bottom])


def _box(half: Array) -> Mesh:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    vertices = np.concatenate([corners[s] for s in sides])
    faces = np.array([[4 * k, 4 * k + a, 4 * k + a + 1] for k in range(6) for a in (1, 2)])
    return Mesh(vertices, faces)
