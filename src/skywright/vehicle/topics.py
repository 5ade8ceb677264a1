"""The topics of a recording: which ROS 2 message carries which columns of the samples."""

from __future__ import annotations

from collections.abc import Sequence

from skywright.core.types import MAX_OBJECTS
from skywright.description.robot.limbs import SIDES
from skywright.recordings.columns import (
    Column,
    Topic,
    choose_topics,
    joint_state,
    point,
    pose,
    twist,
    vector,
    wrench,
)

MAP, BODY, TIP = "map", "platform", "tip"
"""Frames W, B and T; those of the robot are links of its URDF (models/urdf.py)."""
CONTACT = "contact"
"""Frame of the contact force: at the tip, with the axes of `map`."""
MIXED = f"{MAP} (linear), {BODY} (angular)"
"""`frame_id` of the twists: as in MuJoCo, linear velocity in W and angular velocity in B."""

MISSION_STATUS = """\
std_msgs/Header header
float64 time                        # s, simulated time from the start of the run
int64 phase                         # index into the run's phases; /mission/phase names them"""
CONTACT_STATE = """\
std_msgs/Header header
float64 spring                      # m, compression of the probe's spring
float64 gap                         # m, tip to surface; negative is penetration
float64 gap_max                     # m, worst since the last message
float64 tilt                        # rad, probe axis to the inward normal of the surface
float64 normal_force                # N, of the surface on the tip
float64 collision_force             # N, largest unintended contact force since the last message
float64 off_s                       # s, longest time without force on the tip by now"""
ROTOR_STATE = """\
std_msgs/Header header
float64[] thrust                    # N, one a rotor
float64[] speed                     # rad/s
float64 power                       # W, electrical, whole robot
float64 saturated                   # 1 when the allocation had to give something up"""
LOADS = """\
std_msgs/Header header
geometry_msgs/Wrench wrench         # of arms or link on the platform, about its origin, less zero
float64 force_peak                  # N, largest size since the last message (1 kHz)
float64 torque_peak                 # N m
geometry_msgs/Vector3 pad_force     # N, contact force on the pads, in map
float64 pad_force_peak              # N
geometry_msgs/Vector3 pad_impulse   # N s, given to the pads so far, in map
float64 pad_time                    # s, in contact so far"""
PRESS = """\
std_msgs/Header header
float64 measured                    # N, as the probe's force sensor says
float64 reference                   # N
float64 pressing                    # 1 while the arm controls the force
float64 docked                      # 1 while the docking feet shall rest on the structure
geometry_msgs/Vector3 docking_force # N, of the structure on the feet, in map"""
OPERATOR = """\
std_msgs/Header header
geometry_msgs/Vector3 stick         # each axis from -1 to 1: ahead, left, up
float64 button                      # 1 while it is pressed"""
LOCALISATION = """\
std_msgs/Header header
float64 fix_age                     # s, since the newest sample that was used
float64 position_std                # m, largest of the estimated position's axes"""
COMPLEX = """\
float64 re
float64 im"""
EDDY_CURRENT = """\
std_msgs/Header header
skywright_msgs/Complex signal       # impedance signal, in the instrument's units
geometry_msgs/Point position        # m, tip as motion capture measured it, in map
geometry_msgs/Vector3 axis          # measured probe axis (out of the robot), in map"""


def list_topics(
    columns: Sequence[Column], joints: Sequence[str], n_rotors: int
) -> tuple[Topic, ...]:
    """Return the topics that carry `columns`: the known topics whose columns all exist.

    `joints` are the names of the robot's joints. A column that no known topic carries, such as that
    of a user's sensor, gets its own topic.
    """
    known = [*_list_common(n_rotors), *OTHERS]
    if joints:
        known += [
            joint_state("/joints", joints, position="q", velocity="qd"),
            joint_state("/reference/joints", joints, position="ref_q"),
            joint_state("/command/joints", joints, velocity="cmd_qd"),
            joint_state("/command/torques", joints, effort="cmd_torque"),
            joint_state("/joints/shafts", joints, position="theta"),
            joint_state("/joints/deflection", joints, position="deflection"),
            joint_state("/command/shafts", joints, position="cmd_theta"),
        ]
    for side in SIDES:
        known += _list_hand_topics(side)
    for i in range(MAX_OBJECTS):
        known.append(pose(f"/objects/{i}/pose", MAP, f"object{i}_p_WO", f"object{i}_q_WO"))
    return choose_topics(columns, known)


