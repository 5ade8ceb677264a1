"""Opens another tool's robot file as a MuJoCo specification that compiles without its meshes.

MuJoCo reads MJCF and URDF itself. Its URDF reader welds the root link to the world and drops its
mass; here the root keeps it and moves freely. Meshes are omitted unless an inertia depends on them.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.errors import InputError
from skywright.models.importing.mjcf_files import MAX_BODIES, check_files
from skywright.models.importing.sdf import read_limit, read_sdf
from skywright.models.importing.xml_input import check_span, read_numbers, read_xml

_GEOM = mujoco.mjtGeom


class Opened(NamedTuple):
    """A robot of another tool."""

    path: Path
    kind: str  # MJCF, URDF or SDF
    spec: mujoco.MjSpec
    root: ET.Element  # XML of the file; of SDF its model with includes
    notes: list[str]
    locked: Mapping[str, float] = {}  # joints with equal limits -> their position (rad or m)
    assumed: Mapping[str, frozenset[str]] = {}  # link -> of "mass" and "inertia": not in the file


def open_file(path: Path) -> Opened:
    """Read a robot file of another tool; InputError if it is invalid."""
    root = read_xml(path)
    if root.tag == "mujoco":
        check_files(path, root)
        return Opened(path, "MJCF", _open_mjcf(path), root, [])
    if root.tag == "robot":
        locked = _find_locked(path, root)
        return Opened(path, "URDF", _open_urdf(path, root, locked), root, [], locked)
    if root.tag == "sdf":
        sdf = read_sdf(path, root)
        _check_size(path, sdf.spec)
        return Opened(path, "SDF", sdf.spec, sdf.model, sdf.notes, sdf.locked, sdf.assumed)
    raise InputError(
        f"{path}: the root element is <{root.tag[:40]}>; valid: <mujoco> (MJCF), <robot> (URDF), "
        "<sdf>"
    )


def _check_size(path: Path, spec: mujoco.MjSpec) -> None:
    if len(spec.bodies) > MAX_BODIES:
        raise InputError(f"{path}: {len(spec.bodies)} bodies; at most {MAX_BODIES} are read")


def read_mjcf(path: Path) -> mujoco.MjSpec:
    """Return an MJCF file without the parts that do not describe the robot; raises InputError.

    Bodies keep their frames and are not merged.
    """
    if path.suffix.lower() != ".xml":
        raise InputError(f"{path}: MuJoCo reads MJCF from files that end in .xml only: rename it")
    try:  # by a relative path, MuJoCo does not find models that an attached model attaches
        spec = mujoco.MjSpec.from_file(str(path.absolute()))
    except ValueError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    for things in (spec.keys, spec.sensors, spec.skins, spec.pairs):
        for thing in list(things):
            spec.delete(thing)
    spec.compiler.fusestatic = False
    spec.compiler.alignfree = False  # else B had the principal axes of the inertia
    for joint in spec.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE
    return spec


def _open_mjcf(path: Path) -> mujoco.MjSpec:
    spec = read_mjcf(path)
    _check_size(path, spec)
    _check_ranges(path, spec)
    _name_joints(spec)
    folder = path.parent / spec.meshdir
    files = {mesh.name or Path(mesh.file).stem: mesh.file for mesh in spec.meshes}
    used = set()
    for body in spec.bodies:
        for geom in list(body.geoms):
            geom.material = ""
            if geom.type == _GEOM.mjGEOM_HFIELD:
                spec.delete(geom)
            elif geom.type == _GEOM.mjGEOM_MESH or geom.meshname:
                file = files.get(geom.meshname, "")
                if not _is_weighed(spec, body, geom):
                    spec.delete(geom)
                elif file and not (folder / file).is_file():
                    raise InputError(
                        f"{path}: the inertia of body {body.name!r} comes from mesh {file!r}, "
                        f"which is not in {folder}; add the file or an <inertial>"
                    )
                else:
                    used.add(geom.meshname)
    for mesh in list(spec.meshes):
        if (mesh.name or Path(mesh.file).stem) not in used:
            spec.delete(mesh)
    for things in (spec.materials, spec.textures, spec.hfields):
        for thing in list(things):
            spec.delete(thing)
    return spec


def _name_joints(spec: mujoco.MjSpec) -> None:
    """Give joints without a name one that notes and --weld can use."""
    known = {joint.name for joint in spec.joints}
    for body in spec.bodies:
        for joint in body.joints:
            if not joint.name and joint.type != mujoco.mjtJoint.mjJNT_FREE:
                name = f"joint of {body.name or 'a body'}"
                while name in known:
                    name += " (2)"
                joint.name = name
                known.add(name)


def _check_ranges(path: Path, spec: mujoco.MjSpec) -> None:
    """Reject ranges that MuJoCo would silently ignore, and those without an end."""
    ranges = []
    for joint in spec.joints:
        ranges.append((f"range of joint {joint.name!r}", joint.range))
        ranges.append((f"actuatorfrcrange of joint {joint.name!r}", joint.actfrcrange))
    for actuator in spec.actuators:
        ranges.append((f"ctrlrange of actuator {actuator.name!r}", actuator.ctrlrange))
        ranges.append((f"forcerange of actuator {actuator.name!r}", actuator.forcerange))
    for what, (low, high) in ranges:
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(
                f"{path}: {what} is {low:g} {high:g}; two finite numbers are required (without "
                "limits: remove the range)"
            )
        if low >= high and (low or high):
            raise InputError(f"{path}: {what} is {low:g} {high:g}; valid: lower below upper")


def _find_locked(path: Path, root: ET.Element) -> dict[str, float]:
    """Return the joints of a URDF file with equal limits; InputError for reversed ones."""
    out = {}
    for joint in root.findall("joint"):
        name, limit = joint.get("name", ""), joint.find("limit")
        if limit is None or joint.get("type") not in ("revolute", "prismatic"):
            continue
        texts, where = (limit.get("lower"), limit.get("upper")), f"{path}: joint {name!r}"
        for key in ("effort", "velocity"):  # MuJoCo's message names no joint
            read_limit(limit.get(key), f"{where}: {key} of <limit>", 0.0)
        if texts == (None, None):
            continue
        low, high = (
            read_numbers(text, 1, f"{where}: {end} of <limit>", [0.0])[0]
            for end, text in zip(("lower", "upper"), texts, strict=True)
        )
        check_span(low, high, where)
        if low == high:
            out[name] = low
    return out


def _is_weighed(spec: mujoco.MjSpec, body: mujoco.MjsBody, geom: mujoco.MjsGeom) -> bool:
    """Whether the body's inertia depends on this geom."""
    from_geoms = int(spec.compiler.inertiafromgeom)  # 0 false, 1 true, 2 if none is given
    if from_geoms == 0 or (from_geoms == 2 and body.explicitinertial):
        return False
    return geom.density != 0.0 if math.isnan(geom.mass) else geom.mass != 0.0


