"""Sizes, the rows of a plan, and the records that models share.

Units are SI and radians. Frames: W world (ENU), B body (FLU), T tip (z along the probe, pointing
out of the robot), S surface (z = outward normal). Quaternions are wxyz.
"""

from __future__ import annotations

from typing import Annotated

from skywright.core.record import Array, Mat3, Record, Vec3

MAX_JOINTS = 9
"""Most arm joints of one robot (the long-reach dual arm of Suarez 2020 has 1 passive + 2 x 4)."""
MAX_HANDS = 2
"""Most arms that end in a hand: 0 left (or the only one), 1 right."""
MAX_OBJECTS = 4
"""Most movable things in a world."""
MAX_ROTORS = 12
"""Most rotors of one robot."""


class ReferenceRow(Record):
    """A row of a plan: the references of a control law."""

    t: float  # s, mission time from which this row holds
    p_WB: Vec3  # m, nominal platform position
    v_WB: Vec3  # m/s
    a_WB: Vec3  # m/s^2
    R_WB: Mat3  # nominal platform attitude
    w_WB_B: Vec3  # rad/s, in B
    wd_WB_B: Vec3  # rad/s^2, in B
    q: Annotated[Array, MAX_JOINTS]  # rad, nominal arm joints (output side)
    qd: Annotated[Array, MAX_JOINTS]  # rad/s
    p_WT: Vec3  # m, desired tip position (inside the surface while pushing)
    v_WT: Vec3  # m/s
    R_WT: Mat3  # desired tip attitude
    R_WS: Mat3  # surface frame at the desired tip (identity in free flight)
    dead_zone: float  # m, of the integral along z_S; 0 trims all directions (free flight)
    track_tip: float  # 1: close the position loop at the tip (law 4); 0: at the platform
    active: float  # 1: rotors on; 0: motors off
    # hands of compliant arms (vehicle/arms): one task each, see below
    task: Annotated[Array, MAX_HANDS]
    p_WH: Annotated[Array, MAX_HANDS, 3]  # m, desired hand position
    v_WH: Annotated[Array, MAX_HANDS, 3]  # m/s
    f_WH: Annotated[Array, MAX_HANDS, 3]  # N, force of the hand on the object
    gamma: Annotated[Array, MAX_HANDS]  # weight of force over position in Suarez 2020 (31)
    load: Annotated[Array, MAX_HANDS]  # N, weight that hangs on each hand, fed forward
    tau: Annotated[Array, MAX_JOINTS]  # N m, torque of a joint's spring (18)
    delta: Annotated[Array, MAX_JOINTS]  # (22): 1 output position `q`, 0 torque `tau`
    tare: float  # 1: the present estimated contact forces become zero
    # pressing with a probe that measures its force (laws/backstepping.py)
    press: float  # 1: the arm controls the force, 0: its joints
    force: float  # N, of the tip along the probe's axis
    docked: float  # 1: feet rest on the structure: platform integrals freeze
    f_feet_B: Vec3  # N, planned force of the structure on the docking feet, in B
    t_feet_B: Vec3  # N m, about the origin of B
    mode: float  # MODE_ below


REFERENCE = ReferenceRow.dtype

LINEAR, HOLD, HOLD_END, ROTATION = range(4)
"""How a field is computed between two rows: interpolated; that of the first; that of the first
until the second is reached; or an interpolated rotation."""

(
    TASK_JOINTS, TASK_POSITION, TASK_VELOCITY, TASK_FORCE, TASK_FORCE_POSITION, TASK_SQUEEZE,
    TASK_LOOPS, TASK_VISUAL,
) = range(8)  # fmt: skip
"""Task of a hand in `REFERENCE.task`: joint angles `q`; a straight line to `p_WH` at the speed
|v_WH| (Suarez 2020, 23); the velocity `v_WH` (24); the force `f_WH` along its direction (25)-(28);
both (31); both, with the force |f_WH| towards the other hand (32); the joint loops (14)-(22); a
straight line to the marker, with `p_WH` the hand's position in the marker's frame M."""

MODE_POSE, MODE_STANDARD = 0, 1
"""`REFERENCE.mode` of a fully actuated platform: position and attitude each track their own
reference (the paper's "command position" and "command angle"), or only attitude and height do."""

HISTORY = 64
"""Control ticks of estimate history kept for delayed measurements."""

IMU_BATCH = 32
"""Largest number of inertial samples that reach the controller in one control tick."""
IMU_HISTORY = 512
"""Inertial samples kept for delayed measurements; a power of two."""
