"""The records that cross role boundaries every tick.

They are NumPy structured types of fixed size, so that numba compiles every law, estimator and
sensor against one signature a role, whatever the robot (design: one flat signature a role,
typed views inside). `record[0]` is a view with named fields, in Python and in compiled code.

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

ESTIMATE = np.dtype(
    [
        ("t", f8),
        ("p_WB", f8, 3),
        ("v_WB", f8, 3),
        ("R_WB", f8, (3, 3)),
        ("w_WB_B", f8, 3),
        ("q", f8, MAX_JOINTS),
        ("qd", f8, MAX_JOINTS),
        ("p_WT", f8, 3),
        ("v_WT", f8, 3),
        ("R_WT", f8, (3, 3)),
        ("f_ext_W", f8, 3),  # N, estimated external force (wind, contact, error of the model)
        ("f_tip", f8),  # N, of the tip on what it touches, along the probe
    ]
)
"""What a control law may see of the world."""

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

COMMAND = np.dtype(
    [
        ("f_B", f8, 3),  # N, force that the rotors shall make, in B at the origin of B
        ("t_B", f8, 3),  # N m
        ("qd", f8, MAX_JOINTS),  # rad/s, joint velocity commands (output side), velocity servos
        ("theta", f8, MAX_JOINTS),  # rad, shaft angle commands, position servos
        ("rotor_speed", f8, MAX_ROTORS),  # rad/s, filled by the allocation
        ("f_B_alloc", f8, 3),  # N, what the allocated rotors can really make
        ("t_B_alloc", f8, 3),
        ("saturated", f8),  # 1 when the allocation had to give something up
    ]
)
"""What a law commands (wrench and joint velocities) and what the allocation made of it."""

PARAMETERS = np.dtype(
    [
        ("dt", f8),  # s, control period
        ("wn_p", f8),  # rad/s, position bandwidth
        ("zeta_p", f8),
        ("wi_p", f8),  # rad/s, integral
        ("wn_R", f8),  # rad/s, attitude bandwidth
        ("zeta_R", f8),
        ("wi_R", f8),
        ("k_arm", f8),  # 1/s, joint position loop around the velocity servos
        ("friction", f8),  # believed coefficient of the surface, fed forward while sliding
        ("tilt_max", f8),  # rad, of laws that tilt to move
        ("thrust_max", f8),  # N, all rotors together along z_B
        ("f_integral_max", f8),  # N, limit of the position integral
        ("t_integral_max", f8),  # N m, limit of the attitude integral
        ("belt", f8, (MAX_JOINTS, MAX_JOINTS)),  # J_AM
        ("belt_inv", f8, (MAX_JOINTS, MAX_JOINTS)),
        ("motor_speed_max", f8, MAX_JOINTS),
        # cascade (control/cascade.py); axes of the platform: forward, left, up
        ("k_position", f8, 3),  # 1/s, velocity asked for a metre of error
        ("k_velocity", f8, 3),  # 1/s, acceleration asked for 1 m/s of error
        ("k_swing", f8),  # m/s^2 against 1 rad/s of a passive joint's swing
        ("k_attitude", f8, 3),  # 1/s, rate asked for a radian of error about the axes of B
        ("k_rate", f8, 3),  # 1/s, angular acceleration asked for 1 rad/s of error
        ("k_integral", f8, 3),  # 1/s, of the torque about the axes of B
        ("lead", f8),  # s, what is left of the rotors' lag
        ("rotor_tau", f8),  # s, believed rotor lag
        ("speed_max", f8),  # m/s, asked for by the position loop
        # backstepping (control/backstepping.py)
        ("k_p", f8, 3),  # k_1, k_2 (1/s) and lambda (1/s^2) of the position
        ("k_R", f8, 3),  # the same of the attitude
        ("k_force", f8),  # 1/s, of the arm's force loop
        ("spring", f8),  # N/m, of a probe with a force sensor; 0: none
        ("slider", f8),  # kg, of the bar between the probe's spring and its tip
        ("user", f8, 32),  # for laws named by file
    ]
)
"""Parameters of a control law; they follow from the bandwidths in the robot file."""

MEMORY = np.dtype([("sigma", f8, 3), ("theta", f8, 3), ("lead", f8, 3), ("user", f8, 64)])
"""Memory of a control law: position integral (N) in W, attitude integral (N m) in B, the lagging
part of the torque (N m) of the cascade's lead, scratch."""

