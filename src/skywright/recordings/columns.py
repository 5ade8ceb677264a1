"""What a recording holds: columns of the samples, topics that carry them, streams beside them.

Whoever records declares them as data; a recording stores them beside what it holds, so that a
reader needs no table of ours. `samples` is a structured array (n,) with one field a column.

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
    """A column of the samples: one number, or `shape` numbers, a sample.

    A quaternion (a column behind a `geometry_msgs/Quaternion`) is wxyz here and xyzw in the file.
    """

    name: str
    shape: tuple[int, ...] = ()
    dtype: str = "<f8"
    unit: str = ""
    meaning: str = ""


class Topic(NamedTuple):
    """A topic: its ROS 2 type, the frame of its header, and the column behind each path.

    A path such as `pose.position` stands for all numbers below it. `texts` fixes strings by their
    path (`name[0]`), `numbers` numbers, `lengths` those of sequences, `types` defines each message
    type (`pkg/Type`) that is neither standard nor defined by another topic.
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
    """Rows at a rate of their own on a topic of their own, such as raw data of a sensor.

    One column is `t`: the time (s) of the row.
    """

    topic: Topic
    columns: tuple[Column, ...]


def build_dtype(columns: Iterable[Column]) -> np.dtype[Any]:
    """Return the type of one sample, columns in the order given."""
    return np.dtype([(c.name, c.dtype, c.shape) for c in columns])


def has_columns(samples: Any, *names: str) -> bool:
    """Whether samples have all these columns: a robot without a part has none of its columns."""
    return set(names) <= set(samples.dtype.names or ())


def check_columns(columns: Sequence[Column], topics: Sequence[Topic]) -> None:
    """Assert that columns and topics fit together: each column on one topic, none unknown."""
    names = [c.name for c in columns]
    bound = [field for topic in topics for field in topic.fields.values()]
    for what, found in (("column", names), ("field", bound), ("topic", [t.name for t in topics])):
        twice = sorted({n for n in found if found.count(n) > 1})
        assert not twice, f"{what} {twice[0]!r} occurs twice"
    empty = {c.name for c in columns if 0 in c.shape}
    assert set(bound) == set(names) - empty, sorted(set(bound) ^ (set(names) - empty))


def choose_topics(columns: Sequence[Column], known: Iterable[Topic]) -> tuple[Topic, ...]:
    """Return topics that carry all columns: those known of which every column is there.

    A column that none of them carries, such as that of a sensor from a file, gets the topic
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


# Topics of standard types. `stamp` and `frame_id` of headers are filled by the recording.


def pose(name: str, frame: str, p: str, q: str) -> Topic:
    """Position (3,) m and quaternion (4,) of something in `frame`."""
    fields = {"pose.position": p, "pose.orientation": q}
    return Topic(name, "geometry_msgs/PoseStamped", frame, fields)


def twist(name: str, frame: str, v: str, w: str) -> Topic:
    """Velocity (3,) m/s and angular velocity (3,) rad/s."""
    fields = {"twist.linear": v, "twist.angular": w}
    return Topic(name, "geometry_msgs/TwistStamped", frame, fields)


def vector(name: str, frame: str, column: str) -> Topic:
    """A vector (3,) with the axes of `frame`."""
    return Topic(name, "geometry_msgs/Vector3Stamped", frame, {"vector": column})


def point(name: str, frame: str, column: str) -> Topic:
    """A place (3,) m in `frame`."""
    return Topic(name, "geometry_msgs/PointStamped", frame, {"point": column})


def wrench(name: str, frame: str, force: str, torque: str = "") -> Topic:
    """A force (3,) N, and a torque (3,) N m unless there is none."""
    fields = {"wrench.force": force} | ({"wrench.torque": torque} if torque else {})
    return Topic(name, "geometry_msgs/WrenchStamped", frame, fields)


def joint_state(name: str, joints: Sequence[str], **fields: str) -> Topic:
    """Columns (n joints,) on `position`, `velocity` or `effort` of a JointState."""
    lengths = dict.fromkeys(("name", *fields), len(joints))
    texts = {f"name[{i}]": joint for i, joint in enumerate(joints)}
    return Topic(name, "sensor_msgs/JointState", "", fields, texts, lengths)
