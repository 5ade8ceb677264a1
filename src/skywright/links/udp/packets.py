"""The packets of the gateway: their only definition.

The encoder, the C header, the MATLAB table and the table in the documentation are generated from
the tables in this file. Numbers are little-endian. A packet is a header, the body of its kind, and
a tag of 16 bytes: HMAC-SHA256 of header and body, truncated (RFC 2104, section 5), or zeros without
a key. Suarez 2020, section III-C, names these streams and their rates, not their layout.
"""

from __future__ import annotations

import math
from typing import NamedTuple

VERSION = 1
MAGIC = b"SKYW"
TAG = 16  # bytes
MAX_JOINTS = 16
"""Number of joints in a packet; unused ones are 0."""
NAME = 24  # bytes of a text, padded with zeros

TYPES = {
    "u8": ("B", 1), "u16": ("H", 2), "u32": ("I", 4), "u64": ("Q", 8),
    "f32": ("f", 4), "f64": ("d", 8), "char": ("s", 1),
}  # fmt: skip
"""Type -> its letter in Python's `struct`, bytes."""


class Field(NamedTuple):
    """A number, or an array of numbers, in a packet."""

    name: str
    type: str  # a key of TYPES
    unit: str
    meaning: str
    length: int = 1  # numbers in it
    limit: float = math.inf  # largest absolute value; NaN and infinity are always invalid


class Kind(NamedTuple):
    """A kind of packet."""

    number: int
    name: str
    to_arms: bool  # from the operator to the arms program, otherwise in the opposite direction
    rate: str
    old_s: float  # s, age above which the receiver drops it
    meaning: str
    fields: tuple[Field, ...]


HEADER = (
    Field("magic", "char", "", "the letters SKYW", 4),
    Field("version", "u8", "", "of this table"),
    Field("kind", "u8", "", "number of the kind"),
    Field("size", "u16", "bytes", "of the whole packet, tag included"),
    Field("session", "u32", "", "number that the arms program gave; 0 in `connect`"),
    Field("sequence", "u32", "", "grows with every packet of a sender"),
    Field("time_us", "u64", "us", "clock of the sender; it never goes back"),
)

ANGLES = 12.5  # rad, two turns: larger than any joint range

KINDS = (
    Kind(1, "operation", True, "until acknowledged, at 5 Hz", 1.0, "requests a task", (
        Field("operation", "u32", "", "number of the request; grows, equal in repetitions"),
        Field("code", "u16", "", "requested task"),
        Field("reserved", "u16", "", "0"),
    )),
    Kind(2, "stick", True, "20 to 100 Hz", 0.25, "velocity reference of an input device", (
        Field("axes", "f32", "", "ahead, left, up, then about these axes; -1 to 1", 6, 1.0),
        Field("buttons", "u32", "", "bit 0: the work is done"),
    )),
    Kind(3, "joints", True, "50 Hz", 0.25, "joint references from outside", (
        Field("n", "u32", "", "number of joints", 1, MAX_JOINTS),
        Field("q_ref", "f32", "rad", "joint references", MAX_JOINTS, ANGLES),
    )),
    Kind(4, "state", False, "50 Hz", 1.0, "estimated and measured state of the arms", (
        Field("t", "f64", "s", "mission time"),
        Field("task", "u16", "", "code of the task that runs"),
        Field("n_hands", "u16", "", "number of hands", 1, 2),
        Field("n", "u32", "", "number of joints", 1, MAX_JOINTS),
        Field("q", "f32", "rad", "joint angles", MAX_JOINTS),
        Field("qd", "f32", "rad/s", "joint speeds", MAX_JOINTS),
        Field("q_ref", "f32", "rad", "joint references", MAX_JOINTS),
        Field("tau", "f32", "N m", "torques of the joints' springs", MAX_JOINTS),
        Field("p_hand", "f32", "m", "left hand, right hand in W", 6),
        Field("v_hand", "f32", "m/s", "their velocities in W", 6),
        Field("p_hand_ref", "f32", "m", "their references in W", 6),
        Field("f_hand", "f32", "N", "forces that they exert, in W", 6),
        Field("p_WB", "f32", "m", "estimated position of the platform", 3),
        Field("q_WB", "f32", "", "estimated attitude, quaternion wxyz", 4),
        Field("input_age", "f32", "s", "age of the newest stick or joint references; -1 without"),
        Field("operation", "u32", "", "number of the newest request that was accepted"),
        Field("phase", "char", "", "name of the mission's phase, ASCII", NAME),
    )),
    Kind(5, "deflection", False, "200 Hz", 1.0, "the board of the deflection encoders", (
        Field("t", "f64", "s", "mission time of the sample"),
        Field("n", "u32", "", "number of joints", 1, MAX_JOINTS),
        Field("measured", "u32", "", "bit j: joint j has an encoder"),
        Field("deflection", "f32", "rad", "shaft minus output link, 0 without encoder", MAX_JOINTS),
    )),
    Kind(6, "acknowledgement", False, "one for each operation", 2.0, "answers an operation", (
        Field("operation", "u32", "", "number of the request"),
        Field("code", "u16", "", "requested task"),
        Field("result", "u16", "", "result of the request"),
        Field("opened", "u32", "", "in the answer to `connect`: the session's number"),
        Field("reserved", "u32", "", "0"),
        Field("echo_us", "u64", "us", "`time_us` of the operation"),
    )),
)  # fmt: skip

CODES = {
    "connect": (1, "opens a session; its number is in the acknowledgement"),
    "disconnect": (2, "ends the session"),
    "hold": (3, "keeps the arms where they are"),
    "rest": (4, "rest position"),
    "operate": (5, "operation position"),
    "stick": (6, "joystick teleoperation of the hands"),
    "joints": (7, "external joint references"),
    "land": (8, "ends the work: the robot flies home and lands"),
    "torque_on": (9, "servos on"),
    "torque_off": (10, "servos off"),
    "grasp": (11, "grasping"),
    "force": (12, "force control"),
    "visual": (13, "visual servoing"),
    "alive": (14, "keeps the session open, which ends after 10 s without a message"),
}
"""Operation -> code and description: the tasks of Suarez 2020, section III-C, and a session."""

RESULTS = {
    "accepted": (0, "is done now"),
    "unavailable": (1, "this flight or phase does not offer it"),
    "not in control": (2, "another sender is in control"),
    "full": (3, "too many sessions"),
}
"""Result -> number and meaning."""


def find_kind(name: str) -> Kind:
    """Return the kind with this name."""
    return next(kind for kind in KINDS if kind.name == name)


def get_size(kind: Kind) -> int:
    """Return the bytes of a complete packet."""
    return sum(TYPES[f.type][1] * f.length for f in (*HEADER, *kind.fields)) + TAG


MAX_SIZE = max(get_size(kind) for kind in KINDS)