HISTORY = 64
"""Control ticks of estimate history kept for delayed measurements."""

IMU_BATCH = 32
"""Most inertial samples that reach the controller in one control tick."""
IMU_HISTORY = 512
"""Inertial samples kept for delayed measurements; a power of two."""

MEASUREMENT = np.dtype(
    [
        ("t", f8),  # s, when the newest of this was measured
        ("imu_n", i8),  # inertial samples that came this tick, oldest first
        ("imu_gyro", f8, (IMU_BATCH, 3)),  # rad/s, in B, mean over the sample's period
        ("imu_accel", f8, (IMU_BATCH, 3)),  # m/s^2, specific force at the unit, in B
        ("gyro", f8, 3),  # rad/s, in B, mean of this tick's samples
        ("q", f8, MAX_JOINTS),  # rad, encoders on the servos' shafts (passive joints: on the joint)
        ("qd", f8, MAX_JOINTS),
        ("deflection", f8, MAX_JOINTS),  # rad, shaft minus output link, where it is measured
        ("mocap_fresh", f8),  # 1 when the fields below are new this tick
        ("mocap_t", f8),  # s, of the exposure
        ("mocap_age", f8),  # s, since the exposure
        ("mocap_period", f8),  # s, since the previous delivered sample
        ("p_WB", f8, 3),
        ("R_WB", f8, (3, 3)),
        ("p_WT", f8, 3),
        ("axis_W", f8, 3),  # probe axis
        ("marker_fresh", f8),  # 1 when the camera's marker pose below is new this tick
        ("p_BM", f8, 3),  # m
        ("R_BM", f8, (3, 3)),
        ("p_WM", f8, 3),  # m, the marker by motion capture, new with mocap_fresh
        ("R_WM", f8, (3, 3)),
        ("p_WP", f8, 3),  # m, a tracked pipe likewise
        ("R_WP", f8, (3, 3)),
        ("force", f8),  # N, of the probe's force sensor
        # without motion capture (world.localisation)
        ("fix_fresh", f8),  # 1 when new this tick: where a point of the robot was (`flt.p_BF`,
        #                     `fus.p_BP`), by satellites or a total station
        ("fix_t", f8),  # s, for which it holds, by the clock of what measured
        ("fix_p", f8, 3),  # m, in W
        ("fix_heading", f8),  # rad, of B's x axis, by satellites
        ("odo_fresh", f8),  # 1: new; tracking camera, in its own frame C
        ("odo_t", f8),
        ("odo_p", f8, 3),
        ("odo_R", f8, (3, 3)),
        ("range_fresh", f8),  # 1: new; distance below the robot
        ("range_t", f8),
        ("range", f8),  # m
    ]
)
"""What the sensors say this tick."""

OBSERVER = np.dtype(
    [
        ("bandwidth", f8),  # rad/s
        ("rotor_tau", f8),  # s, believed rotor lag
        ("f_B", f8, 3),  # N, rotor force believed to act now
        ("bias", f8, 3),  # rad/s, gyroscope
        ("c_B", f8, 3),  # m, tip correction (kinematic error, flexibility, spring)
        ("ready", f8),
        ("head", i8),
        ("p", f8, (HISTORY, 3)),
        ("R", f8, (HISTORY, 3, 3)),
        ("p_BT", f8, (HISTORY, 3)),
    ]
)
"""Parameters and memory of the plain observer."""

