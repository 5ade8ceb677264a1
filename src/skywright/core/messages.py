"""The ROS 2 messages of a recording: which topic carries which field of SAMPLE.

Standard types where they exist; `skywright_msgs` where none does (docs/reference/messages.md).
Their definitions are written into every recording, so that no ROS installation and no package of
ours is needed to read one.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from skywright.core.types import MAX_OBJECTS

_STANDARD = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
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

_OWN = {
    "skywright_msgs/MissionStatus": """\
std_msgs/Header header
float64 time                        # s, simulated time from the start of the run
int64 phase                         # index into the run's phases; /mission/events names them""",
    "skywright_msgs/ContactState": """\
std_msgs/Header header
float64 spring                      # m, compression of the probe's spring
float64 gap                         # m, tip to surface; negative is penetration
float64 gap_max                     # m, worst since the last message
float64 tilt                        # rad, probe axis to the inward normal of the surface
float64 normal_force                # N, of the surface on the tip
float64 collision_force             # N, largest unintended contact force since the last message""",
    "skywright_msgs/RotorState": """\
std_msgs/Header header
float64[] thrust                    # N, one a rotor
float64[] speed                     # rad/s
float64 power                       # W, electrical, whole robot
float64 saturated                   # 1 when the allocation had to give something up""",
    "skywright_msgs/Loads": """\
std_msgs/Header header
geometry_msgs/Wrench wrench         # of arms or link on the platform, about its origin, less zero
float64 force_peak                  # N, largest size since the last message (1 kHz)
float64 torque_peak                 # N m
geometry_msgs/Vector3 pad_force     # N, contact force on the pads, in map
float64 pad_force_peak              # N
geometry_msgs/Vector3 pad_impulse   # N s, given to the pads so far, in map
float64 pad_time                    # s, in contact so far""",
    "skywright_msgs/Press": """\
std_msgs/Header header
float64 measured                    # N, as the probe's force sensor says
float64 reference                   # N
float64 pressing                    # 1 while the arm controls the force
float64 docked                      # 1 while the docking feet shall rest on the structure
geometry_msgs/Vector3 docking_force # N, of the structure on the feet, in map""",
    "skywright_msgs/Operator": """\
std_msgs/Header header
geometry_msgs/Vector3 stick         # each axis from -1 to 1: ahead, left, up
float64 button                      # 1 while it is pressed""",
    "skywright_msgs/Localisation": """\
std_msgs/Header header
float64 fix_age                     # s, since the total station's newest sample that was used
float64 position_std                # m, largest of the estimated position's axes""",
    "skywright_msgs/Complex": """\
float64 re
float64 im""",
    "skywright_msgs/EddyCurrent": """\
std_msgs/Header header
skywright_msgs/Complex signal       # impedance signal, in the instrument's units
geometry_msgs/Point position        # m, tip as motion capture measured it, in map
geometry_msgs/Vector3 axis          # measured probe axis (out of the robot), in map""",
}

_DEFINITIONS = _STANDARD | _OWN
_RULE = "=" * 80

MAP, BODY, TIP = "map", "base_link", "tip"
CONTACT = "contact"
"""Frame of the contact wrench: at the tip, with the axes of `map`."""
MIXED = "map (linear), base_link (angular)"
"""`frame_id` of the twists: as in MuJoCo, linear velocity in W and angular velocity in B."""


class Topic(NamedTuple):
    """A topic: its type, the frame of its header, and the field of SAMPLE behind each path.

    `lengths` gives the length of a sequence as "joints" or "rotors". A `derived` topic repeats
    what others hold, for viewers; reading skips it. A topic with a `part` is only written where
    the robot or the world has it (`PARTS`).
    """

    name: str
    kind: str
    frame: str
    fields: dict[str, str]
    lengths: dict[str, str] = {}
    derived: bool = False
    part: str = ""


def _pose(name: str, p: str, q: str) -> Topic:
    fields = {"pose.position": p, "pose.orientation": q}
    return Topic(name, "geometry_msgs/PoseStamped", MAP, fields)


def _twist(name: str, v: str, w: str) -> Topic:
    fields = {"twist.linear": v, "twist.angular": w}
    return Topic(name, "geometry_msgs/TwistStamped", MIXED, fields)


def _vector(name: str, field: str) -> Topic:
    return Topic(name, "geometry_msgs/Vector3Stamped", MAP, {"vector": field})


def _point(name: str, field: str) -> Topic:
    return Topic(name, "geometry_msgs/PointStamped", MAP, {"point": field})


def _joints(name: str, **fields: str) -> Topic:
    lengths = dict.fromkeys(("name", *fields), "joints")
    return Topic(name, "sensor_msgs/JointState", "", fields, lengths)


PARTS = ("hands", "objects", "loads", "force", "operator", "localisation")
"""What not every run has: compliant arms with hands, movable things, gauges, a force sensor, an
operator, localisation without motion capture."""


def _hand(side: str) -> list[Topic]:
    frame = f"hand_{side}"
    force = {"wrench.force": f"{side}_f_W"}
    return [
        _pose(f"/hands/{side}/pose", f"{side}_p_WH", f"{side}_q_WH"),
        Topic(f"/hands/{side}/wrench", "geometry_msgs/WrenchStamped", frame, force),
        _point(f"/hands/{side}/estimate", f"{side}_est_p_WH"),
        _vector(f"/hands/{side}/estimated_force", f"{side}_est_f_W"),
        _point(f"/hands/{side}/reference", f"{side}_ref_p_WH"),
        _vector(f"/hands/{side}/reference_force", f"{side}_ref_f_W"),
    ]


