"""The bus: records that most components of a vehicle read or write.

Units are SI and radians. Frames: W world (ENU), B body (FLU), T tip (z along the probe, out of the
robot), S surface (z = outward normal). All other data between components are an `Output` of the
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
    block: int  # control ticks since random numbers were drawn: row of the blocks
    fast: int  # the same in physics steps
    mask: int  # guards that end a mission tick
    fired: int  # guards that fired
    stop: int  # 1: end the tick at once, before commands reach the plant
    running: int  # row of the schedule in execution
    failed: int  # row that raised
    error: int  # address of its exception, 0: none
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
    """State of the plant; only components of the plant's side may read it."""

    p_WB: Vec3
    R_WB: Mat3
    v_WB: Vec3
    w_WB_B: Vec3  # in B
    p_WT: Vec3  # tip; one physics step old, as are all positions of sites and all forces
    R_WT: Mat3
    f_contact: Vec3  # N, force of the surface on the tip, in W
    f_collision: float  # N, largest unintended contact force since the last sample
    off_s: float  # s, longest time of the tip without force since the last sample


class Reference(Record):
    """Present reference of the platform and a rigid arm; blocks of other components extend it.

    `rules` define how a field is interpolated between the rows of a plan (vehicle/follower.py).
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
    """The state of robot and environment that a law may read."""

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
    f_tip: float  # N, of the tip on the surface, along the probe


class WrenchCommand(Record):
    """Command of the platform's law."""

    f_B: Vec3  # N, force that the rotors must produce, at the origin of B
    t_B: Vec3  # N m
    qd: Annotated[Array, MAX_JOINTS]  # rad/s, joint speeds (output side) of velocity servos
    torque: Annotated[Array, MAX_JOINTS]  # N m, at the joints, of torque servos


class ThrustCommand(Record):
    """Command of a law that determines the rotor thrusts itself, in addition to their wrench.

    The allocation uses them instead of its own, within the rotors' limits.
    """

    thrust: Annotated[Array, MAX_ROTORS]  # N
    given: float  # 1: use thrust; 0: allocate the wrench
    limits: float  # 0: inactive, 1: active, 2: joint limits relaxed, 3: no solution


class ShaftCommand(Record):
    """Command of the law of arms with position servos."""

    theta: Annotated[Array, MAX_JOINTS]  # rad, shaft angles


class Allocated(Record):
    """Result of the allocation at the last control tick."""

    f_B_alloc: Vec3  # N, force of the allocated thrusts
    t_B_alloc: Vec3  # N m
    saturated: float  # 1: the command was reduced


class Drive(Record):
    """A command from the robot's side to the plant: a link transmits it."""


class RotorDrive(Drive):
    """Commanded rotor speeds."""

    speed: Annotated[Array, MAX_ROTORS]  # rad/s


class ServoDrive(Drive):
    """Commanded speeds (rad/s), torques (N m) or angles (rad) of the servos, by joint."""

    motor: Annotated[Array, MAX_JOINTS]


class Setpoint(Drive):
    """Values of an actuator that a mission sets, by column name (vehicle/setpoints.py).

    A record of the component that applies it; a value holds until the next one.
    """
