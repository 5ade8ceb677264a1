"""COLLADA meshes (`.dae`): the triangles of the file's scene, in metres, in the axes of the file.

pycollada reads geometries and materials. This module traverses the scene and rejects files that
could exhaust memory or time. `up_axis` is not applied: RViz, MoveIt and Gazebo do not apply it
either, so existing robots are drawn in the axes of their meshes (docs/adr/0049).
"""

from __future__ import annotations

import io
import math
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skywright.core.arrays import Array, Ints
from skywright.core.bounded import read_text
from skywright.core.rotations import rot_from_quat
from skywright.errors import InputError
from skywright.models.importing.xml_input import parse_xml, read_numbers

Color = tuple[float, float, float]
MOST_TRIANGLES = 2_000_000
"""Limit for a scene with all its instances; a binary STL file of 60 MB has 1.2 million triangles.
"""
MOST_VISITS = 100_000
"""Visited elements of the scene, once per instance: nested instances grow exponentially."""
COLORS = {"library_images", "library_effects", "library_materials"}
IN_MESH = {"source", "vertices", "triangles", "tristrips", "trifans", "polylist", "polygons"}
REFUSED = {"instance_controller": "a skin", "skew": "a shear", "lookat": "a camera's transform"}


class Surface(NamedTuple):
    """Triangles of one colour."""

    vertices: Array  # (n, 3) m
    faces: Ints  # (m, 3)
    color: Color | None  # None: the file contains none


def read_collada(path: Path, limit: int) -> tuple[Surface, ...]:
    """Return the surfaces of a file of at most `limit` bytes; raises InputError in one line."""
    try:
        from collada import Collada
        from collada.common import DaeUnsupportedError
    except ImportError:
        raise InputError(
            "COLLADA meshes (.dae) need pycollada: pip install 'skywright[collada]'"
        ) from None

    def load(kept: set[str]) -> Any:
        # unsupported: inputs of faces that are not needed here
        return Collada(_copy(root, kept), ignore=[DaeUnsupportedError])

    root = parse_xml(read_text(path, limit), path)
    if _tag(root) != "COLLADA":
        raise InputError(f"{path}: the root element is <{_tag(root)[:40]}>; valid: <COLLADA>")
    unit = root.find("{*}asset/{*}unit")
    written = None if unit is None else unit.get("meter")
    metre = read_numbers(written, 1, f"{path}: meter of <unit>", [1.0])[0]
    if metre <= 0.0:
        raise InputError(f"{path}: meter of <unit> is {metre:g}; valid: above 0")
    _check_accessors(path, root)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        # numpy stops at a word that is not a number, and only warns
        warnings.filterwarnings("error", message="string or file could not be read")
        try:
            try:
                document = load({"library_geometries"} | COLORS)
            except Exception:  # a missing colour does not exclude the mesh
                document = load({"library_geometries"})
            found = tuple(_list_surfaces(path, root, document, metre))
        except InputError:
            raise
        except Exception as error:  # any error of pycollada in an invalid file
            text, kind = " ".join(str(error).split()), type(error).__name__
            text = text if text.startswith(kind) else f"{kind}: {text}"
            raise InputError(f"{path}: not read as COLLADA: {text[:160]}") from None
    if not found:
        raise InputError(f"{path}: its scene holds no triangles")
    return found


def _tag(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2]


def _check_accessors(path: Path, root: ET.Element) -> None:
    """Reject vertices that are not contiguous: pycollada reads them as if they were."""
    for mesh in root.findall("{*}library_geometries/{*}geometry/{*}mesh"):
        inputs = mesh.findall("{*}vertices/{*}input[@semantic='POSITION']")
        places = {i.get("source", "")[1:] for i in inputs}
        for source in mesh.findall("{*}source"):
            accessor = source.find("{*}technique_common/{*}accessor")
            if accessor is None or source.get("id") not in places:
                continue
            n = str(len(accessor.findall("{*}param")))
            offset, stride = accessor.get("offset", "0"), accessor.get("stride", n)
            if offset.strip() != "0" or stride.strip() != n:
                raise InputError(
                    f"{path}: <accessor> of vertices has offset {offset[:20]} and stride "
                    f"{stride[:20]}; valid: 0 and {n}, the number of its <param>"
                )


def _copy(root: ET.Element, kept: set[str]) -> io.BytesIO:
    """Write the `kept` libraries to a new document, without document type, entities or comments."""
    copy = ET.Element(root.tag, root.attrib)
    for library in root:
        if _tag(library) in kept:
            copy.append(library)
    for mesh in copy.findall("{*}library_geometries/{*}geometry/{*}mesh"):
        for child in list(mesh):
            if _tag(child) not in IN_MESH:
                mesh.remove(child)
    return io.BytesIO(ET.tostring(copy))


