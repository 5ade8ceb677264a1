"""Visual meshes of other tools' robot files: meshes on bodies, with colours."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_from_quat, rot_x, rot_y, rot_z
from skywright.models.importing.opening import Opened, compile_spec, read_mjcf
from skywright.models.importing.sdf_frames import Frames
from skywright.models.importing.xml_input import read_numbers

Color = tuple[float, float, float]


class Look(NamedTuple):
    """A mesh on a body of the compiled model."""

    body: str
    uri: str
    scale: Array  # (3,)
    p: Array  # (3,) m, in the body
    R: Array  # (3, 3)
    color: Color | None  # None: the file contains none
    refpos: Array = np.zeros(3)  # of the mesh's frame in its file, before scaling (MJCF)
    refquat: Array = np.array([1.0, 0.0, 0.0, 0.0])


def list_looks(opened: Opened, prefix: str) -> list[Look]:
    """Return a file's visual meshes; for bodies without them, the collision meshes.

    Bodies' names get the `prefix`. Raises InputError on invalid numbers.
    """
    if opened.kind == "MJCF":
        found = _list_mjcf(opened.path)
    else:
        tags = _list_urdf(opened) if opened.kind == "URDF" else _list_sdf(opened)
        found = list(tags)
    seen = {look.body for look, is_visual in found if is_visual}
    return [
        look._replace(body=prefix + look.body)
        for look, is_visual in found
        if is_visual or look.body not in seen
    ]


def _list_urdf(opened: Opened) -> Iterator[tuple[Look, bool]]:
    colors = {
        element.get("name", ""): _read_rgba(element.find("color"), "rgba")
        for element in opened.root.findall("material")
    }
    for link in opened.root.findall("link"):
        name = link.get("name", "")
        where = f"{opened.path}: mesh of link {name!r}"
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                mesh = element.find("geometry/mesh")
                if mesh is None or not mesh.get("filename"):
                    continue
                origin = element.find("origin")
                xyz, rpy = (
                    read_numbers(None if origin is None else origin.get(k), 3, where, [0.0] * 3)
                    for k in ("xyz", "rpy")
                )
                material = element.find("material")
                color = None if material is None else _read_rgba(material.find("color"), "rgba")
                if material is not None and color is None:
                    color = colors.get(material.get("name", ""))
                scale = np.array(read_numbers(mesh.get("scale"), 3, where, [1.0] * 3))
                R = rot_z(rpy[2]) @ rot_y(rpy[1]) @ rot_x(rpy[0])
                uri = mesh.get("filename", "")
                yield Look(name, uri, scale, np.array(xyz), R, color), tag == "visual"


def _list_sdf(opened: Opened) -> Iterator[tuple[Look, bool]]:
    frames = Frames(opened.path, opened.root)
    for link in opened.root.findall("link"):
        name = link.get("name", "")
        where = f"{opened.path}: mesh of link {name!r}"
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                uri = (element.findtext("geometry/mesh/uri") or "").strip()
                if not uri:
                    continue
                scale = read_numbers(element.findtext("geometry/mesh/scale"), 3, where, [1.0] * 3)
                at = frames.place_in(name, element.find("pose"), where)
                color = _read_rgba(element.find("material/diffuse"), "")
                yield Look(name, uri, np.array(scale), at.p, at.R, color), tag == "visual"


def _read_rgba(element: ET.Element | None, key: str) -> Color | None:
    """Return the colour of an element; None if it is invalid, because colours are optional."""
    text = None if element is None else element.get(key) if key else element.text
    try:
        values = [float(x) for x in (text or "").split()]
    except ValueError:
        return None
    good = len(values) in (3, 4) and all(map(math.isfinite, values))
    return (values[0], values[1], values[2]) if good else None


def _list_mjcf(path: Path) -> list[tuple[Look, bool]]:
    """Return the mesh geoms of an MJCF file; MuJoCo places them, with small balls instead."""
    spec = read_mjcf(path)
    spec.compiler.settotalmass = -1.0  # of which MuJoCo warns, and masses are not used here
    meshes = {m.name or Path(m.file).stem: m for m in spec.meshes}
    paints = {m.name: m.rgba for m in spec.materials}
    found: list[tuple[str, Look, bool]] = []
    for body in spec.bodies:
        for geom in list(body.geoms):
            mesh, is_mesh = meshes.get(geom.meshname), geom.type == mujoco.mjtGeom.mjGEOM_MESH
            # a shape fitted to a mesh is not visual, and has no size of its own
            if geom.type == mujoco.mjtGeom.mjGEOM_HFIELD or (geom.meshname and not is_mesh):
                spec.delete(geom)
                continue
            rgba = paints.get(geom.material, geom.rgba)
            visual = geom.contype == 0 and geom.conaffinity == 0
            geom.material, geom.meshname = "", ""
            if not is_mesh:
                continue
            geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [1e-3, 0.0, 0.0]
            geom.name = geom.name or f"look {len(found)}"  # contact pairs refer to this name
            if body.name and mesh is not None and mesh.file and rgba[3] > 0.0:
                color = (float(rgba[0]), float(rgba[1]), float(rgba[2]))
                look = Look(
                    body.name, os.path.join(spec.meshdir, mesh.file), np.array(mesh.scale),
                    np.zeros(3), np.eye(3), color, np.array(mesh.refpos), np.array(mesh.refquat),
                )  # fmt: skip
                found.append((geom.name, look, visual))
    for things in (spec.meshes, spec.materials, spec.textures, spec.hfields):
        for thing in list(things):
            spec.delete(thing)
    model = compile_spec(path, spec)
    out = []
    for ball, look, visual in found:
        geom = model.geom(ball)
        R = rot_from_quat(np.array(geom.quat, dtype=float))
        out.append((look._replace(p=np.array(geom.pos), R=R), visual))
    return out
