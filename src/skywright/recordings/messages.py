"""ROS 2 message types: standard types that recordings use, and definitions of types as text.

Every recording contains the definitions, so that reading it requires neither ROS nor Skywright.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from skywright.recordings.columns import Topic

STANDARD = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": ("geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation"),
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/PointStamped": "std_msgs/Header header\ngeometry_msgs/Point point",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist",
    "geometry_msgs/Vector3Stamped": "std_msgs/Header header\ngeometry_msgs/Vector3 vector",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/Imu": (
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\n"
        "float64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "rcl_interfaces/Log": (
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n"
        "builtin_interfaces/Time stamp\nuint8 level\n"
        "string name\nstring msg\nstring file\nstring function\nuint32 line"
    ),
}
"""Type (`pkg/Type`) -> its definition without comments."""

_RULE = "=" * 80

EVENTS = Topic("/mission/events", "rcl_interfaces/Log", "", {})
"""Phase changes and notes, at the time they occur."""


def definition(kind: str, types: Mapping[str, str] | None = None) -> str:
    """Return the `ros2msg` schema of a type (`pkg/Type`) with every type that it uses.

    `types` defines the types that are not in STANDARD.
    """
    return _define(kind, tuple((types or {}).items()))


@lru_cache(maxsize=256)
def _define(kind: str, types: tuple[tuple[str, str], ...]) -> str:
    known = {**STANDARD, **dict(types)}
    parts, todo, seen = [], [kind], {kind}
    while todo:
        name = todo.pop(0)
        text = known[name]
        parts.append(text if name == kind else f"{_RULE}\nMSG: {name}\n{text}")
        for line in text.splitlines():
            used = line.split()[0].partition("[")[0]
            if used in known and used not in seen:
                seen.add(used)
                todo.append(used)
    return "\n".join(parts) + "\n"


def full_name(kind: str) -> str:
    """Return the ROS 2 name of a type: `pkg/msg/Type`."""
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}"