FILTER = np.dtype(
    [
        # parameters
        ("h", f8),  # s, period of the inertial unit
        ("p_BI", f8, 3),  # m, its place in B
        ("q_v", f8),  # (m/s^2)^2/Hz, noise density of the accelerometer, squared
        ("q_R", f8),  # (rad/s)^2/Hz, of the gyroscope
        ("q_ba", f8),  # of the biases' walks
        ("q_bg", f8),
        ("p_ba", f8),  # variance of the turn-on biases
        ("p_bg", f8),
        ("r_p", f8),  # m^2, motion capture
        ("r_R", f8),  # rad^2
        ("p_BF", f8, 3),  # m, the point that fixes are of
        ("r_fix", f8, 3),  # m^2, of a fix
        ("r_heading", f8),  # rad^2, of its heading; 0: it has none
        ("vibration_v", f8),  # (m/s)^2, shaking of the unit on its mount
        ("vibration_R", f8),  # rad^2
        ("q_c", f8),  # m^2/s, walk of the tip's correction
        ("r_c", f8),  # m^2, of a tip sample
        # the newest state, at the inertial unit
        ("t", f8),  # s
        ("p", f8, 3),
        ("v", f8, 3),
        ("R", f8, (3, 3)),
        ("a_W", f8, 3),  # m/s^2
        # the horizon: the last exposure
        ("p_f", f8, 3),
        ("v_f", f8, 3),
        ("R_f", f8, (3, 3)),
        ("bg", f8, 3),  # rad/s
        ("ba", f8, 3),  # m/s^2
        ("P", f8, (15, 15)),  # of (p, v, attitude in W, bg, ba)
        ("ready", f8),  # 0: no sample yet, 1: one sample, 2: running
        ("n", i8),  # inertial samples so far
        ("n_f", i8),  # of them within the horizon
        ("gyro", f8, (IMU_HISTORY, 3)),
        ("accel", f8, (IMU_HISTORY, 3)),
        ("p_BT", f8, (IMU_HISTORY, 3)),
        # tip
        ("c_B", f8, 3),  # m, correction
        ("P_c", f8),  # m^2, its variance an axis
        ("good_p_WT", f8, 3),  # last accepted tip sample
        ("good_axis_W", f8, 3),
        ("tip_last", f8, 3),
        ("tip_row", i8),
        # what the gate saw
        ("nu", f8, 6),  # innovation over its standard deviation (whitened), last fused sample
        ("nis", f8),  # its square, last sample
        ("fused", i8),
        ("rejected", i8),
        ("tip_rejected", i8),
        ("rejected_row", i8),
        ("last_p", f8, 3),
        ("last_R", f8, (3, 3)),
    ]
)
"""Parameters and memory of the error-state Kalman filter."""

N_FUSION = 24
PENDING = 128
"""Samples of a sensor that may wait for the horizon."""

FUSION = np.dtype(
    [
        # parameters
        ("lag", f8),  # s, how far the horizon is behind
        ("p_BP", f8, 3),  # m, prism
        ("R_WC", f8, (3, 3)),  # frame and scale of the camera as calibrated
        ("scale", f8),  # m of a unit of the camera
        ("clock", f8),  # s, station's clock ahead of the robot's, as calibrated
        ("r_fix", f8),  # m^2
        ("r_odo", f8),  # m^2
        ("r_odo_R", f8),  # rad^2
        ("r_range", f8),  # m^2
        ("q_walk_m", f8),  # m^2 a metre of path, of the camera's drift
        ("q_walk_s", f8),  # m^2/s
        ("q_yaw", f8),  # rad^2/s, of the camera's frame
        ("q_tilt", f8),
        ("q_scale", f8),  # 1/s
        ("std_0", f8, 4),  # at the start: tilt, heading (rad), scale, clock (s)
        ("bias_0", f8),  # m, of the range finder
        # state beyond FILTER's, at its horizon
        ("drift", f8, 3),  # m, of the aligned camera
        ("T", f8, (3, 3)),  # rotation of the aligned camera against the truth
        ("growth", f8),  # log of its scale against the truth
        ("range_bias", f8),  # m
        ("delay", f8),  # s, station's clock beyond `clock`
        ("P", f8, (N_FUSION, N_FUSION)),
        # samples that wait
        ("fix_n", i8),  # received, modulo PENDING the place of the next one
        ("fix_used", i8),
        ("fix_t", f8, PENDING),
        ("fix_p", f8, (PENDING, 3)),
        ("odo_n", i8),
        ("odo_used", i8),
        ("odo_t", f8, PENDING),
        ("odo_p", f8, (PENDING, 3)),
        ("odo_R", f8, (PENDING, 3, 3)),
        ("range_n", i8),
        ("range_used", i8),
        ("range_t", f8, PENDING),
        ("range", f8, PENDING),
        # what became of them
        ("last_fix", f8),  # s, stamp of the newest fix that was fused
        ("fixes", i8),
        ("rejected", i8),
        ("rejected_row", i8),
        ("late", i8),  # came after the horizon had passed
        ("jumps", i8),  # of the camera
    ]
)
"""Total station, tracking camera and range finder beside the inertial unit
(estimation/station_camera.py)."""

