"""What the simulated vehicle records: its columns and the topics that carry them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.columns import (
    Column,
    Topic,
    build_dtype,
    joint_state,
    point,
    pose,
    twist,
    vector,
    wrench,
)
from skywright.core.types import MAX_OBJECTS

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
float64 collision_force             # N, largest unintended contact force since the last message"""
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
float64 fix_age                     # s, since the total station's newest sample that was used
float64 position_std                # m, largest of the estimated position's axes"""
COMPLEX = """\
float64 re
float64 im"""
EDDY_CURRENT = """\
std_msgs/Header header
skywright_msgs/Complex signal       # impedance signal, in the instrument's units
geometry_msgs/Point position        # m, tip as motion capture measured it, in map
geometry_msgs/Vector3 axis          # measured probe axis (out of the robot), in map"""

PARTS = ("hands", "objects", "loads", "force", "operator", "localisation")
"""What not every run has: compliant arms with hands, movable things, gauges, a force sensor, an
operator, localisation without motion capture."""


class Recorded(NamedTuple):
    """What one run records."""

    columns: tuple[Column, ...]
    topics: tuple[Topic, ...]

    def select(self, samples: NDArray[Any]) -> NDArray[Any]:
        """Return what is recorded of samples that may hold more, in columns and in their width."""
        out = np.empty(len(samples), build_dtype(self.columns))
        for name, shape, *_ in self.columns:
            out[name] = samples[name][:, : shape[0]] if shape else samples[name]
        return out


def list_recorded(joints: Sequence[str], n_rotors: int, parts: Collection[str]) -> Recorded:
    """Return columns and topics of a robot with these joints and rotors, and of these PARTS."""
    assert set(parts) <= set(PARTS)
    n = len(joints)
    columns, topics = [*_list_columns(n, n_rotors)], _list_topics(joints, n_rotors)
    if "hands" in parts:
        columns += [
            Column("theta", (n,), unit="rad", meaning="servo shafts"),
            Column("deflection", (n,), unit="rad", meaning="shaft minus output link"),
            Column("cmd_theta", (n,), unit="rad", meaning="commanded shafts"),
        ]
        shafts = [
            joint_state("/joints/shafts", joints, position="theta"),
            joint_state("/joints/deflection", joints, position="deflection"),
            joint_state("/command/shafts", joints, position="cmd_theta"),
        ]
        topics += shafts if joints else []
        for side in ("left", "right"):
            columns += _list_hand_columns(side)
            topics += _list_hand_topics(side)
    if "objects" in parts:
        for i in range(MAX_OBJECTS):
            p, q = f"object{i}_p_WO", f"object{i}_q_WO"
            columns += _pose_columns(p, q, f"movable thing {i} of the world")
            topics.append(pose(f"/objects/{i}/pose", MAP, p, q))
    for part, (more, topic) in _OTHERS.items():
        if part in parts:
            columns += more
            topics.append(topic)
    return Recorded(tuple(columns), tuple(topics))


def _pose_columns(p: str, q: str, what: str) -> list[Column]:
    return [
        Column(p, (3,), unit="m", meaning=what),
        Column(q, (4,), meaning=f"{what}, attitude"),
    ]


def _list_columns(n: int, n_rotors: int) -> list[Column]:
    """Columns of every robot, with `n` joints."""
    return [
        Column("t", unit="s", meaning="simulated time from the start of the run"),
        Column("phase", dtype="<i8", meaning="index into the run's phases"),
        *_pose_columns("p_WB", "q_WB", "platform"),
        Column("v_WB", (3,), unit="m/s", meaning="of the platform, in W"),
        Column("w_WB_B", (3,), unit="rad/s", meaning="of the platform, in B"),
        Column("q", (n,), unit="rad", meaning="arm joints, output side"),
        Column("qd", (n,), unit="rad/s", meaning="arm joints, output side"),
        *_pose_columns("p_WT", "q_WT", "probe's tip, z out of the robot"),
        Column("rotor_thrust", (n_rotors,), unit="N"),
        Column("rotor_speed", (n_rotors,), unit="rad/s"),
        Column("spring", unit="m", meaning="compression of the probe's spring"),
        Column("gap", unit="m", meaning="tip to surface; negative is penetration"),
        Column("gap_max", unit="m", meaning="worst gap since the last sample"),
        Column("tilt", unit="rad", meaning="probe axis to the inward normal of the surface"),
        Column("f_contact", (3,), unit="N", meaning="force of the surface on the tip, in W"),
        Column("f_normal", unit="N", meaning="its normal part"),
        Column("f_collision", unit="N", meaning="largest unintended force since the last sample"),
        Column("f_wind_W", (3,), unit="N", meaning="aerodynamic drag on the robot"),
        Column("power", unit="W", meaning="electrical, whole robot"),
        *_pose_columns("est_p_WB", "est_q_WB", "platform, estimated"),
        Column("est_v_WB", (3,), unit="m/s", meaning="estimated"),
        Column("est_w_WB_B", (3,), unit="rad/s", meaning="estimated"),
        Column("est_p_WT", (3,), unit="m", meaning="tip, estimated"),
        Column("est_f_ext_W", (3,), unit="N", meaning="external force on the robot, estimated"),
        *_pose_columns("ref_p_WB", "ref_q_WB", "platform, nominal"),
        Column("ref_q", (n,), unit="rad", meaning="arm joints, nominal"),
        *_pose_columns("ref_p_WT", "ref_q_WT", "desired tip; inside the surface while pushing"),
        Column("ref_normal_W", (3,), meaning="outward normal there; zero in free flight"),
        Column("cmd_f_B", (3,), unit="N", meaning="force that the law asks of the rotors"),
        Column("cmd_t_B", (3,), unit="N m", meaning="torque that the law asks of the rotors"),
        Column("cmd_qd", (n,), unit="rad/s", meaning="commanded joint speeds"),
        Column("saturated", meaning="1: the allocation had to give something up"),
        Column("ec", (2,), meaning="eddy-current signal, in the instrument's units"),
        Column("meas_p_WT", (3,), unit="m", meaning="tip as motion capture measured it"),
        Column("meas_axis_W", (3,), meaning="measured probe axis, out of the robot"),
    ]


