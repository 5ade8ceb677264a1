"""The bus: the few records that most components of a vehicle read or write.

Units are SI and radians. Frames: W world (ENU), B body (FLU), T tip (z along the probe, out of the
robot), S surface (z = outward normal). All else that components exchange is an `Output` of the
component that fills it.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

from skywright.core.record import Array, Mat3, Record, Vec3
from skywright.core.types import HOLD, HOLD_END, MAX_JOINTS, MAX_ROTORS, ROTATION
from skywright.models.body_records import Body as Body


class Clock(Record):
    """Time and control of the schedule; a guard sets bits of `fired`."""

    t: float  # s, mission time of this control tick
    tick: int  # control ticks since the start
    dt: float  # s, control period
    h: float  # s, physics step
    block: int  # control ticks since random numbers were drawn: a row of every block
    fast: int  # the same in physics steps
    mask: int  # guards that end a mission tick
    fired: int  # guards that did
    stop: int  # 1: end the tick at once, before commands reach the plant
    running: int  # row of the schedule that runs now
    failed: int  # row that raised
    error: int  # address of what it raised, 0: none
    phase: int  # index into the run's phases


class MuJoCo(Record):
    """Addresses and sizes of MuJoCo's arrays; read them with `words` and `table`."""

    qpos: int
    nq: int
    qvel: int
    nv: int
    sensordata: int
    nsensor: int
    site_xpos: int
    site_xmat: int
    nsite: int
    body_xpos: int
    body_xmat: int
    xfrc: int
    nbody: int
    ctrl: int
    nu: int
    act: int
    na: int
    actuator_force: int
    pair_friction: int
    npair: int


class Truth(Record):
    """State of the plant; only components of the plant's side may ask for it."""

    p_WB: Vec3
    R_WB: Mat3
    v_WB: Vec3
    w_WB_B: Vec3  # in B
    p_WT: Vec3  # tip; one physics step old, as all positions of sites and all forces
    R_WT: Mat3
    f_contact: Vec3  # N, force of the surface on the tip, in W
    f_collision: float  # N, largest unintended contact force since the last sample
    off_s: float  # s, for which the tip has been without force, largest since the last sample


class Reference(Record):
    """What the platform and a rigid arm shall do now; blocks of other components come beside.

    `rules` say how a field is interpolated between the rows of a plan (vehicle/follower.py).
    """

    rules: ClassVar[dict[str, int]] = {
        "track_tip": HOLD, "active": HOLD, "mode": HOLD, "dead_zone": HOLD_END,
        "R_WB": ROTATION, "R_WT": ROTATION, "R_WS": ROTATION,
    }  # fmt: skip

    t: float  # s
    p_WB: Vec3
    v_WB: Vec3
    a_WB: Vec3
    R_WB: Mat3
    w_WB_B: Vec3
    wd_WB_B: Vec3
    q: Annotated[Array, MAX_JOINTS]
    qd: Annotated[Array, MAX_JOINTS]
    p_WT: Vec3
    v_WT: Vec3
    R_WT: Mat3
    R_WS: Mat3  # surface frame at the desired tip (identity in free flight)
    dead_zone: float  # m, of the integral along z_S; 0 trims all directions
    track_tip: float  # 1: close the position loop at the tip; 0: at the platform
    active: float  # 1: rotors on
    mode: float  # MODE_ of core/types.py


class Estimate(Record):
    """What a law may see of the world."""

    t: float
    p_WB: Vec3
    v_WB: Vec3
    R_WB: Mat3
    w_WB_B: Vec3
    q: Annotated[Array, MAX_JOINTS]
    qd: Annotated[Array, MAX_JOINTS]
    p_WT: Vec3
    v_WT: Vec3
    R_WT: Mat3
    f_ext_W: Vec3  # N, estimated external force (wind, contact, error of the model)
    f_tip: float  # N, of the tip on what it touches, along the probe


class WrenchCommand(Record):
    """What the platform's law commands."""

    f_B: Vec3  # N, force that the rotors shall make, at the origin of B
    t_B: Vec3  # N m
    qd: Annotated[Array, MAX_JOINTS]  # rad/s, joint speeds (output side) of velocity servos
    torque: Annotated[Array, MAX_JOINTS]  # N m, at the joints, of torque servos


class ThrustCommand(Record):
    """What a law that chooses the rotors' thrusts itself commands, beside the wrench they are for.

    The allocation takes them in place of its own, within the rotors' limits.
    """

    thrust: Annotated[Array, MAX_ROTORS]  # N
    given: float  # 1: hold now; 0: allocate the wrench
    limits: float  # 0: none binds, 1: some do, 2: joint limits had to give way, 3: no solution


class ShaftCommand(Record):
    """What the law of arms with position servos commands."""

    theta: Annotated[Array, MAX_JOINTS]  # rad, shaft angles


class Allocated(Record):
    """What the allocation made of the command of the last control tick."""

    f_B_alloc: Vec3  # N, what the allocated rotors can really make
    t_B_alloc: Vec3  # N m
    saturated: float  # 1: something had to be given up


class Drive(Record):
    """What the robot's side tells the plant: it goes down a link."""


class RotorDrive(Drive):
    """Rotor speeds as the robot is told."""

    speed: Annotated[Array, MAX_ROTORS]  # rad/s


class ServoDrive(Drive):
    """What the servos are told: speeds of motors (rad/s), their torques (N m), or angles (rad)."""

    motor: Annotated[Array, MAX_JOINTS]


class Setpoint(Drive):
    """What a mission sets of an actuator, by the names of its columns (vehicle/setpoints.py).

    A record of the component that acts on it; a value holds until another one is set.
    """
