"""Telemetry of a simulated robot: messages from its estimate.

The messages contain no truth: position, attitude and battery are those of the robot's computer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.description.world.origin import Origin
from skywright.errors import InputError
from skywright.links.mavlink import modes
from skywright.links.mavlink.frames import (
    find_heading,
    swap_body,
    swap_heading,
    swap_world,
    to_ned_quaternion,
)
from skywright.links.mavlink.heard import PX4
from skywright.links.mavlink.robot import Robot
from skywright.links.mavlink.setpoints import Scale
from skywright.vehicle.bus import RotorDrive, WrenchCommand
from skywright.vehicle.commands import State
from skywright.vehicle.geodesy import to_geodetic
from skywright.vehicle.interface import Backend
from skywright.vehicle.preflight import read_charge

Array = NDArray[np.float64]

VERSION = 1 << 24 | 14 << 16 | 0 << 8 | 255
"""flight_sw_version: 1.14.0, the release with this interface."""
NAME = b"skywrigt"
"""flight_custom_version: the actual software, in the eight bytes of the field."""
CAPABILITIES = 2 | 8 | 16 | 64 | 128 | 256 | 2048 | 8192
"""PARAM_FLOAT, COMMAND_INT, PARAM_ENCODE_BYTEWISE, SET_ATTITUDE_TARGET,
SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT, FLIGHT_TERMINATION, MAVLINK2."""
SENSORS = 0x1 | 0x2 | 0x4 | 0x20 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000 | 0x200000 | 0x2000000
"""SYS_STATUS: gyroscope, accelerometer, heading, position, rates, attitude, yaw, height, motors,
AHRS, battery."""
PREARM, BATTERY = 0x10000000, 0x2000000
LANDED, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
LANDED_STATES = {
    State.UNINITIALIZED: 0, State.LANDED_DISARMED: LANDED, State.LANDED_ARMED: LANDED,
    State.TAKING_OFF: TAKING_OFF, State.FLYING_AUTO: IN_AIR, State.FLYING_MANUAL: IN_AIR,
    State.LANDING: LANDING,
}  # fmt: skip
ESTIMATED = 0x1 | 0x2 | 0x4 | 0x8 | 0x10 | 0x20 | 0x100 | 0x200
"""ESTIMATOR_STATUS: attitude, velocities, relative and absolute positions, their predictions."""
UNKNOWN_16, UNKNOWN_32 = 65535, 2**32 - 1
RATES_HZ = {
    0: 1.0, 1: 2.0, 2: 1.0, 24: 5.0, 30: 25.0, 31: 50.0, 32: 50.0, 33: 10.0, 49: 0.2, 74: 4.0,
    83: 10.0, 85: 10.0, 141: 4.0, 147: 1.0, 230: 2.0, 242: 0.5, 245: 5.0, 331: 50.0, 375: 10.0,
}  # fmt: skip
"""Message -> default rate (Hz)."""


class Reports:
    """Builds messages by their number."""

    def __init__(
        self, dialect: Any, robot: Robot, origin: Origin, scale: Scale, system_type: int
    ) -> None:
        """`origin` is the position of W on the earth."""
        self.d, self.robot, self.origin, self.scale = dialect, robot, origin, scale
        self._type = system_type
        self._b: Backend = robot.vehicle.backend
        self.unix_us: Callable[[], int] = lambda: 0
        self._lack, self._lack_at = "", -math.inf
        self._at, self._geodetic = b"", (0, 0, 0, 0.0)  # a position, and what it is on the earth
        self._makers: dict[int, Callable[[], Any]] = {
            0: self._heartbeat, 1: self._sys_status, 2: self._system_time, 24: self._gps,
            30: self._attitude, 31: self._quaternion, 32: self._local, 33: self._global,
            49: self._origin, 74: self._hud, 83: self._attitude_target, 85: self._target,
            141: self._altitude, 147: self._battery, 148: self._version, 230: self._estimator,
            242: self._home, 245: self._extended, 331: self._odometry, 375: self._actuators,
        }  # fmt: skip

    @property
    def numbers(self) -> frozenset[int]:
        """Numbers of the messages that it can build."""
        return frozenset(self._makers)

    def build(self, number: int) -> Any:
        """Return a message; None if there is nothing to report."""
        message = self._makers[number]()
        return message

    # --- values ------------------------------------------------------------------------------

    @property
    def _located(self) -> bool:
        """Whether the estimator has settled."""
        settled = self.robot.vehicle.state != State.UNINITIALIZED
        return settled and bool(self._b.localised)

    @property
    def _ms(self) -> int:
        return round(1e3 * self._b.t) % 2**32

    @property
    def _us(self) -> int:
        return round(1e6 * self._b.t)

    def _place(self) -> tuple[int, int, int, float]:
        """Return latitude, longitude (1e-7 deg), altitude (mm) and height (m) above the origin."""
        p = np.asarray(self._b.estimate["p_WB"])
        if p.tobytes() != self._at:  # several messages of a tick tell it
            at = to_geodetic(self.origin, p)
            self._at, self._geodetic = p.tobytes(), (
                round(1e7 * at.latitude_deg), round(1e7 * at.longitude_deg),
                round(1e3 * at.altitude_m), float(p[2]),
            )  # fmt: skip
        return self._geodetic

    def _heading_deg(self) -> float:
        R = np.asarray(self._b.estimate["R_WB"])
        return math.degrees(swap_heading(find_heading(R))) % 360.0

    def _find_lack(self) -> str:
        """Return why it cannot be armed; checked twice a second."""
        if self._b.t - self._lack_at >= 0.5 or self._b.t < self._lack_at:
            self._lack, self._lack_at = self.robot.ready, self._b.t
        return self._lack

    # --- messages ----------------------------------------------------------------------------

    def _heartbeat(self) -> Any:
        robot, armed = self.robot, self.robot.armed
        base = modes.CUSTOM | (modes.ARMED if armed else 0)
        if robot.mode in modes.BY_STICK:
            base |= modes.MANUAL_BIT | modes.STABILIZE
        else:
            base |= modes.AUTO_BIT | modes.GUIDED | modes.STABILIZE
        state = robot.vehicle.state
        status = (
            5 if robot.flies_itself else 4 if armed else 3 if state != State.UNINITIALIZED else 1
        )
        return self.d.MAVLink_heartbeat_message(self._type, PX4, base, robot.mode.custom, status, 3)

    def _sys_status(self) -> Any:
        charge = read_charge(self._b)
        present, healthy = SENSORS | PREARM, SENSORS
        if math.isnan(charge):
            present &= ~BATTERY
        if not self._located:
            healthy &= ~0x20
        if not self._find_lack():
            healthy |= PREARM
        return self.d.MAVLink_sys_status_message(
            present, present, healthy & present, 0, UNKNOWN_16, -1, _percent(charge), 0, 0, 0, 0, 0,
            0,
        )  # fmt: skip

    def _system_time(self) -> Any:
        return self.d.MAVLink_system_time_message(self.unix_us(), self._ms)

    def _gps(self) -> Any:
        lat, lon, alt, _ = self._place()
        v = swap_world(np.asarray(self._b.estimate["v_WB"]))
        std = self._b.pose_std
        accuracy = round(1e3 * std) if math.isfinite(std) else 0
        speed = math.hypot(v[0], v[1])
        course = math.degrees(math.atan2(v[1], v[0])) % 360.0
        return self.d.MAVLink_gps_raw_int_message(
            self._us, 6 if self._located else 1, lat, lon, alt, UNKNOWN_16, UNKNOWN_16,
            _clip(100.0 * speed, 0, 65534), _clip(100.0 * course, 0, 35999), 255, alt,
            accuracy, accuracy, 0, 0, _clip(100.0 * self._heading_deg(), 1, 36000),
        )  # fmt: skip

    def _attitude(self) -> Any:
        R = np.asarray(self._b.estimate["R_WB"])
        w = swap_body(np.asarray(self._b.estimate["w_WB_B"]))
        roll = math.atan2(R[2, 1], R[2, 2])
        pitch = math.asin(min(max(R[2, 0], -1.0), 1.0))
        yaw = math.radians(self._heading_deg())
        yaw = math.remainder(yaw, 2.0 * math.pi)
        return self.d.MAVLink_attitude_message(self._ms, roll, pitch, yaw, *w)

    def _quaternion(self) -> Any:
        q = to_ned_quaternion(np.asarray(self._b.estimate["R_WB"]))
        w = swap_body(np.asarray(self._b.estimate["w_WB_B"]))
        return self.d.MAVLink_attitude_quaternion_message(self._ms, *q, *w)

    def _local(self) -> Any:
        p = swap_world(np.asarray(self._b.estimate["p_WB"]))
        v = swap_world(np.asarray(self._b.estimate["v_WB"]))
        return self.d.MAVLink_local_position_ned_message(self._ms, *p, *v)

    def _global(self) -> Any:
        lat, lon, alt, up = self._place()
        v = 100.0 * swap_world(np.asarray(self._b.estimate["v_WB"]))
        above = round(1e3 * (up - float(self.robot.home[2])))
        heading = _clip(100.0 * self._heading_deg(), 0, 35999)
        return self.d.MAVLink_global_position_int_message(
            self._ms, lat, lon, alt, above, *(_clip(x, -32767, 32767) for x in v), heading
        )

    def _origin(self) -> Any:
        o = self.origin
        return self.d.MAVLink_gps_global_origin_message(
            round(1e7 * o.latitude_deg), round(1e7 * o.longitude_deg), round(1e3 * o.altitude_m),
            self._us,
        )  # fmt: skip

    def _home(self) -> Any:
        if not self._located:
            return None
        p = self.robot.home
        at, local = to_geodetic(self.origin, p), swap_world(p)
        return self.d.MAVLink_home_position_message(
            round(1e7 * at.latitude_deg), round(1e7 * at.longitude_deg), round(1e3 * at.altitude_m),
            *local, [1.0, 0.0, 0.0, 0.0], math.nan, math.nan, math.nan, self._us,
        )  # fmt: skip

    def _hud(self) -> Any:
        _, _, alt, _ = self._place()
        v = np.asarray(self._b.estimate["v_WB"])
        speed = float(np.hypot(v[0], v[1]))
        share = self._read_force()[2] / self.scale.unit
        return self.d.MAVLink_vfr_hud_message(
            speed, speed, round(self._heading_deg()) % 360, _clip(100.0 * share, 0, 100),
            1e-3 * alt, float(v[2]),
        )  # fmt: skip

    def _altitude(self) -> Any:
        _, _, alt, up = self._place()
        above = up - float(self.robot.home[2])
        return self.d.MAVLink_altitude_message(
            self._us, 1e-3 * alt, 1e-3 * alt, up, above, math.nan, math.nan
        )

    def _battery(self) -> Any:
        charge = read_charge(self._b)
        if math.isnan(charge):
            return None
        return self.d.MAVLink_battery_status_message(
            0, 1, 1, 32767, [UNKNOWN_16] * 10, -1, -1, -1, _percent(charge), 0
        )

    def _version(self) -> Any:
        return self.d.MAVLink_autopilot_version_message(
            CAPABILITIES, VERSION, VERSION, 0, 0, list(NAME), [0] * 8, [0] * 8, 0, 0, 1
        )

    def _estimator(self) -> Any:
        flags = ESTIMATED if self._located else 0x1
        std = self._b.pose_std
        return self.d.MAVLink_estimator_status_message(
            self._us, flags, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, std, std
        )

    def _extended(self) -> Any:
        state = LANDED_STATES[self.robot.vehicle.state]
        return self.d.MAVLink_extended_sys_state_message(0, state)

    def _odometry(self) -> Any:
        est, std = self._b.estimate, self._b.pose_std
        p = swap_world(np.asarray(est["p_WB"]))
        R = np.asarray(est["R_WB"])
        v = swap_body(R.T @ np.asarray(est["v_WB"]))
        w = swap_body(np.asarray(est["w_WB_B"]))
        covariance = [math.nan] * 21
        if math.isfinite(std):
            covariance[0] = covariance[6] = covariance[11] = std * std
        return self.d.MAVLink_odometry_message(
            self._us, 1, 12, *p, list(to_ned_quaternion(R)), *v, *w, covariance,
            [math.nan] * 21, 0, 8, 100 if self._located else -1,
        )  # fmt: skip

    def _read_force(self) -> Array:
        return np.asarray(_look(self._b, WrenchCommand, "f_B", 3))

    def _actuators(self) -> Any:
        n = len(self._b.rotors.axis)
        speed = np.asarray(_look(self._b, RotorDrive, "speed", n))[:n]
        most = np.sqrt(self._b.rotors.thrust_max / self._b.rotors.k_f)
        shares = np.clip(np.nan_to_num(speed) / most, 0.0, 1.0) if self.robot.armed else np.zeros(n)
        actuator = [*shares.tolist(), *[0.0] * 32][:32]
        return self.d.MAVLink_actuator_output_status_message(
            self._us, (1 << min(n, 32)) - 1, actuator
        )

    def _target(self) -> Any:
        if not self.robot.armed:
            return None
        row = self._b.reference_now
        p, v = swap_world(row["p_WB"]), swap_world(row["v_WB"])
        a = swap_world(row["a_WB"])
        yaw = swap_heading(find_heading(row["R_WB"]))
        return self.d.MAVLink_position_target_local_ned_message(
            self._ms, 1, 0, *p, *v, *a, yaw, -float(row["w_WB_B"][2])
        )

    def _attitude_target(self) -> Any:
        if not self.robot.armed:
            return None
        q = to_ned_quaternion(np.asarray(self._b.reference_now["R_WB"]))
        share = min(max(self._read_force()[2] / self.scale.unit, 0.0), 1.0)
        return self.d.MAVLink_attitude_target_message(self._ms, 0x7, list(q), 0, 0, 0, share)


def _look(b: Backend, record: Any, field: str, n: int) -> Any:
    try:
        return b.look(record)[field]
    except InputError:
        return np.zeros(n)


def _percent(charge: float) -> int:
    return -1 if math.isnan(charge) else _clip(100.0 * charge, 0, 100)


def _clip(value: float, low: int, high: int) -> int:
    """Return an integer of a message's field."""
    return int(min(max(round(value), low), high))