def _list_surfaces(path: Path, root: ET.Element, document: Any, metre: float) -> Iterator[Surface]:
    """Traverse the scene: nodes, their transforms, and their geometries."""
    by_id = {e.get("id"): e for e in root.findall(".//{*}node")}
    scenes = root.findall("{*}library_visual_scenes/{*}visual_scene")
    shown = root.find("{*}scene/{*}instance_visual_scene")
    wanted = "" if shown is None else shown.get("url", "")
    scenes = [s for s in scenes if f"#{s.get('id')}" == wanted] or scenes
    todo = [(node, np.eye(4)) for s in scenes[:1] for node in s.findall("{*}node")[::-1]]
    visits = triangles = 0
    while todo:
        node, above = todo.pop()
        here = above
        for child in node:
            here = here @ _read_transform(path, child)
        for child in list(node)[::-1]:
            if _tag(child) == "node":
                todo.append((child, here))
            elif _tag(child) == "instance_node":
                todo.append((_look_up(path, by_id, child), here))
        instances = node.findall("{*}instance_geometry")
        geometries = [_look_up(path, document.geometries, instance) for instance in instances]
        visits += 1 + len(node) + sum(len(list(instance.iter())) for instance in instances)
        visits += sum(len(geometry.primitives) for geometry in geometries)
        if visits + len(todo) > MOST_VISITS:
            raise InputError(f"{path}: its scene has more than {MOST_VISITS} elements")
        for instance, geometry in zip(instances, geometries, strict=True):
            colors = _read_colors(instance, document)
            for primitive in geometry.primitives:
                corners = _find_corners(path, primitive)
                triangles += len(corners)
                if triangles > MOST_TRIANGLES:
                    raise InputError(f"{path}: more than {MOST_TRIANGLES} triangles")
                if len(corners):
                    color = colors.get(primitive.material)
                    yield _place(path, primitive.vertex, corners, here, metre, color)


def _look_up(path: Path, there: Any, instance: ET.Element) -> Any:
    """Return the target of an instance of a node or a geometry."""
    url = instance.get("url", "")
    found = there.get(url.removeprefix("#"))
    if found is None:
        raise InputError(f"{path}: <{_tag(instance)}> of {url[:80]!r}, which does not exist")
    return found


def _read_transform(path: Path, element: ET.Element) -> Array:
    """Return the matrix (4, 4) of an element of a node, or the identity if it is no transform."""
    name, where = _tag(element), f"{path}: <{_tag(element)}> of a node"
    out = np.eye(4)
    if name in REFUSED:
        raise InputError(f"{where}, {REFUSED[name]}, is not read")
    if name == "matrix":
        return np.reshape(read_numbers(element.text, 16, where, out.ravel().tolist()), (4, 4))
    if name == "translate":
        out[:3, 3] = read_numbers(element.text, 3, where, [0.0] * 3)
    elif name == "scale":
        out[:3, :3] = np.diag(read_numbers(element.text, 3, where, [1.0] * 3))
    elif name == "rotate":
        *axis, angle = read_numbers(element.text, 4, where, [0.0, 0.0, 1.0, 0.0])
        size = float(np.linalg.norm(axis))
        if size == 0.0:
            raise InputError(f"{where}: the axis has no direction")
        half = 0.5 * math.radians(angle)
        out[:3, :3] = rot_from_quat(
            np.array([math.cos(half), *(math.sin(half) / size * np.array(axis))])
        )
    return out


def _read_colors(instance: ET.Element, document: Any) -> dict[str | None, Color]:
    """Return the diffuse colour of each material symbol of a geometry's faces."""
    out = {}
    for bound in instance.findall("{*}bind_material/{*}technique_common/{*}instance_material"):
        material = document.materials.get(bound.get("target", "")[1:])
        if material is None:
            continue
        effect = material.effect
        written = effect.xmlnode.find(".//{*}diffuse/{*}color") is not None  # pycollada: else black
        if written and len(effect.diffuse) >= 3 and all(map(math.isfinite, effect.diffuse)):
            out[bound.get("symbol")] = tuple(effect.diffuse[:3])
    return out


def _find_corners(path: Path, primitive: Any) -> Ints:
    """Return the vertices (m, 3) of each triangle; polygons become triangle fans."""
    index = primitive.vertex_index
    if index is None:
        return np.zeros((0, 3), dtype=np.int64)
    index = np.asarray(index, dtype=np.int64)
    if index.ndim == 2:
        return index
    counts = np.asarray(primitive.vcounts, dtype=np.int64)
    if np.any(counts < 0) or int(np.sum(counts)) != len(index):
        raise InputError(
            f"{path}: <vcount> has {int(np.sum(counts))} corners of polygons, <p> {len(index)}"
        )
    each = np.maximum(counts - 2, 0)
    first = np.repeat(np.cumsum(counts) - counts, each)
    k = np.arange(len(first)) - np.repeat(np.cumsum(each) - each, each)
    return np.asarray(index[np.stack([first, first + k + 1, first + k + 2], axis=1)])


def _place(
    path: Path, source: Array, corners: Ints, matrix: Array, metre: float, color: Color | None
) -> Surface:
    used, faces = np.unique(corners, return_inverse=True)
    if used[0] < 0:
        raise InputError(f"{path}: index {used[0]} of a vertex; valid: 0 to {len(source) - 1}")
    vertices = np.asarray(source[used], dtype=float)
    vertices = metre * (vertices @ matrix[:3, :3].T + matrix[:3, 3])
    if not np.all(np.isfinite(vertices)):
        raise InputError(f"{path}: has a vertex that is not finite")
    faces = faces.reshape(corners.shape)
    return Surface(vertices, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces, color)
