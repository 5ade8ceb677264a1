"""Readings of the plant as PX4's simulated sensors: HIL_SENSOR, HIL_GPS, ODOMETRY and the truth.

Frames: PX4's world is NED (x north, y east, z down), its body FRD; W is ENU, B is FLU. Rates are
those of PX4's own simulators: inertial samples each step, magnetometer and barometer at 50 Hz,
fixes and poses at their own rates. PX4 treats noise-free magnetometers and barometers as broken;
their noise here is that of PX4's simulated sensors. Inertial noise, bias and vibration are the
robot's.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.streams import build_stream
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.links.mavlink.frames import FRD_FROM_FLU, NED_FROM_ENU, to_ned_quaternion
from skywright.links.sitl.earth import HOME, compute_field, compute_pressure
from skywright.links.sitl.plant import Placed, Reading
from skywright.models.vectors import compute_cross
from skywright.vehicle.geodesy import to_geodetic

Array = NDArray[np.float64]

INERTIAL, MAGNETIC, BAROMETRIC = 0x003F, 0x01C0, 0x1A00
"""Bits of fields_updated: accelerometer and gyroscope, magnetometer, pressure and temperature."""
SLOW_HZ = 50.0
"""Hz, of magnetometer and barometer."""
MAG_NOISE = 1.0e-3  # gauss per sample, of PX4's simulated magnetometer
BARO_NOISE = 1.0  # Pa per sample, of PX4's simulated barometer
SPEED_NOISE = 0.05  # m/s, of a receiver's Doppler speed (u-blox M8's data sheet)
TEMPERATURE = 20.0  # deg C
SATELLITES = 12
BEHIND = 256  # steps for which velocities are kept: a fix is up to a second late
FIRST_US = 1_000_000
"""us, PX4's clock at the start of the plant: PX4 interprets zero as "never"."""
DEFAULT_TRUTH_HZ = 50.0
LOCAL_NED, BODY_FRD = 1, 12  # MAV_FRAME
VISION = 2
"""MAV_ESTIMATOR_TYPE: EKF2 uses estimates of the type "vision", not of the type "mocap"."""


def compute_time_us(t: float) -> int:
    """Return PX4's clock (us) at the plant's time `t` (s)."""
    return FIRST_US + round(1e6 * t)


