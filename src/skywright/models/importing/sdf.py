"""SDF models: links, joints and their frames as a MuJoCo specification.

Frames follow the pose semantics of SDF 1.7 and later (`relative_to`, `expressed_in`), which earlier
files without these attributes satisfy too, except for the axes of joints: up to 1.4, and with
`use_parent_model_frame`, these are in the model's frame (http://sdformat.org, "Pose frame
semantics").
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import quat_from_rot, rot_from_quat, rot_x, rot_y, rot_z
from skywright.errors import InputError
from skywright.models.importing.xml_input import (
    MAX_ELEMENTS,
    MAX_INCLUDES,
    check_span,
    read_numbers,
    read_xml,
)
from skywright.models.part_masses import set_inertia

TYPES = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "fixed": "fixed"}
TURN, FAR = 2.0 * math.pi, 100.0
"""rad and m: limits beyond are ignored; SDF writes 1e16."""
RESOURCES = ("GZ_SIM_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")


class Pose(NamedTuple):
    """A frame relative to another: position (3,) m and axes (3, 3)."""

    p: Array
    R: Array

    def then(self, other: Pose) -> Pose:
        """Return the pose of `other`, given in this frame, relative to this frame's parent."""
        return Pose(self.p + self.R @ other.p, self.R @ other.R)

    def inverse(self) -> Pose:
        """Return the inverse pose."""
        return Pose(-self.R.T @ self.p, self.R.T)


IDENTITY = Pose(np.zeros(3), np.eye(3))


class SdfJoint(NamedTuple):
    """A joint: its kind, its links, and its pose in the model's frame."""

    name: str
    kind: str
    parent: str
    child: str
    p: Array  # m, at zero
    axis: Array
    span: tuple[float, float] | None


class Sdf(NamedTuple):
    """A robot described in SDF."""

    model: ET.Element  # including its includes
    spec: mujoco.MjSpec
    notes: list[str]
    locked: dict[str, float]  # joints with equal limits -> their position (rad or m)


def read_sdf(path: Path, root: ET.Element) -> Sdf:
    """Return the model of a file.

    Raises InputError if it cannot be read as one robot.
    """
    model = _read_model(path, root, (path.resolve(),))
    builder = _Builder(path, model)
    return Sdf(model, builder.build(), builder.notes, builder.locked)


def _read_model(path: Path, root: ET.Element, above: tuple[Path, ...]) -> ET.Element:
    """Return the model of a file, merged with its nested and included models."""
    if len(above) > MAX_INCLUDES:
        raise InputError(f"{path}: more than {MAX_INCLUDES} nested includes")
    models = root.findall("model")
    if len(models) != 1:
        raise InputError(f"{path}: {len(models)} models; an SDF file with one <model> is required")
    version = read_numbers(root.get("version"), 1, f"{path}: version", [1.9])[0]
    _merge(path, models[0], version < 1.45, above)
    return models[0]


def _merge(path: Path, model: ET.Element, old: bool, above: tuple[Path, ...]) -> None:
    """Add the parts of included and nested models to `model`."""
    for tag in model.iterfind("link//mesh/uri"):  # beside this file, not the one that includes it
        text = (tag.text or "").strip()
        if text and "://" not in text:
            tag.text = f"file://{(path.parent / text).resolve()}"
    for axis in model.iterfind("joint/axis"):
        if old or (axis.findtext("use_parent_model_frame") or "0") in ("1", "true"):
            xyz = axis.find("xyz")
            xyz = ET.SubElement(axis, "xyz") if xyz is None else xyz
            if not xyz.get("expressed_in"):
                xyz.set("expressed_in", "__model__")
    for element in model.findall("*"):
        if element.tag == "include":
            uri = (element.findtext("uri") or "").strip()
            if not uri:
                raise InputError(f"{path}: an <include> without <uri>")
            other = _find_model(path, uri).resolve()
            if other in above:
                raise InputError(f"{path}: includes itself by way of {uri!r}")
            inner = _read_model(other, read_xml(other), (*above, other))
            name = (element.findtext("name") or inner.get("name") or "").strip()
            merged = element.get("merge") in ("1", "true")
        elif element.tag == "model":
            other, inner, name, merged = path, element, element.get("name", ""), False
            _merge(path, inner, old, above)
        else:
            continue
        pose = element.find("pose")
        pose = inner.find("pose") if pose is None else pose
        at = read_pose(pose, f"{path}: pose of {name!r}")
        first = (element.findtext("placement_frame") or inner.get("placement_frame") or "").strip()
        if first:  # the frame of the included model that the pose refers to
            at = at.then(_Builder(other, inner).pose_of(first, ()).inverse())
        frame = ET.Element("frame", name=f"_merged__{name}__model__" if merged else name)
        written = ET.SubElement(frame, "pose", rotation_format="quat_xyzw")
        w, *xyz_turn = (float(x) for x in quat_from_rot(at.R))
        written.text = " ".join(map(repr, [*at.p.tolist(), *xyz_turn, w]))
        if pose is not None and pose.get("relative_to"):
            written.set("relative_to", pose.get("relative_to", ""))
        model.remove(element)
        model.append(frame)
        model.extend(_rename(inner, frame.get("name", ""), "" if merged else f"{name}::"))
        if len(model) > MAX_ELEMENTS:
            raise InputError(f"{path}: more than {MAX_ELEMENTS} elements; a robot has fewer")


