"""Incoming commands by name: services are answered, streams are not.

The ROS 2 types and the tables of the documentation (docs/howto/ros2.md) follow from these tables;
links/broadcast/commands.py executes the commands.
"""

from __future__ import annotations

from typing import NamedTuple

from skywright.links.broadcast.topics import UAL

TRIGGER = "std_srvs/Trigger"
_REPLY = "bool success\nstring message"
SERVICE_TYPES = {
    TRIGGER: ("", _REPLY),
    f"{UAL}/TakeOff": ("float32 height\nbool blocking", _REPLY),
    f"{UAL}/Land": ("bool blocking", _REPLY),
    f"{UAL}/GoToWaypoint": ("geometry_msgs/PoseStamped waypoint\nbool blocking", _REPLY),
    f"{UAL}/GoToWaypointGeo": ("sensor_msgs/NavSatFix waypoint\nbool blocking", _REPLY),
    f"{UAL}/SetHome": ("bool set_z", _REPLY),
}
"""Type of a service -> its request and its response. Requests are UAL's; its responses are empty in
ROS 1, where a call itself returns whether it succeeded."""


class Service(NamedTuple):
    """A command with an answer."""

    name: str
    kind: str  # of SERVICE_TYPES
    what: str
    by_mission: str = ""  # its effect during a mission; "" if it is refused


class Stream(NamedTuple):
    """A command that is sent repeatedly."""

    name: str
    kind: str
    what: str
    by_mission: str = ""


SERVICES = (
    Service("/ual/take_off", f"{UAL}/TakeOff", "`take_off`"),
    Service("/ual/land", f"{UAL}/Land", "`land`", "end the mission: land where the robot is"),
    Service("/ual/go_to_waypoint", f"{UAL}/GoToWaypoint", "`go_to`"),
    Service("/ual/go_to_waypoint_geo", f"{UAL}/GoToWaypointGeo", "`go_to_geo`"),
    Service("/ual/set_home", f"{UAL}/SetHome", "`set_home`; `set_z` has no effect"),
    Service(
        "/ual/recover_from_manual", TRIGGER, "`recover_from_manual`", "give the robot back to the "
        "mission",
    ),
    Service("/ual/take_over", TRIGGER, "`take_over`", "the pilot's switch, in position mode"),
    Service("/ual/arm", TRIGGER, "`arm`"),
    Service("/ual/disarm", TRIGGER, "`disarm`"),
    Service("/ual/hold", TRIGGER, "`hold`"),
    Service("/ual/go_home", TRIGGER, "`go_home`"),
    Service("/mission/abort", TRIGGER, "refused", "end the mission: return home and land"),
    Service("/mission/next", TRIGGER, "refused", "the order `next`"),
    Service("/mission/retry", TRIGGER, "refused", "the order `retry`"),
    Service("/mission/retract", TRIGGER, "refused", "the order `retract`"),
)  # fmt: skip
STREAMS = (
    Stream("/ual/set_pose", "geometry_msgs/PoseStamped", "`set_pose`"),
    Stream(
        "/ual/set_velocity", "geometry_msgs/TwistStamped", "`set_velocity`",
        "the stick, after `/ual/take_over`, up to its speed in position mode",
    ),
    Stream("/arms/set_joints", "sensor_msgs/JointState", "`set_joints`, positions in the robot's "
           "order or by name"),
)  # fmt: skip
OLD_S = 0.25
"""s beyond the shortest delay after which a message of a stream is dropped."""