class Px4Sensors:
    """Builds the messages of one step; keeps the antenna's past velocities for delayed fixes."""

    def __init__(self, dialect: Any, robot: Robot, world: World, seed: int, period: float) -> None:
        """`dialect` is pymavlink's, `period` (s) that of a step."""
        self._dialect, self._world = dialect, world
        self.origin = world.origin or HOME
        self._field = compute_field(self.origin)
        self._every = max(round(1.0 / (SLOW_HZ * period)), 1)
        self._period = period
        self._truth_every = max(round(1.0 / (DEFAULT_TRUTH_HZ * period)), 1)
        self._rng = build_stream(seed, "sensor_noise", "autopilot")
        self._step = 0
        self._past: deque[tuple[float, Array]] = deque(maxlen=BEHIND)
        s, g = robot.sensors, world.gnss.errors
        self._p_BG = np.array([s.antenna_x_m, s.antenna_y_m, s.antenna_z_m])
        self._eph = math.sqrt(2.0 * (g.noise_level_m**2 + g.drift_level_m**2))
        self._epv = math.hypot(g.noise_up_m, g.drift_up_m)
        self._std = (world.mocap.position_noise_m, world.mocap.attitude_noise_rad)
        self._slow = [0.0, 0.0, 0.0, 0.0, 0.0, TEMPERATURE]

    def set_truth_interval(self, interval_us: float) -> None:
        """Send the truth at the requested interval (us); at most once a step."""
        if math.isfinite(interval_us) and interval_us > 0.0:
            self._truth_every = max(round(1e-6 * interval_us / self._period), 1)

    def set_pose_noise(self, place: float, turn: float) -> None:
        """Set the standard deviations (m, rad) of poses that are not from motion capture."""
        self._std = (place, turn)

    def build(self, reading: Reading) -> list[Any]:
        """Return the messages of a step; the last one is HIL_SENSOR, which lockstep waits for."""
        out: list[Any] = []
        v_WG = reading.v_WB + reading.R_WB @ compute_cross(reading.w_WB_B, self._p_BG)
        self._past.append((reading.t, v_WG))
        if reading.fix is not None:
            out.append(self._build_gps(reading.fix))
        if reading.pose is not None:
            out.append(self._build_odometry(reading.pose))
        if self._step % self._truth_every == 0:
            out.append(self._build_truth(reading))
        out.append(self._build_sensor(reading))
        self._step += 1
        return out

    def _build_sensor(self, r: Reading) -> Any:
        updated = INERTIAL
        if self._step % self._every == 0:
            updated |= MAGNETIC | BAROMETRIC
            R = NED_FROM_ENU @ r.R_WB @ FRD_FROM_FLU
            mag = R.T @ self._field + MAG_NOISE * self._rng.standard_normal(3)
            pressure = compute_pressure(self.origin.altitude_m + float(r.p_WB[2]))
            pressure += BARO_NOISE * float(self._rng.standard_normal())
            height = 288.15 / 0.0065 * (1.0 - (pressure / 101325.0) ** (1.0 / 5.25588))
            self._slow = [*mag, 0.01 * pressure, height, TEMPERATURE]
        accel, gyro = FRD_FROM_FLU @ r.accel, FRD_FROM_FLU @ r.gyro
        mx, my, mz, hpa, height, temperature = self._slow
        return self._dialect.MAVLink_hil_sensor_message(
            compute_time_us(r.t), *accel, *gyro, mx, my, mz, hpa, 0.0, height, temperature,
            updated, 0,
        )  # fmt: skip

    def _build_gps(self, fix: Placed) -> Any:
        place = to_geodetic(self.origin, fix.p)
        v = self._find_speed(fix.t) + SPEED_NOISE * self._rng.standard_normal(3)
        north, east, down = 100.0 * (NED_FROM_ENU @ v)
        speed = math.hypot(north, east)
        course = math.degrees(math.atan2(east, north)) % 360.0
        return self._dialect.MAVLink_hil_gps_message(
            compute_time_us(fix.t), 3, round(1e7 * place.latitude_deg),
            round(1e7 * place.longitude_deg), round(1e3 * place.altitude_m),
            _clip(100.0 * self._eph, 1, 65534), _clip(100.0 * self._epv, 1, 65534),
            _clip(speed, 0, 65534), _clip(north), _clip(east), _clip(down),
            _clip(100.0 * course, 0, 35999) if speed > 50.0 else 65535, SATELLITES, 0, 0,
        )  # fmt: skip

    def _find_speed(self, t: float) -> Array:
        """Return the antenna's velocity (3,) m/s in W at `t` (s), or the oldest one kept."""
        return next((v for at, v in reversed(self._past) if at <= t + 1e-9), self._past[0][1])

    def _build_odometry(self, pose: Placed) -> Any:
        assert pose.R_WB is not None
        x, y, z = NED_FROM_ENU @ pose.p
        nan = math.nan
        covariance, (place, turn) = [0.0] * 21, self._std
        for k in (0, 6, 11):
            covariance[k] = place**2
        for k in (15, 18, 20):
            covariance[k] = turn**2
        unknown = [nan] * 21
        return self._dialect.MAVLink_odometry_message(
            compute_time_us(pose.t), LOCAL_NED, BODY_FRD, x, y, z,
            list(to_ned_quaternion(pose.R_WB)), nan, nan, nan, nan, nan, nan, covariance, unknown,
            0, VISION, 100,
        )  # fmt: skip

    def _build_truth(self, r: Reading) -> Any:
        place = to_geodetic(self.origin, r.p_WB)
        north, east, down = 100.0 * (NED_FROM_ENU @ r.v_WB)
        accel_mg = 1e3 / 9.80665 * (FRD_FROM_FLU @ r.accel)
        return self._dialect.MAVLink_hil_state_quaternion_message(
            compute_time_us(r.t), list(to_ned_quaternion(r.R_WB)), *(FRD_FROM_FLU @ r.w_WB_B),
            round(1e7 * place.latitude_deg), round(1e7 * place.longitude_deg),
            round(1e3 * place.altitude_m), _clip(north), _clip(east), _clip(down), 0, 0,
            *(_clip(a) for a in accel_mg),
        )  # fmt: skip


def _clip(value: float, low: int = -32767, high: int = 32767) -> int:
    """Return an integer of a message's field."""
    return int(min(max(round(value), low), high))
