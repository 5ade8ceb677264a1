"""The topics of a live flight: those of UAL, tf and joints, and all topics of a recording.

A live row is a sample of the recording with additional columns, so that the topics of a recording
are published byte for byte as they are written. `GIVEN` are the topics that do not depend on the
robot (docs/howto/ros2.md has them as a table).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skywright.models.drawing import Drawing
from skywright.recordings.columns import Column, Topic, joint_state, pose, twist
from skywright.vehicle.commands import State
from skywright.vehicle.topics import BODY, MAP, MIXED

UAL = "uav_abstraction_layer"
STATES = {state: number for number, state in enumerate(State)}
"""Numbers of UAL's State.msg, by state."""

STATE = "".join(f"uint8 {s.name}={n}\n" for s, n in STATES.items()) + "uint8 state"
COVARIANCE = "geometry_msgs/{0} {1}\nfloat64[36] covariance"
TYPES = {
    f"{UAL}/State": STATE,
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "geometry_msgs/PoseWithCovariance": COVARIANCE.format("Pose", "pose"),
    "geometry_msgs/TwistWithCovariance": COVARIANCE.format("Twist", "twist"),
    "nav_msgs/Odometry": (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "sensor_msgs/BatteryState": (
        "std_msgs/Header header\n"
        "float32 voltage\nfloat32 temperature\nfloat32 current\nfloat32 charge\n"
        "float32 capacity\nfloat32 design_capacity\nfloat32 percentage\n"
        "uint8 power_supply_status\nuint8 power_supply_health\nuint8 power_supply_technology\n"
        "bool present\nfloat32[] cell_voltage\nfloat32[] cell_temperature\n"
        "string location\nstring serial_number"
    ),
}
"""Types in addition to those of recordings; a test compares them with every distribution's."""

EXTRA = (
    Column("live_state", (), "|u1", "", "state of the vehicle, UAL's number"),
    Column("live_charge", (), "<f4", "", "share of the battery's energy that is left"),
    Column("live_v_B", (3,), "<f8", "m/s", "estimated velocity, in the platform's axes"),
    Column("live_stamp", (), "<u8", "", "mission time, as ROS stamps it"),
)
"""Columns of a live row in addition to those of a sample."""


class Given(NamedTuple):
    """A topic with its description for the documentation."""

    topic: Topic
    what: str


_UNMEASURED = ("voltage", "temperature", "current", "charge", "capacity", "design_capacity")
_ODOMETRY = {
    "pose.pose.position": "est_p_WB", "pose.pose.orientation": "est_q_WB",
    "twist.twist.linear": "live_v_B", "twist.twist.angular": "est_w_WB_B",
}  # fmt: skip
GIVEN = (
    Given(
        Topic("/clock", "rosgraph_msgs/Clock", "", {"clock": "live_stamp"}, types=TYPES),
        "mission time, for `use_sim_time`",
    ),
    Given(pose("/ual/pose", MAP, "est_p_WB", "est_q_WB"), "estimated pose of the platform"),
    Given(twist("/ual/velocity", MIXED, "est_v_WB", "est_w_WB_B"), "estimated velocities"),
    Given(
        Topic("/ual/odom", "nav_msgs/Odometry", MAP, _ODOMETRY, {"child_frame_id": BODY},
              types=TYPES),
        "both, velocities in the frame of the platform; covariances are 0: unknown",
    ),
    Given(pose("/ual/ref_pose", MAP, "ref_p_WB", "ref_q_WB"), "commanded pose of the platform"),
    Given(
        Topic("/ual/state", f"{UAL}/State", "", {"state": "live_state"}, types=TYPES),
        "state of the vehicle",
    ),
    Given(
        Topic("/battery", "sensor_msgs/BatteryState", BODY, {"percentage": "live_charge"},
              types=TYPES, numbers={**dict.fromkeys(_UNMEASURED, np.nan), "present": 1.0}),
        "charge of the battery, 0 to 1; NaN without a gauge",
    ),
)  # fmt: skip
ROBOT = (
    Given(Topic("/joint_states", "sensor_msgs/JointState", BODY, {}), "joints by name"),
    Given(
        Topic("/tf", "tf2_msgs/TFMessage", "", {}),
        f"`{MAP}` to `{BODY}` as estimated, and the links of the arms; things that move",
    ),
)
"""Topics whose messages depend on the robot."""
TEXTS = (
    Given(Topic("/mission/phase", "std_msgs/String", "", {}), "name of the phase that is flown"),
    Given(
        Topic("/robot_description", "std_msgs/String", "", {}),
        "the robot as URDF, once a second; its links are frames of /tf",
    ),
)
"""Topics of texts."""


def list_live_topics(
    columns: Sequence[Column], recorded: Sequence[Topic], joints: Sequence[str], drawing: Drawing
) -> list[Topic]:
    """Return the topics of a live flight, in order; each names columns of a live row.

    `columns` and `recorded` are those of the vehicle's recording.
    """
    names = {c.name for c in [*columns, *EXTRA]}
    out = [g.topic for g in GIVEN if names.issuperset(g.topic.fields.values())]
    if joints:
        effort = {"effort": "cmd_torque"} if "cmd_torque" in names else {}
        state = joint_state("/joint_states", joints, position="q", velocity="qd", **effort)
        out.append(state._replace(frame=BODY))
    return [*out, _build_tf(drawing), *recorded]


def list_part_columns(drawing: Drawing) -> list[Column]:
    """Return the columns of the parts' poses, which the publishing process computes."""
    out = []
    for i in range(len(drawing.parts)):
        out += [Column(f"part{i}_p", (3,), unit="m"), Column(f"part{i}_q", (4,))]
    return out


def name_frame(drawing: Drawing, i: int) -> str:
    """Return the frame of a part: its name, MAP for the world (-1)."""
    return MAP if i < 0 else drawing.parts[i].name.replace(" ", "_")


def _build_tf(drawing: Drawing) -> Topic:
    fields, texts = {}, {}
    for i, part in enumerate(drawing.parts):
        at = f"transforms[{i}]"
        fields[f"{at}.transform.translation"] = f"part{i}_p"
        fields[f"{at}.transform.rotation"] = f"part{i}_q"
        texts[f"{at}.child_frame_id"] = name_frame(drawing, i)
        texts[f"{at}.header.frame_id"] = name_frame(drawing, part.parent)
    lengths = {"transforms": len(drawing.parts)}
    return Topic("/tf", "tf2_msgs/TFMessage", "", fields, texts, lengths)