ARMS = np.dtype(
    [
        # parameters
        ("on", i8),  # 1: position servos and compliant joints; 0: nothing here is used
        ("dt", f8),  # s, period of the arms' law
        ("n_hands", i8),
        ("n", i8),  # joints an arm
        ("chain", i8),  # 1: pitch, roll, yaw, elbow, of which inverse kinematics are known
        ("first", i8, MAX_HANDS),  # index of each arm's first joint in q
        ("swing", i8),  # index of the passive joint that carries the arms in q, -1: none
        ("k", f8, MAX_JOINTS),  # N m/rad, springs of the joints; 0: rigid
        ("d", f8, MAX_JOINTS),  # N m s/rad
        ("linear", f8, MAX_JOINTS),  # rad, range of the linear spring; 0: no end
        ("hardening", f8, MAX_JOINTS),  # stiffness beyond it over k; a stop counts as 10
        ("slack", f8, MAX_JOINTS),  # rad, half the play of the servo's gear, in the deflection
        ("sensed", f8, MAX_JOINTS),  # 1: the deflection is measured
        ("q_min", f8, MAX_JOINTS),  # rad, of the output links
        ("q_max", f8, MAX_JOINTS),
        ("servo_tau", f8),  # s, T_s of (17)
        ("speed_max", f8),  # rad/s, of the servos
        ("upper", f8),  # m, upper arm
        ("fore", f8),  # m, forearm with the hand
        ("pad", f8, MAX_HANDS),  # m, from the hand's end back to its ball's centre
        ("marker_mocap", f8),  # 1: the marker is measured by motion capture, not by a camera
        ("pipe_mocap", f8),  # 1: motion capture tracks the pipe
        ("p_BS", f8, (MAX_HANDS, 3)),  # m, shoulders, in B (where a passive link carries them:
        #                                in the frame of that link)
        ("estimator", f8),  # of the contact force: 0 Suarez 2020 (26), 1 joint torques
        ("kp_torque", f8),  # gains of (19) and (21)
        ("ki_torque", f8),
        ("kp_position", f8),
        ("ki_position", f8),
        ("ki_force", f8),  # rad/s, of the force loop
        ("ki_hold", f8),  # rad/s, of the hand's position while it exerts a force
        ("stall", f8, MAX_JOINTS),  # N m, of the servos
        ("speed_hand", f8),  # m/s, v of (23) where the reference gives none
        ("tare", f8, (MAX_HANDS, 3)),  # N, subtracted from the estimated force, in W
        # state of this tick, filled before the arms' law (models/compliant_arms.py)
        ("t_gravity", f8, MAX_JOINTS),  # N m, torque that the joints carry at rest in free air
        ("deflection", f8, MAX_JOINTS),  # rad, theta - q: measured, or that of t_gravity
        ("p_BH", f8, (MAX_HANDS, 3)),  # m, hands in B, at the output links
        ("R_BH", f8, (MAX_HANDS, 3, 3)),
        ("J_BH", f8, (MAX_HANDS, 3, MAX_JOINTS)),  # m/rad, in B
        ("J_BP", f8, (MAX_HANDS, 3, MAX_JOINTS)),  # m/rad, of the ball's centre, where forces act
        ("p_BH_stiff", f8, (MAX_HANDS, 3)),  # m, hands if the joints were rigid: FK(theta)
        ("p_BA", f8, 3),  # m, frame A of the arms' base: B, or the passive link's
        ("R_BA", f8, (3, 3)),
        ("p_WH", f8, (MAX_HANDS, 3)),  # m, estimated hands
        ("v_WH", f8, (MAX_HANDS, 3)),  # m/s, of the platform's motion and the joints'
        ("f_WH", f8, (MAX_HANDS, 3)),  # N, estimated force that each hand exerts
        ("manipulability", f8, MAX_HANDS),  # m^2, sin of the elbow times upper times fore
        ("lever", f8, MAX_HANDS),  # m, speed of the hand in the task's direction over the joints'
        ("singular", f8, MAX_HANDS),  # 1: too near a singularity for that direction
        ("shift_W", f8, (MAX_HANDS, 3)),  # m, platform move that bends the elbow again
        ("p_WM", f8, 3),  # m, estimated marker (vehicle/arms/marker.py)
        ("R_WM", f8, (3, 3)),
        ("marker_age", f8),  # s, since it was last seen
        ("p_WP", f8, 3),  # m, estimated pipe
        ("R_WP", f8, (3, 3)),
        ("pipe_samples", f8),  # in the mean, 0: none came yet
        # memory of the arms' law
        ("theta_ref", f8, MAX_JOINTS),  # rad, last command
        ("shaft", f8, MAX_JOINTS),  # rad, shafts as (17) says of the commands
        ("q_goal", f8, MAX_JOINTS),  # rad, what it would bring the links to in free air, unwound
        ("wind", f8, MAX_JOINTS),  # rad, by which shafts lead for the force of a hand
        ("w_goal", f8, MAX_JOINTS),  # rad a period, speed of the servos' profiles
        ("i_torque", f8, MAX_JOINTS),  # rad, integral part of (19)
        ("i_position", f8, MAX_JOINTS),  # rad, of (21)
        ("p_ref", f8, (MAX_HANDS, 3)),  # m, where the hand would be without contact, in W
        ("v_ref", f8, (MAX_HANDS, 3)),  # m/s, at which it moves
        ("task_last", f8, MAX_HANDS),
        ("saturated", f8, MAX_HANDS),  # 1: a limit of angle or workspace holds the hand back
        ("user", f8, 32),
    ]
)
"""The compliant arms as the controller believes them: parameters, state and memory."""

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
        # estimate (vehicle/arms/external_wrench.py)
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

