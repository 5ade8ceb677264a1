"""Visual meshes of an imported file, simplified, part by part.

They are only drawn: contacts, distances and planning use capsules (docs/adr/0049). A mesh that
cannot be read is omitted with the reason; the part keeps its shapes, and the import continues.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.rotations import rot_from_quat
from skywright.description.robot.mesh import FAR, MAX_TRIANGLES, MAX_VERTICES, encode_mesh
from skywright.errors import InputError
from skywright.models.importing.chain import Chain
from skywright.models.importing.collada_meshes import Surface, read_collada
from skywright.models.importing.looks import Look, list_looks
from skywright.models.importing.opening import Opened
from skywright.models.importing.sdf_files import RESOURCES
from skywright.models.importing.values import Value

LARGEST_FILE = 60_000_000
"""Bytes of the largest mesh file that is read."""
LEAST_TRIANGLES = 100
"""Least number of triangles of a simplified mesh."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
READ = (".stl", ".obj", ".msh", ".dae")
GREY = (0.54, 0.57, 0.61)
MOST_PIECES = 60
"""Parts and colours drawn separately; beyond this number, a part has its dominant colour."""
UP = 3
"""Folders above the file that `../` may reach."""


class Piece(NamedTuple):
    """Triangles in the frame of a part of the robot file."""

    part: int  # 0: the platform
    color: str
    vertices: Array  # (n, 3) m
    faces: Ints  # (m, 3)
    files: tuple[str, ...]


def build_meshes(
    opened: Sequence[tuple[Opened, str]],
    model: mujoco.MjModel,
    data: mujoco.MjData,
    chain: Chain,
    frames: Sequence[tuple[Array, Array]],
    names: Sequence[str],
) -> tuple[dict[str, Value], list[str]]:
    """Return the tables of meshes, and notes on omitted ones.

    `opened` are the files with the prefix of their bodies' names, `data` the model with the chain's
    joints at zero, `frames` (R, p) of each part of the robot file in the frame of the root body,
    `names` the names of the parts there.
    """
    notes: dict[str, None] = {}
    found: dict[tuple[int, str], list[Piece]] = {}
    for file, prefix in opened:
        for look in list_looks(file, prefix):
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, look.body)
            part = chain.members.get(body)
            if part is None:
                continue
            try:
                path = find_mesh(file.path, look.uri)
                surfaces = read_mesh(path)
            except InputError as error:
                notes[f"mesh left out: {error}"] = None
                continue
            R, p = frames[part]
            W = data.xmat[body].reshape(3, 3)
            with np.errstate(over="ignore", invalid="ignore"):
                inside = [_place(surface.vertices, look) for surface in surfaces]
                placed = [((data.xpos[body] + v @ W.T) - p) @ R for v in inside]
                reach = float(np.max([np.max(np.abs(v)) for v in placed]))
            if not reach <= FAR:
                notes[f"mesh left out: {path.name} reaches {reach:.3g} m"] = None
                continue
            for surface, vertices in zip(surfaces, placed, strict=True):
                faces = surface.faces if np.prod(look.scale) > 0.0 else surface.faces[:, ::-1]
                rgb = np.clip(look.color or surface.color or GREY, 0.0, 1.0)
                color = "#" + "".join(f"{round(255 * x):02x}" for x in rgb)
                piece = Piece(part, color, vertices, faces, (path.name,))
                found.setdefault((part, color), []).append(piece)
    if len(found) > MOST_PIECES:
        found = _paint_plainly(found)
    pieces = [merge(group) for group in found.values()]
    return dict(_write(pieces, names)), list(notes)


def _place(vertices: Array, look: Look) -> Array:
    """Return vertices (n, 3) of a mesh's file in the frame of its body."""
    straight = (vertices - look.refpos) @ rot_from_quat(look.refquat)
    return look.p + (straight * look.scale) @ look.R.T


def _paint_plainly(found: dict[tuple[int, str], list[Piece]]) -> dict[tuple[int, str], list[Piece]]:
    """Return all of a part in the colour of most of its triangles."""
    out = {}
    for part in {part for part, _ in found}:
        mine = {color: group for (p, color), group in found.items() if p == part}
        most = max(mine, key=lambda color: sum(len(piece.faces) for piece in mine[color]))
        out[part, most] = [piece._replace(color=most) for group in mine.values() for piece in group]
    return out