def _rename(inner: ET.Element, frame: str, scope: str) -> list[ET.Element]:
    """Return the parts of a model under their names in the surrounding model.

    `frame` is the inner model's own frame there; `scope` is the prefix of its names.
    """

    def full(name: str) -> str:
        name = name.strip()
        return frame if name == "__model__" else name if name in ("", "world") else scope + name

    parts = [child for child in inner if child.tag in ("link", "joint", "frame", "plugin")]
    for part in parts:
        for element in part.iter():
            for key in ("relative_to", "attached_to", "expressed_in"):
                if key in element.attrib:
                    element.set(key, full(element.get(key, "")))
            if element.tag in ("parent", "child", "linkName", "jointName"):
                element.text = full(element.text or "")
        if part.tag != "plugin":
            part.set("name", full(part.get("name", "")))
        if part.tag == "frame" and not part.get("attached_to"):
            part.set("attached_to", frame)
        if part.tag == "link":
            pose = part.find("pose")
            pose = ET.SubElement(part, "pose") if pose is None else pose
            if not pose.get("relative_to"):
                pose.set("relative_to", frame)
    return parts


def _find_model(path: Path, uri: str) -> Path:
    name = uri.removeprefix("model://").removeprefix("file://")
    folders = [path.parent, path.parent.parent]
    for variable in RESOURCES:
        folders += [Path(f) for f in os.environ.get(variable, "").split(os.pathsep) if f]
    for folder in folders:
        for place in (folder / name / "model.sdf", folder / f"{name}.sdf", folder / name):
            if place.is_file():
                return place
    raise InputError(
        f"{path}: included model {uri!r} was not found beside the file or in {', '.join(RESOURCES)}"
    )


def read_pose(element: ET.Element | None, where: str) -> Pose:
    """Return the pose of an element, by default the identity; InputError names `where`."""
    if element is None:
        return IDENTITY
    if element.get("rotation_format") == "quat_xyzw":
        x, y, z, *q = read_numbers(element.text, 7, where, [0.0] * 6 + [1.0])
        quat = np.array([q[3], *q[:3]])
        if np.linalg.norm(quat) < 1e-9:
            raise InputError(f"{where}: the quaternion is zero; valid: x y z w of length 1")
        return Pose(np.array([x, y, z]), rot_from_quat(quat / np.linalg.norm(quat)))
    values = read_numbers(element.text, 6, where, [0.0] * 6)
    scale = math.pi / 180.0 if element.get("degrees") in ("true", "1") else 1.0
    roll, pitch, yaw = (scale * x for x in values[3:])
    return Pose(np.array(values[:3]), rot_z(yaw) @ rot_y(pitch) @ rot_x(roll))