def _list_topics(joints: Sequence[str], n_rotors: int) -> list[Topic]:
    """Topics of every robot; those of joints only where it has any."""
    arm = [
        joint_state("/joints", joints, position="q", velocity="qd"),
        joint_state("/reference/joints", joints, position="ref_q"),
        joint_state("/command/joints", joints, velocity="cmd_qd"),
    ]
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
             "normal_force": "f_normal", "collision_force": "f_collision"},
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
        *(arm if joints else []),
    ]  # fmt: skip


def _list_hand_columns(side: str) -> list[Column]:
    return [
        *_pose_columns(f"{side}_p_WH", f"{side}_q_WH", f"{side} hand, true"),
        Column(f"{side}_f_W", (3,), unit="N", meaning="force that it exerts on what it touches"),
        Column(f"{side}_est_p_WH", (3,), unit="m", meaning=f"{side} hand, estimated"),
        Column(f"{side}_est_f_W", (3,), unit="N", meaning="estimated force that it exerts"),
        Column(f"{side}_ref_p_WH", (3,), unit="m", meaning=f"{side} hand, desired"),
        Column(f"{side}_ref_f_W", (3,), unit="N", meaning="desired force"),
    ]


def _list_hand_topics(side: str) -> list[Topic]:
    return [
        pose(f"/hands/{side}/pose", MAP, f"{side}_p_WH", f"{side}_q_WH"),
        wrench(f"/hands/{side}/wrench", f"{side}_{CONTACT}", f"{side}_f_W"),
        point(f"/hands/{side}/estimate", MAP, f"{side}_est_p_WH"),
        vector(f"/hands/{side}/estimated_force", MAP, f"{side}_est_f_W"),
        point(f"/hands/{side}/reference", MAP, f"{side}_ref_p_WH"),
        vector(f"/hands/{side}/reference_force", MAP, f"{side}_ref_f_W"),
    ]


_OTHERS: dict[str, tuple[list[Column], Topic]] = {
    "loads": (
        [
            Column("load_f_B", (3,), unit="N", meaning="of arms or link on the platform"),
            Column("load_t_B", (3,), unit="N m", meaning="likewise, about the origin of B"),
            Column("load_f_peak", unit="N", meaning="largest size since the last sample (1 kHz)"),
            Column("load_t_peak", unit="N m", meaning="likewise"),
            Column("pad_f_W", (3,), unit="N", meaning="contact force on the pads"),
            Column("pad_f_peak", unit="N", meaning="largest since the last sample"),
            Column("pad_impulse_W", (3,), unit="N s", meaning="given to the pads so far"),
            Column("pad_touch_s", unit="s", meaning="in contact so far"),
        ],
        Topic(
            "/loads", "skywright_msgs/Loads", BODY,
            {"wrench.force": "load_f_B", "wrench.torque": "load_t_B", "force_peak": "load_f_peak",
             "torque_peak": "load_t_peak", "pad_force": "pad_f_W", "pad_force_peak": "pad_f_peak",
             "pad_impulse": "pad_impulse_W", "pad_time": "pad_touch_s"},
            types={"skywright_msgs/Loads": LOADS},
        ),
    ),
    "force": (
        [
            Column("force_meas", unit="N", meaning="by the probe's sensor, less its slider"),
            Column("ref_force", unit="N", meaning="that the tip shall exert"),
            Column("pressing", meaning="1: the arm controls the force"),
            Column("docked", meaning="1: the feet shall rest on the structure"),
            Column("f_docking_W", (3,), unit="N", meaning="of the structure on the docking feet"),
        ],
        Topic(
            "/probe/press", "skywright_msgs/Press", TIP,
            {"measured": "force_meas", "reference": "ref_force", "pressing": "pressing",
             "docked": "docked", "docking_force": "f_docking_W"},
            types={"skywright_msgs/Press": PRESS},
        ),
    ),
    "operator": (
        [
            Column("operator_stick", (3,), meaning="each axis from -1 to 1: ahead, left, up"),
            Column("operator_button", meaning="1: pressed"),
        ],
        Topic(
            "/operator", "skywright_msgs/Operator", "",
            {"stick": "operator_stick", "button": "operator_button"},
            types={"skywright_msgs/Operator": OPERATOR},
        ),
    ),
    "localisation": (
        [
            Column("fix_age", unit="s", meaning="since the newest fix of the total station"),
            Column("pose_std", unit="m", meaning="largest of the estimated position's axes"),
        ],
        Topic(
            "/estimate/localisation", "skywright_msgs/Localisation", MAP,
            {"fix_age": "fix_age", "position_std": "pose_std"},
            types={"skywright_msgs/Localisation": LOCALISATION},
        ),
    ),
}  # fmt: skip