def _write(pieces: list[Piece], names: Sequence[str]) -> Iterator[tuple[str, Value]]:
    left = MAX_TRIANGLES
    for k, piece in enumerate(sorted(pieces, key=lambda piece: len(piece.faces))):
        # triangles that small pieces do not need go to the following ones
        most = max(left // (len(pieces) - k), LEAST_TRIANGLES)
        vertices, faces = simplify(piece.vertices, piece.faces, most)
        left -= len(faces)
        if len(faces) == 0:
            continue
        files = ", ".join(dict.fromkeys(piece.files))
        shown = files if len(files) < 60 else f"{files[:57]}..."
        note = f"{shown}: {len(faces)} of {len(piece.faces)} triangles"
        table = f"robot.meshes.{re.sub(r'[^a-z0-9_]', '_', names[piece.part].lower())}_{k}"
        yield f"{table}.on", Value(names[piece.part])
        yield f"{table}.color", Value(piece.color)
        yield f"{table}.data", Value(encode_mesh(vertices, faces), "imported", note)


def merge(pieces: Sequence[Piece]) -> Piece:
    """Return the triangles of several pieces of one part and colour as one."""
    starts = np.cumsum([0] + [len(p.vertices) for p in pieces[:-1]])
    faces = np.concatenate([p.faces + start for p, start in zip(pieces, starts, strict=True)])
    vertices = np.concatenate([p.vertices for p in pieces])
    return pieces[0]._replace(
        vertices=vertices, faces=faces, files=tuple(name for p in pieces for name in p.files)
    )


def simplify(vertices: Array, faces: Ints, most: int) -> tuple[Array, Ints]:
    """Return at most `most` triangles: vertices within a cell of a grid become one.

    The grid is as fine as that allows (Rossignac and Borrel, "Multi-resolution 3D approximations
    for rendering complex scenes", 1993).
    """
    most = min(most, MAX_VERTICES // 3)  # of triangles without shared vertices
    if len(faces) <= most and len(vertices) <= 3 * most:
        return vertices, faces
    size = float(np.max(np.ptp(vertices, axis=0)))
    fine, coarse = size / 4096.0, size
    best = _cluster(vertices, faces, fine)
    if len(best[1]) <= most:
        return best
    for _ in range(12):
        cell = float(np.sqrt(fine * coarse))
        found = _cluster(vertices, faces, cell)
        if len(found[1]) <= most:
            best, coarse = found, cell
        else:
            fine = cell
    return best if len(best[1]) <= most else _cluster(vertices, faces, coarse)


def _cluster(vertices: Array, faces: Ints, cell: float) -> tuple[Array, Ints]:
    """Merge the vertices of each cell; collapsed and duplicate triangles are removed."""
    keys = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    flat = (keys[:, 0] << 40) | (keys[:, 1] << 20) | keys[:, 2]
    _, where = np.unique(flat, return_inverse=True)
    count = np.bincount(where)
    merged = np.stack([np.bincount(where, vertices[:, a]) / count for a in range(3)], axis=1)
    out = where[faces]
    flat_ones = (out[:, 0] == out[:, 1]) | (out[:, 1] == out[:, 2]) | (out[:, 2] == out[:, 0])
    out = out[~flat_ones]
    _, first = np.unique(np.sort(out, axis=1), axis=0, return_index=True)
    out = out[np.sort(first)]
    used, renamed = np.unique(out, return_inverse=True)
    return merged[used], renamed.reshape(out.shape)


@lru_cache(maxsize=64)
def read_mesh(path: Path) -> tuple[Surface, ...]:
    """Return the triangles of a file by colour; InputError if it is no mesh."""
    if path.suffix.lower() not in READ:
        raise InputError(f"{path}: valid meshes: {', '.join(READ)}")
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(f"{path}: {size / 1e6:.0f} MB; at most {LARGEST_FILE / 1e6:.0f} are read")
    if path.suffix.lower() == ".dae":
        return read_collada(path, LARGEST_FILE)
    if path.suffix.lower() == ".stl":
        return (_read_stl(path, path.read_bytes()),)
    spec = mujoco.MjSpec()
    # of a surface: open, flat and inside-out meshes are drawn, too
    spec.add_mesh(name="m", file=str(path), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="m", contype=0, conaffinity=0)
    try:
        model = spec.compile()
    except ValueError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.geom_quat[0])  # MuJoCo rotates a mesh into its principal axes
    vertices = model.geom_pos[0] + model.mesh_vert.astype(float) @ R.reshape(3, 3).T
    if not np.all(np.isfinite(vertices)):
        raise InputError(f"{path}: has a vertex that is not finite")
    return (Surface(vertices, np.array(model.mesh_face, dtype=np.int64), None),)


def _read_stl(path: Path, data: bytes) -> Surface:
    """Read binary and text STL: MuJoCo reads neither the latter nor 200,000 triangles."""
    n = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + _TRIANGLE.itemsize * n:
        corners = np.frombuffer(data, _TRIANGLE, n, 84)["corners"].astype(float)
    else:
        found = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
        try:
            corners = np.array(found, dtype=float)
        except ValueError:
            corners = np.zeros(0)
    if corners.size == 0 or corners.size % 9:
        raise InputError(f"{path}: holds no triangles, neither as binary STL nor as text")
    if not np.all(np.isfinite(corners)):
        raise InputError(f"{path}: has a vertex that is not finite")
    vertices, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return Surface(vertices, faces.reshape(-1, 3), None)


def find_mesh(file: Path, uri: str) -> Path:
    """Return the file of a URI in a robot file; InputError if it does not exist.

    package:// and model:// are searched in the folders around the file, and in the folders of
    ROS_PACKAGE_PATH and of Gazebo's variables.
    """
    here = file.resolve().parent
    around = [here, *here.parents][: UP + 1]
    scheme, colon, rest = uri.partition("://")
    if not colon:
        scheme, rest = "", uri
    folders = list(around) if scheme in ("package", "model") else [here]
    if scheme in ("package", "model"):
        for variable in ("ROS_PACKAGE_PATH", *RESOURCES):
            folders += [Path(f) for f in os.environ.get(variable, "").split(os.pathsep) if f]
        name, _, inside = rest.partition("/")
        folders += [f.parent for f in here.parents if f.name == name]
        folders += [f for f in around if (f / inside).is_file()]
        tries = [f / rest for f in folders] + [f / inside for f in around]
    else:
        tries = [here / rest]
    roots = [around[-1], *(f.resolve() for f in folders)]
    for path in tries:
        try:
            there = path.resolve()
            if not there.is_file():
                continue
        except (OSError, ValueError):
            continue
        if scheme != "file" and not any(there.is_relative_to(root) for root in roots):
            raise InputError(f"{uri[:120]!r} of {file.name} lies outside of the model's folders")
        return there
    raise InputError(f"{uri[:120]!r} of {file.name} was not found")