class _Builder:
    """One model in construction."""

    def __init__(self, path: Path, model: ET.Element) -> None:
        self.path, self.model = path, model
        self.frames: dict[str, ET.Element] = {}
        for tag in ("link", "joint", "frame"):
            for element in model.findall(tag):
                name = element.get("name", "")
                if name in self.frames:
                    raise InputError(f"{path}: two elements are named {name!r}")
                self.frames[name] = element
        self.known: dict[str, Pose] = {"__model__": IDENTITY, "": IDENTITY}
        self.notes: list[str] = []
        self.locked: dict[str, float] = {}

    def build(self) -> mujoco.MjSpec:
        """Return the specification with a free root link."""
        path = self.path
        links = {e.get("name", ""): e for e in self.model.findall("link")}
        joints = [j for e in self.model.findall("joint") if (j := self._joint(e)).parent != "world"]
        for joint in joints:
            for end in (joint.parent, joint.child):
                if end not in links:
                    raise InputError(
                        f"{path}: joint {joint.name!r} joins {end!r}, which is no link"
                    )
        above: dict[str, SdfJoint] = {}
        for joint in joints:
            if joint.child in above:
                raise InputError(f"{path}: link {joint.child!r} hangs on two joints: no loops")
            above[joint.child] = joint
        roots = [name for name in links if name not in above]
        if len(roots) != 1:
            what = f"links {', '.join(roots[:5])} hang on no joint" if roots else "a loop of joints"
            raise InputError(f"{path}: {what}; one root link is required")
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        below: dict[str, list[SdfJoint]] = {}
        for joint in joints:
            below.setdefault(joint.parent, []).append(joint)
        todo: list[tuple[str, mujoco.MjsBody, Pose]] = [(roots[0], spec.worldbody, IDENTITY)]
        while todo:
            name, parent, X_MP = todo.pop()
            X_ML = self.pose_of(name, ())
            local = X_MP.inverse().then(X_ML) if name != roots[0] else IDENTITY
            body = parent.add_body(name=name, pos=local.p, quat=quat_from_rot(local.R))
            self._fill(body, name, links[name])
            if name == roots[0]:
                body.add_freejoint(name="free root")
            elif above[name].kind != "fixed":
                self._add_joint(body, above[name], X_ML)
            todo += [(j.child, body, X_ML) for j in below.get(name, [])]
        return spec

    def pose_of(self, name: str, above: tuple[str, ...]) -> Pose:
        """Return a frame of the model in the model's frame."""
        if name in self.known:
            return self.known[name]
        if name not in self.frames or name in above:
            what = "circular" if name in above else "not a frame of the model"
            raise InputError(f"{self.path}: relative_to or attached_to {name!r} is {what}")
        element = self.frames[name]
        pose = element.find("pose")
        base = "" if pose is None else pose.get("relative_to", "")
        if not base and element.tag == "joint":
            base = (element.findtext("child") or "").strip()
        if not base and element.tag == "frame":
            base = element.get("attached_to", "")
        at = self.pose_of(base, (*above, name)).then(
            read_pose(pose, f"{self.path}: pose of {name!r}")
        )
        self.known[name] = at
        return at

    def _joint(self, element: ET.Element) -> SdfJoint:
        name = element.get("name", "")
        kind = TYPES.get(element.get("type", ""))
        if kind is None:
            raise InputError(
                f"{self.path}: joint {name!r} is {element.get('type')!r}; valid: {', '.join(TYPES)}"
            )
        parent, child = ((element.findtext(tag) or "").strip() for tag in ("parent", "child"))
        if parent == "world" or kind == "fixed":
            return SdfJoint(name, kind, parent, child, np.zeros(3), np.zeros(3), None)
        at, axis = self.pose_of(name, ()), element.find("axis")
        if axis is None:
            raise InputError(f"{self.path}: joint {name!r} has no <axis>")
        xyz, where = axis.find("xyz"), f"{self.path}: joint {name!r}"
        way = np.array(
            read_numbers(None if xyz is None else xyz.text, 3, f"{where}: axis", [0.0, 0.0, 1.0])
        )
        if np.linalg.norm(way) < 1e-9:
            raise InputError(f"{where}: the axis has no direction")
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        way = (self.pose_of(frame, ()).R if frame else at.R) @ way
        low, high = (
            read_numbers(axis.findtext(f"limit/{end}"), 1, f"{where}: {end}", [default])[0]
            for end, default in (("lower", -1e16), ("upper", 1e16))
        )
        if element.get("type") == "continuous":
            low, high = -1e16, 1e16
        check_span(low, high, where)
        if low == high:
            self.locked[name] = low
        far = TURN if kind == "hinge" else FAR
        free = low == high or (low < -far and high > far)
        span = None if free else (max(low, -far), min(high, far))
        return SdfJoint(name, kind, parent, child, at.p, way / np.linalg.norm(way), span)

    def _add_joint(self, body: mujoco.MjsBody, joint: SdfJoint, X_ML: Pose) -> None:
        kind = mujoco.mjtJoint.mjJNT_SLIDE if joint.kind == "slide" else mujoco.mjtJoint.mjJNT_HINGE
        made = body.add_joint(
            name=joint.name,
            type=kind,
            axis=X_ML.R.T @ joint.axis,
            pos=X_ML.R.T @ (joint.p - X_ML.p),
        )
        if joint.span is not None:
            made.limited, made.range = mujoco.mjtLimited.mjLIMITED_TRUE, joint.span

    def _fill(self, body: mujoco.MjsBody, name: str, link: ET.Element) -> None:
        inertial, where = link.find("./inertial"), f"{self.path}: link {name!r}"
        if inertial is None:
            self.notes.append(f"link {name} has no <inertial>: 1 kg and 1 kg m^2, as SDF says")
            body.mass, body.ipos = 1.0, np.zeros(3)
            set_inertia(body, np.eye(3))
            return
        body.mass = read_numbers(inertial.findtext("mass"), 1, f"{where}: mass", [1.0])[0]
        terms = {}
        for term, default in (
            ("xx", 1.0),
            ("yy", 1.0),
            ("zz", 1.0),
            ("xy", 0),
            ("xz", 0),
            ("yz", 0),
        ):
            text = inertial.findtext(f"inertia/i{term}")
            terms[term] = read_numbers(text, 1, f"{where}: i{term}", [default])[0]
        tensor = np.array([[terms["".join(sorted(a + b))] for b in "xyz"] for a in "xyz"])
        at = read_pose(inertial.find("pose"), f"{where}: pose of <inertial>")
        body.ipos = at.p
        set_inertia(body, at.R @ tensor @ at.R.T)
