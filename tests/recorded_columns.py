"""Columns of a recording with everything in it, for tests of files."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from skywright.core.types import MAX_OBJECTS
from skywright.recordings.columns import Column
from skywright.vehicle.simulated import Recorded
from skywright.vehicle.topics import list_topics

PARTS = ("hands", "objects", "loads", "force", "operator", "localisation", "deviation")
"""What not every run has."""


def list_recorded(joints: Sequence[str], n_rotors: int, parts: Collection[str]) -> Recorded:
    """Return columns and topics of a robot with these joints and rotors, and of these PARTS."""
    n = len(joints)
    columns = _list_columns(n, n_rotors)
    if "hands" in parts:
        columns += [
            Column("theta", (n,), unit="rad", meaning="servo shafts"),
            Column("deflection", (n,), unit="rad", meaning="shaft minus output link"),
            Column("cmd_theta", (n,), unit="rad", meaning="commanded shafts"),
        ]
        for side in ("left", "right"):
            columns += _list_hand_columns(side)
    if "objects" in parts:
        for i in range(MAX_OBJECTS):
            columns += _pose_columns(f"object{i}_p_WO", f"object{i}_q_WO", f"movable thing {i}")
    for part, more in OTHERS.items():
        if part in parts:
            columns += more
    return Recorded(tuple(columns), list_topics(columns, joints, n_rotors))


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
        Column("off_s", unit="s", meaning="longest time without force on the tip by now"),
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


def _list_hand_columns(side: str) -> list[Column]:
    return [
        *_pose_columns(f"{side}_p_WH", f"{side}_q_WH", f"{side} hand, true"),
        Column(f"{side}_f_W", (3,), unit="N", meaning="force that it exerts on what it touches"),
        Column(f"{side}_est_p_WH", (3,), unit="m", meaning=f"{side} hand, estimated"),
        Column(f"{side}_est_f_W", (3,), unit="N", meaning="estimated force that it exerts"),
        Column(f"{side}_ref_p_WH", (3,), unit="m", meaning=f"{side} hand, desired"),
        Column(f"{side}_ref_f_W", (3,), unit="N", meaning="desired force"),
    ]


OTHERS = {
    "loads": [
        Column("load_f_B", (3,), unit="N", meaning="of arms or link on the platform"),
        Column("load_t_B", (3,), unit="N m", meaning="likewise, about the origin of B"),
        Column("load_f_peak", unit="N", meaning="largest size since the last sample (1 kHz)"),
        Column("load_t_peak", unit="N m", meaning="likewise"),
        Column("pad_f_W", (3,), unit="N", meaning="contact force on the pads"),
        Column("pad_f_peak", unit="N", meaning="largest since the last sample"),
        Column("pad_impulse_W", (3,), unit="N s", meaning="given to the pads so far"),
        Column("pad_touch_s", unit="s", meaning="in contact so far"),
    ],
    "force": [
        Column("force_meas", unit="N", meaning="by the probe's sensor, less its slider"),
        Column("ref_force", unit="N", meaning="that the tip shall exert"),
        Column("pressing", meaning="1: the arm controls the force"),
        Column("docked", meaning="1: the feet shall rest on the structure"),
        Column("f_docking_W", (3,), unit="N", meaning="of the structure on the docking feet"),
    ],
    "operator": [
        Column("operator_stick", (3,), meaning="each axis from -1 to 1: ahead, left, up"),
        Column("operator_button", meaning="1: pressed"),
    ],
    "localisation": [
        Column("fix_age", unit="s", meaning="since the newest fix of the total station"),
        Column("pose_std", unit="m", meaning="largest of the position's axes"),
    ],
    "deviation": [
        Column("p_std", (3,), unit="m", meaning="stated deviations of the position's axes"),
    ],
}
