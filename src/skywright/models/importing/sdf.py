"""SDF models: links, joints and their frames as a MuJoCo specification.

Frames follow the pose semantics of SDF 1.7 and later (`relative_to`, `expressed_in`), which earlier
files without these attributes satisfy too, except for the axes of joints: up to 1.4, and with
`use_parent_model_frame`, these are in the model's frame (http://sdformat.org, "Pose frame
semantics").
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Container, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import quat_from_rot
from skywright.errors import InputError
from skywright.models.importing.sdf_files import read_model
from skywright.models.importing.sdf_frames import IDENTITY, Frames, Pose
from skywright.models.importing.sdf_inertia import read_inertia
from skywright.models.importing.xml_input import check_span, read_numbers
from skywright.models.part_masses import set_inertia

TYPES = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "fixed": "fixed"}
TURN, FAR = 2.0 * math.pi, 100.0
"""rad and m: limits beyond are ignored; SDF writes 1e16, or inf."""
DEGREES = 1e3
"""rad: limits between a turn and this number may be in degrees."""


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

    model: ET.Element  # including its includes; computed masses are written into it
    spec: mujoco.MjSpec
    notes: list[str]
    locked: dict[str, float]  # joints with equal limits -> their position (rad or m)
    assumed: Mapping[str, frozenset[str]]  # link -> of "mass" and "inertia": SDF's defaults


def read_sdf(path: Path, root: ET.Element) -> Sdf:
    """Return the model of a file.

    Raises InputError if it cannot be read as one robot.
    """
    model = read_model(path, root, (path.resolve(),))
    builder = _Builder(path, model)
    return Sdf(model, builder.build(), builder.notes, builder.locked, builder.assumed)


def read_limit(text: str | None, what: str, default: float) -> float:
    """Return a limit, which may be inf or -inf; InputError names `what`."""
    if (text or "").strip().lower() in ("inf", "+inf", "infinity", "+infinity"):
        return math.inf
    if (text or "").strip().lower() in ("-inf", "-infinity"):
        return -math.inf
    return read_numbers(text, 1, what, [default])[0]


class _Builder:
    """One model in construction."""

    def __init__(self, path: Path, model: ET.Element) -> None:
        self.path, self.model, self.frames = path, model, Frames(path, model)
        self.notes: list[str] = []
        self.locked: dict[str, float] = {}
        self.assumed: dict[str, frozenset[str]] = {}

    def build(self) -> mujoco.MjSpec:
        """Return the specification with a free root link."""
        path = self.path
        links = {e.get("name", ""): e for e in self.model.findall("link")}
        joints = self._read_joints()
        above: dict[str, SdfJoint] = {}
        for joint in joints:
            if joint.child in above:
                raise InputError(
                    f"{path}: link {joint.child!r} is the child of two joints; valid: a tree of "
                    "links without loops"
                )
            above[joint.child] = joint
        roots = [name for name in links if name not in above]
        if len(roots) != 1:
            alone = f"links {', '.join(roots[:5])} are the child of no joint"
            what = alone if roots else "a loop of joints"
            raise InputError(f"{path}: {what}; one root link is required")
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        below: dict[str, list[SdfJoint]] = {}
        for joint in joints:
            below.setdefault(joint.parent, []).append(joint)
        todo: list[tuple[str, mujoco.MjsBody, Pose]] = [(roots[0], spec.worldbody, IDENTITY)]
        while todo:
            name, parent, X_MP = todo.pop()
            X_ML = self.frames.pose_of(name)
            local = X_MP.inverse().then(X_ML) if name != roots[0] else IDENTITY
            body = parent.add_body(name=name, pos=local.p, quat=quat_from_rot(local.R))
            self._fill(body, name, links[name])
            if name == roots[0]:
                body.add_freejoint()  # without a name, which a joint of the file may have
            elif above[name].kind != "fixed":
                self._add_joint(body, above[name], X_ML)
            todo += [(j.child, body, X_ML) for j in below.get(name, [])]
        movable = {joint.name for joint in joints if joint.kind != "fixed"}
        for element in self.model.findall("joint"):
            if element.get("name") in movable:
                self._couple(spec, element, movable)
        return spec

    def _read_joints(self) -> list[SdfJoint]:
        """Return the joints between links, and note what holds the model in the world."""
        if (self.model.findtext("static") or "").strip().lower() in ("1", "true"):
            self.notes.append("left out: <static> of the model, which does not move in the file")
        out = []
        for element in self.model.findall("joint"):
            joint = self._joint(element)
            if joint.parent != "world":
                out.append(joint)
            else:
                self.notes.append(
                    f"left out: joint {joint.name!r} between the world and link {joint.child!r}"
                )
        return out

    def _couple(self, spec: mujoco.MjSpec, element: ET.Element, movable: Container[str]) -> None:
        """Add the coupling of a joint to the one that it mimics (SDF 1.11), as an equality."""
        name, mimic = element.get("name", ""), element.find("axis/mimic")
        if mimic is None:
            return
        where, leader = f"{self.path}: joint {name!r}: <mimic>", mimic.get("joint", "")
        if leader not in movable or leader == name:
            raise InputError(f"{where} joint={leader!r}; valid: another movable joint of the model")
        ratio, offset, reference = (
            read_numbers(mimic.findtext(tag), 1, f"{where}: {tag}", [default])[0]
            for tag, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
        )
        made = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=name, name2=leader)
        made.objtype = mujoco.mjtObj.mjOBJ_JOINT
        made.data[:2] = offset - ratio * reference, ratio

    def _joint(self, element: ET.Element) -> SdfJoint:
        name = element.get("name", "")
        kind, where = TYPES.get(element.get("type", "")), f"{self.path}: joint {name!r}"
        if kind is None:
            raise InputError(f"{where} is {element.get('type')!r}; valid: {', '.join(TYPES)}")
        parent, child = (self._find_end(element, tag, where) for tag in ("parent", "child"))
        if parent == child:
            raise InputError(f"{where} joins link {child!r} to itself; valid: two links")
        if parent == "world" or kind == "fixed":
            return SdfJoint(name, kind, parent, child, np.zeros(3), np.zeros(3), None)
        at, axis = self.frames.pose_of(name), element.find("axis")
        if axis is None:
            raise InputError(f"{where} has no <axis>")
        xyz = axis.find("xyz")
        way = np.array(
            read_numbers(None if xyz is None else xyz.text, 3, f"{where}: axis", [0.0, 0.0, 1.0])
        )
        if np.linalg.norm(way) < 1e-9:
            raise InputError(f"{where}: the axis has no direction")
        frame = "" if xyz is None else xyz.get("expressed_in", "")
        way = (self.frames.pose_of(frame).R if frame else at.R) @ way
        low, high = (
            read_limit(axis.findtext(f"limit/{end}"), f"{where}: {end}", default)
            for end, default in (("lower", -math.inf), ("upper", math.inf))
        )
        if element.get("type") == "continuous":
            low, high = -math.inf, math.inf
        check_span(low, high, where)
        if low == high:
            if math.isinf(low):
                raise InputError(
                    f"{where}: both limits are {low:g}; valid: -inf and inf, or a span"
                )
            self.locked[name] = low
        far = TURN if kind == "hinge" else FAR
        free = low == high or (low < -far and high > far)
        if kind == "hinge" and far < max(-low, high) < DEGREES:
            self.notes.append(
                f"joint {name} has limits of {low:g} and {high:g} rad, beyond a turn: are they in "
                "degrees?"
            )
        span = None if free else (max(low, -far), min(high, far))
        return SdfJoint(name, kind, parent, child, at.p, way / np.linalg.norm(way), span)

    def _find_end(self, element: ET.Element, tag: str, where: str) -> str:
        """Return the link of a joint's parent or child, which may be a frame."""
        name = (element.findtext(tag) or "").strip()
        link = self.frames.link_of(name) if name else None
        if link is None or (link == "world" and tag == "child"):
            raise InputError(f"{where} joins {name!r}, which is no link and no frame of a link")
        return link

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
        place = partial(self.frames.place_in, name)
        found = read_inertia(link, f"{self.path}: link {name!r}", place)
        body.mass, body.ipos = found.mass, found.com
        set_inertia(body, found.inertia)
        if found.note:
            self.notes.append(found.note)
        if found.assumed:
            self.assumed[name] = found.assumed
        inertial = link.find("./inertial")
        if inertial is not None and inertial.get("auto") in ("1", "true"):
            mass = inertial.find("mass")  # which the check of the masses adds up
            mass = ET.SubElement(inertial, "mass") if mass is None else mass
            mass.text = repr(float(found.mass))