def _list_common(n_rotors: int) -> list[Topic]:
    """Return the topics of every robot."""
    return [
        Topic(
            "/mission/status", "skywright_msgs/MissionStatus", "", {"time": "t", "phase": "phase"},
            types={"skywright_msgs/MissionStatus": MISSION_STATUS},
        ),
        pose("/truth/pose", MAP, "p_WB", "q_WB"),
        twist("/truth/twist", MIXED, "v_WB", "w_WB_B"),
        pose("/truth/tip", MAP, "p_WT", "q_WT"),
        vector("/truth/wind_force", MAP, "f_wind_W"),
        Topic(
            "/rotors", "skywright_msgs/RotorState", BODY,
            {"thrust": "rotor_thrust", "speed": "rotor_speed", "power": "power",
             "saturated": "saturated"},
            lengths={"thrust": n_rotors, "speed": n_rotors},
            types={"skywright_msgs/RotorState": ROTOR_STATE},
        ),
        wrench("/contact/wrench", CONTACT, "f_contact"),
        Topic(
            "/contact/state", "skywright_msgs/ContactState", CONTACT,
            {"spring": "spring", "gap": "gap", "gap_max": "gap_max", "tilt": "tilt",
             "normal_force": "f_normal", "collision_force": "f_collision", "off_s": "off_s"},
            types={"skywright_msgs/ContactState": CONTACT_STATE},
        ),
        pose("/estimate/pose", MAP, "est_p_WB", "est_q_WB"),
        twist("/estimate/twist", MIXED, "est_v_WB", "est_w_WB_B"),
        point("/estimate/tip", MAP, "est_p_WT"),
        vector("/estimate/external_force", MAP, "est_f_ext_W"),
        pose("/reference/pose", MAP, "ref_p_WB", "ref_q_WB"),
        pose("/reference/tip", MAP, "ref_p_WT", "ref_q_WT"),
        vector("/reference/normal", MAP, "ref_normal_W"),
        wrench("/command/wrench", BODY, "cmd_f_B", "cmd_t_B"),
        Topic(
            "/probe/eddy_current", "skywright_msgs/EddyCurrent", MAP,
            {"signal": "ec", "position": "meas_p_WT", "axis": "meas_axis_W"},
            types={"skywright_msgs/EddyCurrent": EDDY_CURRENT, "skywright_msgs/Complex": COMPLEX},
        ),
    ]  # fmt: skip


def _list_hand_topics(side: str) -> list[Topic]:
    return [
        pose(f"/hands/{side}/pose", MAP, f"{side}_p_WH", f"{side}_q_WH"),
        wrench(f"/hands/{side}/wrench", f"{side}_{CONTACT}", f"{side}_f_W"),
        point(f"/hands/{side}/estimate", MAP, f"{side}_est_p_WH"),
        vector(f"/hands/{side}/estimated_force", MAP, f"{side}_est_f_W"),
        point(f"/hands/{side}/reference", MAP, f"{side}_ref_p_WH"),
        vector(f"/hands/{side}/reference_force", MAP, f"{side}_ref_f_W"),
    ]


OTHERS = (
    Topic(
        "/loads", "skywright_msgs/Loads", BODY,
        {"wrench.force": "load_f_B", "wrench.torque": "load_t_B", "force_peak": "load_f_peak",
         "torque_peak": "load_t_peak", "pad_force": "pad_f_W", "pad_force_peak": "pad_f_peak",
         "pad_impulse": "pad_impulse_W", "pad_time": "pad_touch_s"},
        types={"skywright_msgs/Loads": LOADS},
    ),
    Topic(
        "/probe/press", "skywright_msgs/Press", TIP,
        {"measured": "force_meas", "reference": "ref_force", "pressing": "pressing",
         "docked": "docked", "docking_force": "f_docking_W"},
        types={"skywright_msgs/Press": PRESS},
    ),
    Topic(
        "/operator", "skywright_msgs/Operator", "",
        {"stick": "operator_stick", "button": "operator_button"},
        types={"skywright_msgs/Operator": OPERATOR},
    ),
    Topic(
        "/estimate/localisation", "skywright_msgs/Localisation", MAP,
        {"fix_age": "fix_age", "position_std": "pose_std"},
        types={"skywright_msgs/Localisation": LOCALISATION},
    ),
    vector("/estimate/position_deviation", MAP, "p_std"),
)  # fmt: skip
