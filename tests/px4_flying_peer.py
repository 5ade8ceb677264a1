"""A peer of PX4's protocol that flies: both its simulator's link and its onboard link.

It stands in for PX4 where the exchange is tested: modes, arming, Offboard, Land. The robot's own
law flies it from motion capture, so figures of its flights say nothing about PX4.
"""

from __future__ import annotations

import socket
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common

import skywright
from px4_peer import Px4Peer
from skywright.core.rotations import rot_z
from skywright.links.mavlink import modes
from skywright.links.mavlink.attitude_target import AttitudeTarget
from skywright.links.mavlink.frames import (
    FRD_FROM_FLU,
    NED_FROM_ENU,
    from_ned_quaternion,
    swap_heading,
    swap_world,
    to_ned_quaternion,
)
from skywright.links.px4.parameters import build_airframe
from skywright.models.nominal import Nominal

POSITION_EVERY = 5  # samples
SINK = 0.5  # m/s, of the mode Land
LAND_S = 2.0  # s on the ground until it disarms


class FlyingPeer(Px4Peer):
    """Flies what its onboard link asks for."""

    def __init__(self, port: int, onboard: int, description: Any, **kwargs: Any) -> None:
        """`onboard` is the UDP port to which it speaks."""
        super().__init__(port, command=self._command, **kwargs)
        self.robot, self.world = description.robot, description.world
        nominal = Nominal(self.robot, self.world)
        self.rotors, self.P = nominal.rotors, nominal.allocator.P
        self.law = skywright.build_law(description)
        self.airframe = build_airframe(self.robot, self.world)
        self.mode, self.refuses = modes.HOLD, ""
        self.set_points: list[Any] = []
        self.commanded: list[tuple[int, float]] = []
        self.land_z, self.low_s = 0.0, 0.0
        self.silent: Any = lambda t: False
        self._onboard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._onboard.setblocking(False)
        self._to = ("127.0.0.1", onboard)
        self._heard = common.MAVLink(None)
        self._heard.robust_parsing = True
        self._out = common.MAVLink(None, 1, 1)
        self.p, self.R = np.zeros(3), np.eye(3)

    def stop(self) -> None:
        super().stop()
        self._onboard.close()

    @property
    def t(self) -> float:
        """Its clock, s."""
        return 1e-6 * self.times[-1] if self.times else 0.0

    # --- the simulator's link ----------------------------------------------------------------

    def _take_sample(self, s: socket.socket, m: Any) -> bool:
        pose = self.newest.get("ODOMETRY")
        if pose is not None:
            self.p = NED_FROM_ENU @ np.array([pose.x, pose.y, pose.z])
            R = from_ned_quaternion(np.array(pose.q))
            self.R = self.R if R is None else R
        if self.seen > 0:
            self._serve_onboard()
        return super()._take_sample(s, m)

    def _command(self, _: Any) -> np.ndarray:
        truth = self.newest["HIL_STATE_QUATERNION"]
        est, ref = self.law.estimate, self.law.reference
        est.p_WB, est.R_WB = self.p, self.R
        est.v_WB = NED_FROM_ENU @ (0.01 * np.array([truth.vx, truth.vy, truth.vz]))
        rates = [truth.rollspeed, truth.pitchspeed, truth.yawspeed]
        est.w_WB_B = FRD_FROM_FLU @ np.array(rates)
        ref.active = 1.0
        if self.mode == modes.LAND:
            self.land_z -= SINK * 0.004
            ref.p_WB[2], ref.v_WB, ref.a_WB = self.land_z, 0.0, 0.0
            down = self.p[2] < self.robot.platform.gear_height_m + 0.05
            self.low_s = self.low_s + 0.004 if down else 0.0
            if self.low_s > LAND_S:
                self.armed = False
        asked = self.law.step()
        wrench = np.concatenate([asked.f_B, asked.t_B])
        thrust = np.clip(self.P @ wrench, self.rotors.thrust_min, self.rotors.thrust_max)
        return np.sqrt(np.maximum(thrust, 0.0) / self.rotors.thrust_max)

    # --- the onboard link --------------------------------------------------------------------

    def _serve_onboard(self) -> None:
        if self.silent(self.t):
            while self._read() is not None:
                pass
            return
        while (data := self._read()) is not None:
            for m in self._heard.parse_buffer(data) or []:
                self._take(m)
        if self.seen % POSITION_EVERY == 0:
            self._tell()

    def _read(self) -> bytes | None:
        try:
            return self._onboard.recv(4096)
        except OSError:
            return None

    def _say(self, m: Any) -> None:
        try:
            self._onboard.sendto(m.pack(self._out), self._to)
        except OSError:
            return
        self._out.seq = (self._out.seq + 1) % 256

    def _tell(self) -> None:
        ms = round(1e3 * self.t)
        truth = self.newest.get("HIL_STATE_QUATERNION")
        if truth is None or "ODOMETRY" not in self.newest:
            return
        centre = swap_world(self.p + self.R @ self.airframe.p_BC)
        v = 0.01 * np.array([truth.vx, truth.vy, truth.vz])
        rates = (truth.rollspeed, truth.pitchspeed, truth.yawspeed)
        self._say(common.MAVLink_local_position_ned_message(ms, *centre, *v))
        q = to_ned_quaternion(self.R)
        self._say(common.MAVLink_attitude_quaternion_message(ms, *q, *rates))
        if self.seen % (10 * POSITION_EVERY) == 0:
            base = 1 | (128 if self.armed else 0)
            self._say(common.MAVLink_heartbeat_message(13, 12, base, self.mode.custom, 4, 3))
            self._say(
                common.MAVLink_estimator_status_message(
                    self.times[-1], 0x337, 0, 0, 0, 0, 0, 0, 0.01, 0.01
                )
            )
            self._say(
                common.MAVLink_sys_status_message(0, 0, 0, 0, 12000, -1, 90, 0, 0, 0, 0, 0, 0)
            )

    def _take(self, m: Any) -> None:
        kind = m.get_type()
        if kind == "COMMAND_LONG":
            self.commanded.append((m.command, m.param1))
            self._say(common.MAVLink_command_ack_message(m.command, self._do(m)))
            if m.command == 512 and m.param1 == 148:
                self._say(
                    common.MAVLink_autopilot_version_message(
                        0, 1 << 24 | 14 << 16, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
                    )
                )
        elif kind == "TIMESYNC" and m.tc1 == 0:
            self._say(common.MAVLink_timesync_message(round(1e9 * self.t), m.ts1))
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            self.set_points.append(m)
            self._follow(m)
        elif kind == "SET_ATTITUDE_TARGET":
            self.set_points.append(AttitudeTarget.read(m))

    def _do(self, m: Any) -> int:
        if m.command == 176:
            mode = modes.Mode(int(m.param2), int(m.param3))
            if mode == modes.OFFBOARD and not self.set_points:
                return 1
            self.mode, self.land_z = mode, float(self.p[2])
        elif m.command == 400 and m.param1 == 1.0 and (self.refuses or not self.arm()):
            text = (self.refuses or "; ".join(self.refusals)).encode()
            self._say(common.MAVLink_statustext_message(4, text))
            return 1
        return 0

    def _follow(self, m: Any) -> None:
        if self.mode != modes.OFFBOARD:
            return
        ref = self.law.reference
        R = rot_z(swap_heading(m.yaw))
        ref.R_WB = R
        ref.p_WB = swap_world(np.array([m.x, m.y, m.z])) - R @ self.airframe.p_BC
        ref.v_WB = swap_world(np.array([m.vx, m.vy, m.vz]))
        ref.a_WB = swap_world(np.array([m.afx, m.afy, m.afz]))