BELIEF = np.dtype(
    [
        ("t", f8),  # s, mission time of this tick
        ("table_t0", f8),  # s, mission time at which the tracked reference table starts
        ("cursor", i8),  # row of the table in use
        ("par", PARAMETERS),
        ("mem", MEMORY),
        ("ref", REFERENCE),
        ("meas", MEASUREMENT),
        ("obs", OBSERVER),
        ("flt", FILTER),
        ("fus", FUSION),
        ("est", ESTIMATE),
        ("body", BODY),
        ("arms", ARMS),
        ("wrench", WRENCH),
        ("cmd", COMMAND),
    ]
)
"""Everything that the controller side holds: the one argument of a law and of an estimator."""

_POSE = (("p_WO", 3), ("q_WO", 4))

SAMPLE = np.dtype(
    [
        ("t", f8),
        ("phase", i8),  # index into the run's phase list
        # truth (the plant)
        ("p_WB", f8, 3),
        ("q_WB", f8, 4),
        ("v_WB", f8, 3),
        ("w_WB_B", f8, 3),
        ("q", f8, MAX_JOINTS),
        ("qd", f8, MAX_JOINTS),
        ("p_WT", f8, 3),
        ("q_WT", f8, 4),
        ("rotor_thrust", f8, MAX_ROTORS),  # N
        ("rotor_speed", f8, MAX_ROTORS),  # rad/s
        ("spring", f8),  # m, compression of the probe's spring
        ("gap", f8),  # m, tip to surface; negative is penetration
        ("gap_max", f8),  # m, worst since the last sample
        ("tilt", f8),  # rad, probe axis to the inward normal of the surface
        ("f_contact", f8, 3),  # N, force of the surface on the tip, in W
        ("f_normal", f8),  # N, its normal part
        ("f_collision", f8),  # N, largest unintended contact force since the last sample
        ("f_wind_W", f8, 3),  # N, aerodynamic drag force on the robot
        ("power", f8),  # W, electrical
        # belief
        ("est_p_WB", f8, 3),
        ("est_q_WB", f8, 4),
        ("est_v_WB", f8, 3),
        ("est_w_WB_B", f8, 3),
        ("est_p_WT", f8, 3),
        ("est_f_ext_W", f8, 3),
        # reference and command
        ("ref_p_WB", f8, 3),
        ("ref_q_WB", f8, 4),
        ("ref_q", f8, MAX_JOINTS),
        ("ref_p_WT", f8, 3),
        ("ref_q_WT", f8, 4),
        ("ref_normal_W", f8, 3),  # outward surface normal at the desired tip (zero in free flight)
        ("cmd_f_B", f8, 3),
        ("cmd_t_B", f8, 3),
        ("cmd_qd", f8, MAX_JOINTS),
        ("saturated", f8),
        # eddy-current instrument, its own units; and the tip as motion capture measured it
        ("ec", f8, 2),
        ("meas_p_WT", f8, 3),
        ("meas_axis_W", f8, 3),  # measured probe axis (z_T) in W
        # compliant arms: shafts, springs, hands (truth, belief, reference)
        ("theta", f8, MAX_JOINTS),  # rad, servo shafts
        ("deflection", f8, MAX_JOINTS),  # rad, theta - q
        ("cmd_theta", f8, MAX_JOINTS),  # rad
        *[
            (f"{side}_{name}", f8, n)
            for side in ("left", "right")
            for name, n in (
                ("p_WH", 3),
                ("q_WH", 4),
                ("f_W", 3),  # N, force that the hand exerts on what it touches
                ("est_p_WH", 3),
                ("est_f_W", 3),
                ("ref_p_WH", 3),
                ("ref_f_W", 3),
            )
        ],
        # wrench of arms or link on the platform, and what hits pads (vehicle/observers/gauges.py)
        ("load_f_B", f8, 3),  # N, beyond the wrench that is counted from
        ("load_t_B", f8, 3),  # N m, about the origin of B
        ("load_f_peak", f8),  # N, largest size since the last sample (at 1 kHz)
        ("load_t_peak", f8),  # N m
        ("pad_f_W", f8, 3),  # N, contact force on the pads
        ("pad_f_peak", f8),  # N
        ("pad_impulse_W", f8, 3),  # N s, so far
        ("pad_touch_s", f8),  # s in contact so far
        # probe with a force sensor, docking gear
        ("force_meas", f8),  # N, as the sensor says, less the slider's weight
        ("ref_force", f8),  # N
        ("pressing", f8),  # 1: the arm controls the force
        ("docked", f8),  # 1: the feet shall rest on the structure
        ("f_docking_W", f8, 3),  # N, force of the structure on the docking feet
        # operator at a stick (run/operator.py)
        ("operator_stick", f8, 3),  # each axis from -1 to 1
        ("operator_button", f8),  # 1: pressed
        # localisation without motion capture
        ("fix_age", f8),  # s, since the newest fix of the total station that was used
        ("pose_std", f8),  # m, largest of the estimated position's axes
        # movable things of the world
        *[(f"object{i}_{n}", f8, k) for i in range(MAX_OBJECTS) for n, k in _POSE],
    ]
)
"""One sample of a recording (100 Hz): truth, belief, reference, command and instrument."""