def _open_urdf(path: Path, root: ET.Element, locked: Collection[str]) -> mujoco.MjSpec:
    """Read links and joints; shapes have no effect on the inertia of a URDF link."""
    for tag in ("link", "joint"):
        _check_names(path, root, tag)
    _check_roots(path, root)
    copy = ET.Element("robot", name=root.get("name") or path.stem)
    for element in root:
        if element.tag not in ("link", "joint"):
            continue
        kept = ET.SubElement(copy, element.tag, element.attrib)
        unread = ["visual", "collision"]
        unread += ["limit"] if element.tag == "joint" and element.get("name") in locked else []
        kept.extend(child for child in element if child.tag not in unread)
        mass = element.find("inertial/mass")
        if mass is not None:
            where = f"{path}: mass of link {element.get('name')!r}"
            read_numbers(mass.get("value") or "", 1, where, [])
        if element.tag == "joint" and element.get("type") in ("floating", "planar"):
            raise InputError(
                f"{path}: joint {element.get('name')!r} is {element.get('type')}; valid: fixed, "
                "revolute, continuous, prismatic"
            )
    if sum(element.tag == "link" for element in copy) > MAX_BODIES:
        raise InputError(f"{path}: more than {MAX_BODIES} links")
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(copy, encoding="unicode"))
    except ValueError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    spec.compiler.fusestatic = False
    trees = spec.worldbody.bodies
    if not trees:
        raise InputError(f"{path}: holds no link")
    # several trees only below a link `world`; a free body must have a mass
    heavy = [b for b in trees if any(part.mass > 0.0 for part in (b, *b.find_all("body")))]
    for body in heavy or trees:
        if not body.joints:
            body.add_freejoint()  # without a name, which a joint of the file may have
    return spec


def _check_names(path: Path, root: ET.Element, tag: str) -> None:
    """Raise InputError if two links or two joints (`tag`) of a URDF file have the same name."""
    seen: set[str] = set()
    for element in root.findall(tag):
        name = element.get("name", "")
        if name in seen:
            raise InputError(
                f"{path}: two {tag}s are named {name!r}; valid: a name of its own for each {tag}"
            )
        seen.add(name)


def _check_roots(path: Path, root: ET.Element) -> None:
    """Raise InputError if links of a URDF file are not connected: MuJoCo drops the second tree."""
    below = {child.get("link") for child in root.iterfind("joint/child")}
    names = [link.get("name", "") for link in root.findall("link")]
    roots = [name for name in names if name not in below]
    if len(roots) > 1:
        raise InputError(
            f"{path}: {len(roots)} links are not the child of a joint "
            f"({', '.join(map(repr, roots[:5]))}); one root link is required: connect them with "
            "joints, or remove the others"
        )


@contextmanager
def hear_mujoco(notes: list[str]) -> Iterator[None]:
    """Collect MuJoCo's warnings as notes; by default it prints them and writes MUJOCO_LOG.TXT."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: notes.append(f"MuJoCo: {' '.join(text.split())}"))
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def compile_spec(path: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile; InputError with MuJoCo's message, or if a mass or an inertia is not finite."""
    try:
        model = spec.compile()
    except ValueError as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    for name in ("body_mass", "body_inertia", "body_ipos", "body_pos", "site_pos", "jnt_axis"):
        if not np.all(np.isfinite(getattr(model, name))):
            raise InputError(f"{path}: {name} holds numbers that are not finite")
    return model
