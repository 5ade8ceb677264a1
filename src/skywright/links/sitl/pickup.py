"""Components of a plant under an autopilot: rotor speeds as input, sensors as output.

The autopilot is on board, so no link of the world delays its data. The robot's own law commands no
rotor: its reference is inactive and it holds the arms, or (links/px4/mission.py) it controls the
arms.
"""

from __future__ import annotations

from typing import Annotated, Any

from skywright.core.record import Array, Mat3, Record, Vec3
from skywright.core.types import MAX_ROTORS
from skywright.vehicle.bus import RotorDrive
from skywright.vehicle.component import Component, InOut, Out, Output, Recorded
from skywright.vehicle.readings import Fix, ImuBatch, MocapSample


class Autopilot(Output):
    """Last state that the autopilot reported, in W and B."""

    heard: float  # 1: its estimate has been received
    p_WB: Vec3  # m
    v_WB: Vec3  # m/s
    R_WB: Mat3
    p_WB_des: Vec3  # m, set-point
    v_WB_des: Vec3  # m/s
    armed: float  # 1: its motors may turn
    command: Annotated[Array, MAX_ROTORS]  # of each rotor, 0 to 1


class RotorPickup(Component):
    """Replaces the robot's rotor speeds by those of the autopilot."""

    slot, side = "actuate", "plant"

    class Me(Record):
        n: int
        speed: Annotated[Array, MAX_ROTORS]  # rad/s

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Store the number of rotors."""
        me.n = len(context.rotors.thrust_min)

    @staticmethod
    def step(me: Me, drive: InOut[RotorDrive]) -> None:
        for i in range(me.n):
            drive.speed[i] = me.speed[i]


class SensorPickup(Component):
    """Sums inertial samples, and keeps the newest pose and fix, until they are read."""

    slot, side = "derive", "plant"

    class Me(Record):
        n: int  # inertial samples since the last reading
        gyro: Vec3  # rad/s, their sum, in B
        accel: Vec3  # m/s^2
        pose: float  # 1: a new pose of motion capture
        pose_t: float  # s
        pose_p: Vec3
        pose_R: Mat3
        fix: float  # 1: a new satellite fix
        fix_t: float  # s
        fix_p: Vec3

    @staticmethod
    def step(me: Me, imu: ImuBatch, mocap: MocapSample | None, fix: Fix | None) -> None:
        for k in range(imu.n):
            for i in range(3):
                me.gyro[i] += imu.gyro[k, i]
                me.accel[i] += imu.accel[k, i]
        me.n += imu.n
        if mocap is not None and mocap.fresh > 0.0:
            me.pose, me.pose_t = 1.0, mocap.t
            for i in range(3):
                me.pose_p[i] = mocap.p_WB[i]
                for j in range(3):
                    me.pose_R[i, j] = mocap.R_WB[i, j]
        if fix is not None and fix.fresh > 0.0:
            me.fix, me.fix_t = 1.0, fix.t
            for i in range(3):
                me.fix_p[i] = fix.p[i]


class AutopilotNotes(Component):
    """Records the autopilot's state beside the truth."""

    slot, side = "derive", "plant"

    class Me(Record):
        heard: float
        p_WB: Vec3
        v_WB: Vec3
        R_WB: Mat3
        p_WB_des: Vec3
        v_WB_des: Vec3
        armed: float
        command: Annotated[Array, MAX_ROTORS]

    columns = (
        Recorded("autopilot_heard", Autopilot, "heard", "", "1: its estimate was received"),
        Recorded("autopilot_p_WB", Autopilot, "p_WB", "m", "autopilot's estimate"),
        Recorded("autopilot_v_WB", Autopilot, "v_WB", "m/s", "autopilot's estimate"),
        Recorded("autopilot_q_WB", Autopilot, "R_WB", "", "autopilot's estimate", rotation=True),
        Recorded("autopilot_p_WB_des", Autopilot, "p_WB_des", "m", "autopilot's set-point"),
        Recorded("autopilot_v_WB_des", Autopilot, "v_WB_des", "m/s", "autopilot's set-point"),
        Recorded("autopilot_armed", Autopilot, "armed", "", "1: armed"),
        Recorded("autopilot_command", Autopilot, "command", "", "of a rotor, 0 to 1", per="rotor"),
    )

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Start without a report."""
        for i in range(3):
            me.R_WB[i, i] = 1.0
        me.p_WB[:] = me.v_WB[:] = me.p_WB_des[:] = me.v_WB_des[:] = float("nan")

    @staticmethod
    def step(me: Me, out: Out[Autopilot]) -> None:
        out.heard, out.armed = me.heard, me.armed
        for i in range(3):
            out.p_WB[i], out.v_WB[i] = me.p_WB[i], me.v_WB[i]
            out.p_WB_des[i], out.v_WB_des[i] = me.p_WB_des[i], me.v_WB_des[i]
            for j in range(3):
                out.R_WB[i, j] = me.R_WB[i, j]
        for i in range(len(out.command)):
            out.command[i] = me.command[i]
