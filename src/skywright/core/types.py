"""Sizes, the rows of a plan, and the records that models share.

Units are SI and radians. Frames: W world (ENU), B body (FLU), T tip (z along the probe, pointing
out of the robot), S surface (z = outward normal). Quaternions are wxyz.
"""

from __future__ import annotations

import numpy as np

MAX_JOINTS = 9
"""Most arm joints of one robot (the long-reach dual arm of Suarez 2020 has 1 passive + 2 x 4)."""
MAX_HANDS = 2
"""Most arms that end in a hand: 0 left (or the only one), 1 right."""
MAX_OBJECTS = 4
"""Most movable things in a world."""
MAX_ROTORS = 12
"""Most rotors of one robot."""

f8 = np.float64
i8 = np.int64

REFERENCE = np.dtype(
    [
        ("t", f8),  # s, mission time from which this row holds
        ("p_WB", f8, 3),  # m, nominal platform position
        ("v_WB", f8, 3),  # m/s
        ("a_WB", f8, 3),  # m/s^2
        ("R_WB", f8, (3, 3)),  # nominal platform attitude
        ("w_WB_B", f8, 3),  # rad/s, in B
        ("wd_WB_B", f8, 3),  # rad/s^2, in B
        ("q", f8, MAX_JOINTS),  # rad, nominal arm joints (output side)
        ("qd", f8, MAX_JOINTS),  # rad/s
        ("p_WT", f8, 3),  # m, desired tip position (inside the surface while pushing)
        ("v_WT", f8, 3),  # m/s
        ("R_WT", f8, (3, 3)),  # desired tip attitude
        ("R_WS", f8, (3, 3)),  # surface frame at the desired tip (identity in free flight)
        ("dead_zone", f8),  # m, of the integral along z_S; 0 trims all directions (free flight)
        ("track_tip", f8),  # 1: close the position loop at the tip (law 4); 0: at the platform
        ("active", f8),  # 1: rotors on; 0: motors off
        # hands of compliant arms (control/arms): what each shall do, see the tasks below
        ("task", f8, MAX_HANDS),
        ("p_WH", f8, (MAX_HANDS, 3)),  # m, desired hand position
        ("v_WH", f8, (MAX_HANDS, 3)),  # m/s
        ("f_WH", f8, (MAX_HANDS, 3)),  # N, force that the hand shall exert on what it touches
        ("gamma", f8, MAX_HANDS),  # weight of force over position in Suarez 2020 (31)
        ("load", f8, MAX_HANDS),  # N, weight that hangs on each hand, fed forward
        ("tau", f8, MAX_JOINTS),  # N m, torque that a joint's spring shall carry (18)
        ("delta", f8, MAX_JOINTS),  # (22): 1 output position `q`, 0 torque `tau`
        ("tare", f8),  # 1: the estimated contact forces of now are called zero
        # pressing with a probe that measures its force (control/backstepping.py)
        ("press", f8),  # 1: the arm controls the force, 0: its joints
        ("force", f8),  # N, that the tip shall exert along the probe's axis
        ("docked", f8),  # 1: feet rest on the structure, so the platform's integrals rest
        ("f_feet_B", f8, 3),  # N, planned force of the structure on the docking feet, in B
        ("t_feet_B", f8, 3),  # N m, about the origin of B
        ("mode", f8),  # MODE_ below
    ]
)
"""A row of a plan: what a control law may be asked to follow."""

LINEAR, HOLD, HOLD_END, ROTATION = range(4)
"""Between two rows a field is interpolated, that of the first, that of the first until the second
is reached, or a rotation interpolated."""

(
    TASK_JOINTS, TASK_POSITION, TASK_VELOCITY, TASK_FORCE, TASK_FORCE_POSITION, TASK_SQUEEZE,
    TASK_LOOPS, TASK_VISUAL,
) = range(8)  # fmt: skip
"""What `REFERENCE.task` asks of a hand: joint angles `q`; a straight line to `p_WH` at the speed
|v_WH| (Suarez 2020, 23); the velocity `v_WH` (24); the force `f_WH` along its direction (25)-(28);
both (31); both, with the force |f_WH| towards the other hand (32); the joint loops (14)-(22); a
straight line to the marker, with `p_WH` the hand's place in the marker's frame M."""

MODE_POSE, MODE_STANDARD = 0, 1
"""`REFERENCE.mode` of a fully actuated platform: position and attitude each follow their own
reference (the paper's "command position" and "command angle"), or only attitude and height do."""

BODY = np.dtype(
    [
        ("mass", f8),  # kg, whole robot
        ("gravity", f8),  # m/s^2, positive down
        ("p_BC", f8, 3),  # m, whole-robot centre of mass in B at the estimated joints
        ("I_B", f8, (3, 3)),  # kg m^2, composite inertia about the origin of B
        ("p_BT", f8, 3),  # m, tip in B (without probe and arm: the origin)
        ("R_BT", f8, (3, 3)),
        ("J_BT", f8, (3, MAX_JOINTS)),  # tip position Jacobian in B (m/rad)
        ("n_joints", i8),
    ]
)
"""The nominal rigid body at the estimated configuration (belief, never plant data)."""

HISTORY = 64
"""Control ticks of estimate history kept for delayed measurements."""

IMU_BATCH = 32
"""Most inertial samples that reach the controller in one control tick."""
IMU_HISTORY = 512
"""Inertial samples kept for delayed measurements; a power of two."""

WRENCH = np.dtype(
    [
        ("on", i8),  # 1: a law uses it
        ("swing", i8),  # index in q of the joint without a servo, -1: none
        ("axis", f8, 3),  # of that joint, in B
        ("bandwidth", f8, 3),  # rad/s, of f_rest_W along the platform's axes forward, left, up
        # how the platform answers with that joint free (models/floating.py), in B
        ("I_eff", f8, (3, 3)),  # kg m^2, torque over angular acceleration
        ("A", f8, (3, 4)),  # N m per N of force at B and per N m about the joint, see there
        ("L_s", f8, 3),  # kg m, momentum of a unit rate of the joint
        ("M_ws", f8, 3),  # kg m^2, its angular momentum about the origin of B
        ("M_ss", f8),  # kg m^2, inertia about the joint of all that it carries
        # estimate (estimation/wrench.py)
        ("momentum_W", f8, 3),  # N s, as predicted
        ("f_hands_W", f8, 3),  # N, reaction of what the hands press, as their joints measure it
        ("t_hands_B", f8, 3),  # N m, about the origin of B
        ("s_hands", f8),  # N m, about the joint
        ("f_rest_W", f8, 3),  # N, every other external force: wind, payload, errors of the model
        ("momentum_s", f8),  # N m s, of the joint, as predicted
        ("s_rest", f8),  # N m, external torque about the joint besides that of the hands
        ("s_slow", f8),  # N m, the whole external torque, low-passed
        ("balance_rate", f8),  # rad/s, at which the angle moves where the link is in balance
        ("f_swing", f8),  # N, level force at the hands from the swing angle (Suarez 2020, VI-C)
    ]
)
"""External wrench on the robot, and what it does to the platform while a joint swings freely."""
