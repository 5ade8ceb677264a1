"""Poses of a robot's links for ROS: transforms between the frames of its URDF.

The tree is read from the URDF itself, so that frames and links agree. Moving links are published on
the topic /tf, all others once on /tf_static.
"""

import xml.etree.ElementTree as ET
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.core.rotations import quat_from_rot, rot_x, rot_y, rot_z
from skywright.models.drawing import multiply_quaternions, rotate_vectors
from skywright.recordings.columns import Column, Stream, Topic, build_dtype, has_columns

MAP = "map"
POINTS = {"contact": "p_WT", "left_contact": "left_p_WH", "right_contact": "right_p_WH"}
"""Frames with the axes of `map` at points of contact force -> the column of the point."""
_ONE = np.array([1.0, 0.0, 0.0, 0.0])


class Frame(NamedTuple):
    """A link in the frame of its parent: pose at joint zero, and motion of the joint.

    After a rotation by an angle, its quaternion is cos(angle / 2) `quaternion` + sin(angle / 2)
    `change`.
    """

    parent: str
    name: str
    position: Array  # (3,) m
    quaternion: Array  # (4,) wxyz, at joint zero
    change: Array  # slide, spring: (3,) direction of travel; rotation: (4,), see above
    motion: str  # "free", "fixed", "turn", "slide" by a joint, "spring" by the probe's spring
    joint: int  # index in q


def list_frames(urdf: str, joints: list[str]) -> list[Frame]:
    """Return the links of a URDF, root first; `joints` names the entries of q."""
    tree = ET.fromstring(urdf)
    elements = tree.findall("joint")
    children = {_get(e, "child", "link") for e in elements}
    root = next(e.attrib["name"] for e in tree.findall("link") if e.attrib["name"] not in children)
    zero = np.zeros(3)
    return [Frame(MAP, root, zero, _ONE, zero, "free", -1), *(_read(e, joints) for e in elements)]


def _get(element: ET.Element, child: str, key: str) -> str:
    found = element.find(child)
    assert found is not None
    return found.attrib[key]


def _read(element: ET.Element, joints: list[str]) -> Frame:
    kind, name = element.attrib["type"], _get(element, "child", "link")
    x, y, z = (float(v) for v in _get(element, "origin", "rpy").split())
    axis, motion, joint = np.array([-1.0, 0.0, 0.0]), "fixed", -1
    if kind != "fixed":
        axis = np.array([float(v) for v in _get(element, "axis", "xyz").split()])
        motion = "slide" if kind == "prismatic" else "turn"
        joint = joints.index(element.attrib["name"])
    elif name == "slider":  # rigid in the nominal model; a recording contains its compression
        motion = "spring"
    place = np.array([float(v) for v in _get(element, "origin", "xyz").split()])
    turn = quat_from_rot(rot_z(z) @ rot_y(y) @ rot_x(x))
    if motion == "turn":
        change = multiply_quaternions(turn[None], np.array([[0.0, *axis]]))[0]
    else:
        change = rotate_vectors(turn[None], axis[None])[0]
    return Frame(_get(element, "parent", "link"), name, place, turn, change, motion, joint)


class LinkFrames:
    """Transforms of a robot, computed from these columns of samples."""

    def __init__(self, urdf: str, joints: list[str], columns: tuple[Column, ...]) -> None:
        frames = list_frames(urdf, joints)
        names = {c.name for c in columns}
        self.moving = [f for f in frames if f.motion != "fixed"]
        self.fixed = [f for f in frames if f.motion == "fixed"]
        self.points = [(frame, c) for frame, c in POINTS.items() if c in names]
        pairs = [(f.parent, f.name) for f in self.moving] + [(MAP, f) for f, _ in self.points]
        fields, parts = {}, [Column("t", unit="s")]
        for i, (_, name) in enumerate(pairs):
            for what, letter, n in (("translation", "p", 3), ("rotation", "q", 4)):
                fields[f"transforms[{i}].transform.{what}"] = f"{letter} {name}"
                parts.append(Column(f"{letter} {name}", (n,), unit="m" if n == 3 else ""))
        self.stream = Stream(_build_topic("/tf", pairs)._replace(fields=fields), tuple(parts))
        self.static = _build_topic("/tf_static", [(f.parent, f.name) for f in self.fixed])

    def list_static(self) -> dict[str, float]:
        """Return the numbers of the message `static` by their paths."""
        return {
            f"transforms[{i}].transform.{what}.{letter}": float(value)
            for i, frame in enumerate(self.fixed)
            for what, values in (
                ("translation", zip("xyz", frame.position, strict=True)),
                ("rotation", zip("wxyz", frame.quaternion, strict=True)),
            )
            for letter, value in values
        }

    def compute(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Return the rows of `stream` for these samples (n,)."""
        rows = np.zeros(len(samples), build_dtype(self.stream.columns))
        rows["t"] = samples["t"]
        q = samples["q"] if has_columns(samples, "q") else np.zeros((len(samples), 0))
        with np.errstate(invalid="ignore"):  # a diverged flight ends with NaN or infinity
            cosine, sine = np.cos(0.5 * q), np.sin(0.5 * q)
        for frame in self.moving:
            place, turn = frame.position, frame.quaternion
            if frame.motion == "free":
                place, turn = samples["p_WB"], samples["q_WB"]
            elif frame.motion == "turn":
                j = frame.joint
                turn = cosine[:, j, None] * turn + sine[:, j, None] * frame.change
            elif frame.motion == "slide" or has_columns(samples, "spring"):
                way = q[:, frame.joint] if frame.motion == "slide" else samples["spring"]
                place = place + way[:, None] * frame.change
            rows[f"p {frame.name}"], rows[f"q {frame.name}"] = place, turn
        for name, column in self.points:
            rows[f"p {name}"], rows[f"q {name}"] = samples[column], _ONE
        return rows


def _build_topic(name: str, pairs: list[tuple[str, str]]) -> Topic:
    """Build a message of transforms from parents to children."""
    texts = {}
    for i, (parent, child) in enumerate(pairs):
        texts[f"transforms[{i}].header.frame_id"] = parent
        texts[f"transforms[{i}].child_frame_id"] = child
    return Topic(name, "tf2_msgs/TFMessage", "", {}, texts, {"transforms": len(pairs)})