def _arms() -> list[Topic]:
    topics = [
        _joints("/joints/shafts", position="theta"),
        _joints("/joints/deflection", position="deflection"),
        _joints("/command/shafts", position="cmd_theta"),
        *_hand("left"),
        *_hand("right"),
    ]
    return [topic._replace(part="hands") for topic in topics]


def _objects() -> list[Topic]:
    topics = [
        _pose(f"/objects/{i}/pose", f"object{i}_p_WO", f"object{i}_q_WO")
        for i in range(MAX_OBJECTS)
    ]
    return [topic._replace(part="objects") for topic in topics]


TOPICS = (
    Topic("/mission/status", "skywright_msgs/MissionStatus", "", {"time": "t", "phase": "phase"}),
    _pose("/truth/pose", "p_WB", "q_WB"),
    _twist("/truth/twist", "v_WB", "w_WB_B"),
    _pose("/truth/tip", "p_WT", "q_WT"),
    _vector("/truth/wind_force", "f_wind_W"),
    _joints("/joints", position="q", velocity="qd"),
    Topic(
        "/rotors",
        "skywright_msgs/RotorState",
        BODY,
        {
            "thrust": "rotor_thrust",
            "speed": "rotor_speed",
            "power": "power",
            "saturated": "saturated",
        },
        {"thrust": "rotors", "speed": "rotors"},
    ),
    Topic("/contact/wrench", "geometry_msgs/WrenchStamped", CONTACT, {"wrench.force": "f_contact"}),
    Topic(
        "/contact/state",
        "skywright_msgs/ContactState",
        CONTACT,
        {
            "spring": "spring",
            "gap": "gap",
            "gap_max": "gap_max",
            "tilt": "tilt",
            "normal_force": "f_normal",
            "collision_force": "f_collision",
        },
    ),
    _pose("/estimate/pose", "est_p_WB", "est_q_WB"),
    _twist("/estimate/twist", "est_v_WB", "est_w_WB_B"),
    _point("/estimate/tip", "est_p_WT"),
    _vector("/estimate/external_force", "est_f_ext_W"),
    _pose("/reference/pose", "ref_p_WB", "ref_q_WB"),
    _pose("/reference/tip", "ref_p_WT", "ref_q_WT"),
    _vector("/reference/normal", "ref_normal_W"),
    _joints("/reference/joints", position="ref_q"),
    Topic(
        "/command/wrench",
        "geometry_msgs/WrenchStamped",
        BODY,
        {"wrench.force": "cmd_f_B", "wrench.torque": "cmd_t_B"},
    ),
    _joints("/command/joints", velocity="cmd_qd"),
    Topic(
        "/probe/eddy_current",
        "skywright_msgs/EddyCurrent",
        MAP,
        {"signal": "ec", "position": "meas_p_WT", "axis": "meas_axis_W"},
    ),
    *_arms(),
    *_objects(),
    Topic(
        "/loads",
        "skywright_msgs/Loads",
        BODY,
        {
            "wrench.force": "load_f_B",
            "wrench.torque": "load_t_B",
            "force_peak": "load_f_peak",
            "torque_peak": "load_t_peak",
            "pad_force": "pad_f_W",
            "pad_force_peak": "pad_f_peak",
            "pad_impulse": "pad_impulse_W",
            "pad_time": "pad_touch_s",
        },
        part="loads",
    ),
    Topic(
        "/probe/press",
        "skywright_msgs/Press",
        TIP,
        {
            "measured": "force_meas",
            "reference": "ref_force",
            "pressing": "pressing",
            "docked": "docked",
            "docking_force": "f_docking_W",
        },
        part="force",
    ),
    Topic(
        "/operator",
        "skywright_msgs/Operator",
        "",
        {"stick": "operator_stick", "button": "operator_button"},
        part="operator",
    ),
    Topic(
        "/estimate/localisation",
        "skywright_msgs/Localisation",
        MAP,
        {"fix_age": "fix_age", "position_std": "pose_std"},
        part="localisation",
    ),
    Topic(
        "/tf",
        "tf2_msgs/TFMessage",
        MAP,
        {
            "transforms[0].transform.translation": "p_WB",
            "transforms[0].transform.rotation": "q_WB",
            "transforms[1].transform.translation": "p_WT",
            "transforms[1].transform.rotation": "q_WT",
            "transforms[2].transform.translation": "p_WT",  # the rotation stays the identity
        },
        derived=True,
    ),
)
"""All periodic topics, one message a sample each."""


def list_topics(parts: Collection[str]) -> list[Topic]:
    """Return the topics of a recording with these `PARTS`."""
    return [topic for topic in TOPICS if not topic.part or topic.part in parts]


TF_CHILDREN = (BODY, TIP, CONTACT)

EVENTS = Topic("/mission/events", "rcl_interfaces/Log", "", {})
"""Phase changes and notes, when they happen."""


def definition(kind: str) -> str:
    """Return the `ros2msg` schema of a type (`pkg/Type`) with every type that it uses."""
    parts, todo, seen = [], [kind], {kind}
    while todo:
        name = todo.pop(0)
        text = _DEFINITIONS[name]
        parts.append(text if name == kind else f"{_RULE}\nMSG: {name}\n{text}")
        for line in text.splitlines():
            used = line.split()[0].partition("[")[0]
            if used in _DEFINITIONS and used not in seen:
                seen.add(used)
                todo.append(used)
    return "\n".join(parts) + "\n"


def full_name(kind: str) -> str:
    """Return the name that ROS 2 gives a type: `pkg/msg/Type`."""
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}"
