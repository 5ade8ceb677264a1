"""Frames of an SDF model: their poses, and the links to which they are attached.

The pose semantics are those of SDF 1.7 and later (http://sdformat.org, "Pose frame semantics").
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_from_quat, rot_x, rot_y, rot_z
from skywright.errors import InputError
from skywright.models.importing.xml_input import read_numbers

MODEL = ("", "__model__")
"""Names of the model's own frame."""


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


def find_canonical(model: ET.Element) -> str:
    """Return the link to which the model's own frame is attached; "" if there is no link."""
    first = model.find("./link")
    name = "" if first is None else first.get("name", "")
    return (model.get("canonical_link") or name).strip()


class Frames:
    """Links, joints and frames of a model whose includes are merged."""

    def __init__(self, path: Path, model: ET.Element) -> None:
        self.path, self.model = path, model
        self.elements: dict[str, ET.Element] = {}
        for tag in ("link", "joint", "frame"):
            for element in model.findall(tag):
                name = element.get("name", "")
                if name in self.elements:
                    raise InputError(f"{path}: two elements are named {name!r}")
                self.elements[name] = element
        self.known: dict[str, Pose] = dict.fromkeys(MODEL, IDENTITY)

    def pose_of(self, name: str) -> Pose:
        """Return a frame of the model in the model's frame.

        Raises InputError if the frame is unknown, or if the chain of its references is circular.
        """
        chain: dict[str, ET.Element | None] = {}  # a loop: chains of thousands of frames exist
        while name not in self.known:
            if name not in self.elements or name in chain:
                what = "circular" if name in chain else "not a frame of the model"
                raise InputError(f"{self.path}: relative_to or attached_to {name!r} is {what}")
            element = self.elements[name]
            pose = chain[name] = element.find("pose")
            base = "" if pose is None else pose.get("relative_to", "")
            if not base and element.tag == "joint":
                base = (element.findtext("child") or "").strip()
            if not base and element.tag == "frame":
                base = element.get("attached_to", "")
            name = base
        at = self.known[name]
        for name, pose in reversed(chain.items()):
            at = at.then(read_pose(pose, f"{self.path}: pose of {name!r}"))
            self.known[name] = at
        return at

    def place_in(self, link: str, pose: ET.Element | None, where: str) -> Pose:
        """Return the pose of a part of a link in the link's frame; InputError names `where`."""
        at, base = read_pose(pose, where), "" if pose is None else pose.get("relative_to", "")
        return self.pose_of(link).inverse().then(self.pose_of(base)).then(at) if base else at

    def link_of(self, name: str) -> str | None:
        """Return the link to which a frame is attached, or "world"; None if the frame is unknown.

        Raises InputError if the chain of its references is circular.
        """
        seen: set[str] = set()
        while name != "world":
            if name in seen:
                raise InputError(f"{self.path}: attached_to {name!r} is circular")
            seen.add(name)
            if name in MODEL:
                name = find_canonical(self.model)
            element = self.elements.get(name)
            if element is None or element.tag == "link":
                return None if element is None else name
            child = element.tag == "joint"
            name = (element.findtext("child") if child else element.get("attached_to")) or ""
            name = name.strip()
        return name
