"""Trajectories in MCAP recordings: topics of ROS 2 messages with a position or a pose.

The messages are in CDR: header (stamp, frame), then the numbers at fixed offsets.
"""

import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.errors import InputError, neighbours
from skywright.models.localisation.trajectory import Trajectory, clean
from skywright.recordings.mcap_file import CUT, McapContents, read_mcap

# Number of strings after the header's, and whether an orientation follows the position.
KINDS = {
    "geometry_msgs/PointStamped": (0, False),
    "geometry_msgs/PoseStamped": (0, True),
    "geometry_msgs/PoseWithCovarianceStamped": (0, True),
    "geometry_msgs/TransformStamped": (1, True),
    "nav_msgs/Odometry": (1, True),
}
ROLES = (("estimate", "/estimate/pose"), ("reference", "/truth/pose"))
"""Topics of Skywright's own recordings: the evaluated trajectory and its reference."""


class TopicInfo(NamedTuple):
    """A topic that contains a trajectory."""

    name: str
    kind: str
    messages: int


def list_topics(contents: McapContents) -> list[TopicInfo]:
    """Return the topics of a recording that can be read as trajectories, sorted by name."""
    found = []
    for topic, (schema, encoding) in sorted(contents.kinds.items()):
        kind = schema.replace("/msg/", "/")
        if kind in KINDS and encoding == "cdr":
            found.append(TopicInfo(topic, kind, len(contents.messages.get(topic, []))))
    return found


def load_topic(path: Path, topic: str | None) -> Trajectory:
    """Load a topic, or the only one. Raises InputError with the valid topics."""
    return _decode(path, *_choose(path, topic))


def _choose(path: Path, topic: str | None) -> tuple[McapContents, TopicInfo]:
    contents = read_mcap(path)
    topics = list_topics(contents)
    names = [t.name for t in topics]
    if not topics:
        shown = ", ".join(
            f"{t} ({k or 'no schema'}, {e or 'no encoding'})"
            for t, (k, e) in sorted(contents.kinds.items())[:5]
        )
        raise InputError(
            f"{path}: contains no trajectory; its topics: {shown or 'none'}; valid: CDR "
            f"messages of {', '.join(KINDS)}"
        )
    if topic is None:
        if len(topics) > 1:
            raise InputError(
                f"{path}: holds {len(topics)} trajectories; name one as {path.name}:TOPIC, valid: "
                f"{', '.join(names[:8])}{', ...' if len(names) > 8 else ''}"
            )
        return contents, topics[0]
    if topic not in names:
        raise InputError(f"{path}: no trajectory {topic!r}; valid: {neighbours(topic, names)}")
    return contents, topics[names.index(topic)]


def find_own_roles(path: Path) -> dict[str, str]:
    """Return the topics of a Skywright recording by role; empty for other recordings."""
    names = {t.name for t in list_topics(read_mcap(path))}
    return dict(ROLES) if all(topic in names for _, topic in ROLES) else {}


def _decode(path: Path, contents: McapContents, topic: TopicInfo) -> Trajectory:
    strings, turned = KINDS[topic.kind]
    rows = np.full((topic.messages, 8), np.nan)
    for i, raw in enumerate(contents.messages.get(topic.name, [])):
        try:
            rows[i] = _decode_message(raw, strings, turned)
        except (struct.error, IndexError, ValueError):
            continue
    if not len(rows):
        raise InputError(f"{path}: topic {topic.name} contains no messages")
    notes = [] if contents.complete else [CUT]
    if topic.name == ROLES[0][1]:
        early = _count_unset(rows)
        if early == len(rows):
            raise InputError(
                f"{path}: topic {topic.name} contains no estimate; valid: a recording in which the "
                "estimator was ready"
            )
        if early:
            notes.append(f"{early} messages before the first estimate dropped")
            rows = rows[early:]
    q = rows[:, [7, 4, 5, 6]] if turned else None
    t = rows[:, 0]
    known = t[np.isfinite(t)]
    if len(known) and np.all(known == 0.0):
        raise InputError(f"{path}: topic {topic.name} has no time stamps in its headers")
    found = clean(path, t, rows[:, 1:4], q, notes, None)
    return found._replace(name=f"{path.name}:{topic.name}")


def _count_unset(rows: NDArray[Any]) -> int:
    """Return how many messages precede the first estimate.

    The vehicle records the initial value of the estimate until the estimator is ready: exactly the
    origin, without rotation.
    """
    unset = np.all(rows[:, 1:] == [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], axis=1)
    unset |= np.isnan(rows[:, 1])  # a message that cannot be decoded
    return len(rows) if unset.all() else int(np.argmin(unset))


def _decode_message(raw: bytes, strings: int, turned: bool) -> list[float]:
    """Decode t, x, y, z, qx, qy, qz, qw of one message (CDR, either byte order)."""
    order = "<" if raw[1] & 1 else ">"
    at = 4  # after the encapsulation header; alignment is relative to here
    sec, nanosec = struct.unpack_from(order + "iI", raw, at)
    at += 8
    for _ in range(1 + strings):
        at += -(at - 4) % 4
        (length,) = struct.unpack_from(order + "I", raw, at)
        at += 4 + length
    at += -(at - 4) % 8
    values = struct.unpack_from(order + ("7d" if turned else "3d"), raw, at)
    return [sec + 1e-9 * nanosec, *values, *([np.nan] * (7 - len(values)))]
