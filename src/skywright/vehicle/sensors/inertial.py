"""The inertial unit: gyroscope and accelerometer, one sample per physics step (1 kHz).

A sample is the mean over its step, as of a unit that integrates internally: the rate from the
rotation, the specific force f = R'(a - g) from the change of velocity at the unit's position.
Errors are the bias (turn-on and random walk), white noise, and the vibration of the rotors, which
is sampled without averaging, so that harmonics above half the rate alias. Vibration moves the unit
on its mount, not the body.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any

import numpy as np

from skywright.core.record import Array, Record, Vec3
from skywright.core.rotations import cross, mat_t_vec, mat_vec, quat_to_rot
from skywright.core.scratch import local
from skywright.core.types import IMU_BATCH, MAX_ROTORS
from skywright.description.robot.spec import Sensors
from skywright.vehicle.bus import Clock, MuJoCo
from skywright.vehicle.component import (
    Component,
    Draws,
    Normal,
    Out,
    Recorded,
    Sensor,
    Streamed,
    helper,
    words,
)
from skywright.vehicle.plant import RotorState
from skywright.vehicle.readings import ImuBatch
from skywright.vehicle.topics import BODY

WALK_EVERY = 10  # samples between steps of the biases' random walk


class Walk(Record):
    """A bias between two blocks of draws."""

    on: int  # 1: the turn-on bias is drawn
    bias: Vec3  # rad/s or m/s^2


class Inertial(Sensor):
    """Samples after each physics step; outputs the samples at the start of a control tick."""

    Table = Sensors
    slots = {"sample": "fast", "step": "sense"}

    class Me(Record):
        h: float  # s, between samples
        gravity: float
        p_BI: Vec3  # m, position of the unit
        v_WI: Vec3  # m/s, of the unit at the last sample
        n_rotors: int
        accel_shake: Annotated[Array, MAX_ROTORS]  # m/s^2 per (rad/s)^2
        gyro_shake: Annotated[Array, MAX_ROTORS]  # rad/s per (rad/s)^2
        phase: Annotated[Array, MAX_ROTORS, 2]  # cosine, sine of the rotor's angle
        turn: Annotated[Array, MAX_ROTORS, 2]  # cosine, sine of its turn in one sample
        squared: Annotated[Array, MAX_ROTORS]  # (rad/s)^2, of the speed
        gyro_walk: Walk
        accel_walk: Walk
        n: int  # samples of this control tick
        gyro: Annotated[Array, IMU_BATCH, 3]
        accel: Annotated[Array, IMU_BATCH, 3]

    streams = (
        Streamed(
            (
                Recorded("gyro", ImuBatch, "gyro", "rad/s", "mean over a sample's period, in B"),
                Recorded("accel", ImuBatch, "accel", "m/s^2", "specific force at the unit, in B"),
            ),
            "sensor_msgs/Imu", BODY, {"angular_velocity": "gyro", "linear_acceleration": "accel"},
            {"orientation_covariance[0]": -1.0},  # in ROS: it does not tell the orientation
        ),
    )  # fmt: skip

    class GyroError(Normal):
        stream = "gyro"
        e: Vec3  # rad/s, bias and noise

    class AccelError(Normal):
        stream = "accelerometer"
        e: Vec3  # m/s^2

    def build(self, me: Any, table: Any, context: Any) -> None:
        """Place the unit; draw the imbalance and the initial angles of the rotors."""
        rotors = context.robot.rotors
        n = len(rotors.azimuth_deg)
        me.h, me.gravity, me.n_rotors = context.h, context.world.gravity_mps2, n
        me.p_BI[:] = [table.imu_x_m, table.imu_y_m, table.imu_z_m]
        stream = context.stream("vibration")
        spread = stream.uniform(0.5, 1.5, n)
        angle = stream.uniform(0.0, 2.0 * math.pi, n)
        me.phase[:n] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        per = spread * rotors.thrust_coefficient_n_per_rad2s2 / rotors.thrust_max_n
        me.accel_shake[:n] = table.vibration_mps2 * per
        me.gyro_shake[:n] = table.vibration_rad_s * per
        self._me, self._true = me, table
        self._paths: dict[str, Array] = {}  # of the biases, by draw

    def read_bias(self, sample: int) -> Array:
        """Return the true biases (6,) rad/s, m/s^2 at a sample of the present block of draws."""
        k = sample // WALK_EVERY
        return np.concatenate([self._paths["GyroError"][k], self._paths["AccelError"][k]])

    def draw(self, what: type[Draws], rng: np.random.Generator, n: int) -> Array:
        """Return bias and noise of `n` samples: the bias continues from the end of the last
        block."""
        s, me = self._true, self._me
        if what is self.GyroError:
            walk, start = me.gyro_walk, s.gyro_bias_rad_s
            noise, drift = s.gyro_noise_rad_s_sqrthz, s.gyro_walk_rad_s2_sqrthz
        else:
            walk, start = me.accel_walk, s.accel_bias_mps2
            noise, drift = s.accel_noise_mps2_sqrthz, s.accel_walk_mps3_sqrthz
        if not walk["on"]:
            walk["on"], walk["bias"] = 1, start * rng.standard_normal(3)
        size = drift * math.sqrt(WALK_EVERY * me.h)
        draws = rng.standard_normal((n + n // WALK_EVERY, 3))
        path = walk["bias"] + size * np.cumsum(draws[n:], axis=0)
        self._paths[what.__name__] = path
        walk["bias"] = path[-1]
        out: Array = np.repeat(path, WALK_EVERY, axis=0)
        out += noise / math.sqrt(me.h) * draws[:n]
        return out

    @staticmethod
    def sample(me: Me, mj: MuJoCo, rotors: RotorState, gyro: GyroError, accel: AccelError) -> None:
        qpos, qvel = words(mj.qpos, mj.nq), words(mj.qvel, mj.nv)
        R, w, v, a = local(3, 3), local(3), local(3), local(3)
        quat_to_rot(qpos[3:7], R)
        for i in range(3):
            w[i] = qvel[3 + i]
        cross(w, me.p_BI, a)
        mat_vec(R, a, v)
        for i in range(3):
            v[i] += qvel[i]
            a[i] = (v[i] - me.v_WI[i]) / me.h
            me.v_WI[i] = v[i]
        a[2] += me.gravity
        mat_t_vec(R, a, v)  # with the attitude at the end of the step; half a turn back:
        cross(w, v, a)
        n = me.n
        for i in range(3):
            me.gyro[n, i] = w[i] + gyro.e[i]
            me.accel[n, i] = v[i] + 0.5 * me.h * a[i] + accel.e[i]
        shake(me, rotors.speed, n)
        me.n += 1

    @staticmethod
    def step(me: Me, clock: Clock, out: Out[ImuBatch]) -> None:
        out.t, out.n = clock.t, me.n
        for k in range(me.n):
            for i in range(3):
                out.gyro[k, i], out.accel[k, i] = me.gyro[k, i], me.accel[k, i]
        me.n = 0

    @classmethod
    def wanted(cls, context: Any) -> Iterable[Component]:
        """Every robot has one."""
        yield cls("inertial", context.robot.sensors)


@helper
def shake(me: Any, rotor_speed: Any, n: int) -> None:
    """Vibration: imbalance at the rotor's frequency, the two blades at 2 and 4 times that."""
    for r in range(me.n_rotors):
        if n == 0:  # the speed is constant during a control tick
            angle = rotor_speed[r] * me.h
            me.turn[r, 0], me.turn[r, 1] = math.cos(angle), math.sin(angle)
            me.squared[r] = rotor_speed[r] * rotor_speed[r]
            c, s = me.phase[r, 0], me.phase[r, 1]
            unit = 1.5 - 0.5 * (c * c + s * s)  # normalises the phase
            me.phase[r, 0], me.phase[r, 1] = unit * c, unit * s
        c0, s0, tc, ts = me.phase[r, 0], me.phase[r, 1], me.turn[r, 0], me.turn[r, 1]
        c, s = c0 * tc - s0 * ts, c0 * ts + s0 * tc
        me.phase[r, 0], me.phase[r, 1] = c, s
        c2, s2 = c * c - s * s, 2.0 * c * s
        c4, s4 = c2 * c2 - s2 * s2, 2.0 * c2 * s2
        a, g = me.accel_shake[r] * me.squared[r], me.gyro_shake[r] * me.squared[r]
        me.accel[n, 0] += a * (c + 0.25 * c4)
        me.accel[n, 1] += a * (s + 0.25 * s4)
        me.accel[n, 2] += 0.5 * a * s2
        me.gyro[n, 0] += g * s
        me.gyro[n, 1] -= g * c
        me.gyro[n, 2] += 0.5 * g * c2
