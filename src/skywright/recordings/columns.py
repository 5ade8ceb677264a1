"""Contents of a recording: columns of the samples, topics that carry the columns, and streams.

The program that records declares them as data. The recording stores the declarations, so that a
reader needs no table of Skywright. `samples` is a structured array (n,) with one field per column.

    columns = (Column("gap", unit="m", meaning="tip to surface; negative is penetration"),)
    topics = (Topic("/contact/state", "skywright_msgs/ContactState", "tip", {"gap": "gap"},
                    types={"skywright_msgs/ContactState": "std_msgs/Header header\\nfloat64 gap"}),)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

_NONE: Mapping[str, Any] = MappingProxyType({})


class Column(NamedTuple):
    """A column of the samples: one number, or an array of `shape`, per sample.

    A quaternion (a column of a `geometry_msgs/Quaternion`) is wxyz here and xyzw in the file.
    """

    name: str
    shape: tuple[int, ...] = ()
    dtype: str = "<f8"
    unit: str = ""
    meaning: str = ""


class Topic(NamedTuple):
    """A topic: its ROS 2 type, the frame of its header, and the column of each path.

    A path such as `pose.position` stands for all numbers below it. `texts` maps the path of a
    string (`name[0]`) to its fixed text, `numbers` the path of a number to its fixed value, and
    `lengths` the path of a sequence to its length. `types` maps each message type (`pkg/Type`)
    that is not standard to its definition.
    """

    name: str
    kind: str
    frame: str
    fields: Mapping[str, str]
    texts: Mapping[str, str] = _NONE
    lengths: Mapping[str, int] = _NONE
    types: Mapping[str, str] = _NONE
    numbers: Mapping[str, float] = _NONE


class Stream(NamedTuple):
    """Rows with their own rate and topic, such as raw data of a sensor.

    One column is `t`, the time (s) of the row.
    """

    topic: Topic
    columns: tuple[Column, ...]


def build_dtype(columns: Iterable[Column]) -> np.dtype[Any]:
    """Return the dtype of one sample, with the columns in the given order."""
    return np.dtype([(c.name, c.dtype, c.shape) for c in columns])


def has_columns(samples: Any, *names: str) -> bool:
    """Whether `samples` has all these columns; a part that the robot lacks has no columns."""
    return set(names) <= set(samples.dtype.names or ())


def check_columns(columns: Sequence[Column], topics: Sequence[Topic]) -> None:
    """Assert that names are unique, and that topics carry each non-empty column and no other."""
    names = [c.name for c in columns]
    bound = [field for topic in topics for field in topic.fields.values()]
    for what, found in (("column", names), ("field", bound), ("topic", [t.name for t in topics])):
        twice = sorted({n for n in found if found.count(n) > 1})
        assert not twice, f"{what} {twice[0]!r} occurs twice"
    empty = {c.name for c in columns if 0 in c.shape}
    assert set(bound) == set(names) - empty, sorted(set(bound) ^ (set(names) - empty))


def choose_topics(columns: Sequence[Column], known: Iterable[Topic]) -> tuple[Topic, ...]:
    """Return topics that carry all columns: each known topic whose columns all exist.

    A column that none of them carries, such as that of a user's sensor, gets the topic
    `/recorded/NAME`.
    """
    names = {c.name for c in columns}
    topics = [t for t in known if names.issuperset(t.fields.values())]
    rest = names.difference(*(t.fields.values() for t in topics))
    topics += [_build_own_topic(c) for c in columns if c.name in rest and 0 not in c.shape]
    return tuple(topics)


def _build_own_topic(column: Column) -> Topic:
    whole = column.dtype == "<i8"
    kind, number = ("Integers", "int64") if whole else ("Numbers", "float64")
    path = "data" if column.shape else "data[0]"
    return Topic(
        f"/recorded/{column.name}", f"skywright_msgs/{kind}", "", {path: column.name},
        lengths={"data": column.shape[0] if column.shape else 1},
        types={f"skywright_msgs/{kind}": f"std_msgs/Header header\n{number}[] data"},
    )  # fmt: skip


# Topics of standard types. The recording fills `stamp` and `frame_id` of headers.


def pose(name: str, frame: str, p: str, q: str) -> Topic:
    """Return a topic for a position (3,) m and a quaternion (4,) in `frame`."""
    fields = {"pose.position": p, "pose.orientation": q}
    return Topic(name, "geometry_msgs/PoseStamped", frame, fields)


def twist(name: str, frame: str, v: str, w: str) -> Topic:
    """Return a topic for a velocity (3,) m/s and an angular velocity (3,) rad/s."""
    fields = {"twist.linear": v, "twist.angular": w}
    return Topic(name, "geometry_msgs/TwistStamped", frame, fields)


def vector(name: str, frame: str, column: str) -> Topic:
    """Return a topic for a vector (3,) in the axes of `frame`."""
    return Topic(name, "geometry_msgs/Vector3Stamped", frame, {"vector": column})


def point(name: str, frame: str, column: str) -> Topic:
    """Return a topic for a point (3,) m in `frame`."""
    return Topic(name, "geometry_msgs/PointStamped", frame, {"point": column})


def wrench(name: str, frame: str, force: str, torque: str = "") -> Topic:
    """Return a topic for a force (3,) N and, if given, a torque (3,) N m."""
    fields = {"wrench.force": force} | ({"wrench.torque": torque} if torque else {})
    return Topic(name, "geometry_msgs/WrenchStamped", frame, fields)


def joint_state(name: str, joints: Sequence[str], **fields: str) -> Topic:
    """Return a JointState topic with columns (n joints,) for position, velocity or effort."""
    lengths = dict.fromkeys(("name", *fields), len(joints))
    texts = {f"name[{i}]": joint for i, joint in enumerate(joints)}
    return Topic(name, "sensor_msgs/JointState", "", fields, texts, lengths)
