"""The inertial unit: gyroscope and accelerometer, one sample a physics step (1 kHz).

A sample is the mean over its step, as of a unit that integrates inside: rate from the turn,
specific force f = R'(a - g) from the change of velocity at the unit's place. On top come bias
(turn-on and random walk), white noise, and the vibration of the rotors, sampled at the instant, so
harmonics above half the rate alias. The unit shakes on its mount; the body's motion does not.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import cross, mat_t_vec, mat_vec, quat_to_rot
from skywright.core.types import IMU_BATCH, MAX_ROTORS
from skywright.description.robot.spec import Robot

Array = NDArray[np.float64]
Record = Any

IMU_BLOCK = 2000  # samples of noise drawn at a time, at least one mission tick
WALK_EVERY = 10  # samples between steps of the biases' walk

f8, i8 = np.float64, np.int64

INERTIAL = np.dtype(
    [
        ("h", f8),  # s, between samples
        ("gravity", f8),
        ("p_BI", f8, 3),  # m, place of the unit
        ("v_WI", f8, 3),  # m/s, of the unit at the last sample
        ("n_rotors", i8),
        ("accel_shake", f8, MAX_ROTORS),  # m/s^2 per (rad/s)^2
        ("gyro_shake", f8, MAX_ROTORS),  # rad/s per (rad/s)^2
        ("phase", f8, (MAX_ROTORS, 2)),  # cosine, sine of the rotor's angle
        ("turn", f8, (MAX_ROTORS, 2)),  # cosine, sine of its turn in one sample
        ("size", f8, MAX_ROTORS),  # speed squared
        ("index", i8),  # into the block
        ("error", f8, (IMU_BLOCK, 6)),  # bias and noise of gyroscope, accelerometer
        ("bias", f8, (IMU_BLOCK // WALK_EVERY, 6)),  # rad/s, m/s^2
        # samples of this control tick
        ("n", i8),
        ("gyro", f8, (IMU_BATCH, 3)),
        ("accel", f8, (IMU_BATCH, 3)),
    ]
)


@njit(cache=True, error_model="numpy")
def sense_inertial(im: Record, qpos: Array, qvel: Array, rotor_speed: Array) -> None:
    """Take one sample after a physics step."""
    R, w, turn, v = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty(3)
    quat_to_rot(qpos[3:7], R)
    for i in range(3):
        w[i] = qvel[3 + i]
    cross(w, im.p_BI, turn)
    mat_vec(R, turn, v)
    for i in range(3):
        v[i] += qvel[i]
        turn[i] = (v[i] - im.v_WI[i]) / im.h
        im.v_WI[i] = v[i]
    turn[2] += im.gravity
    mat_t_vec(R, turn, v)  # with the attitude at the end of the step; half a turn back:
    cross(w, v, turn)
    k, n = im.index, im.n
    for i in range(3):
        im.gyro[n, i] = w[i] + im.error[k, i]
        im.accel[n, i] = v[i] + 0.5 * im.h * turn[i] + im.error[k, 3 + i]
    _shake(im, rotor_speed, n)
    im.index += 1
    im.n += 1


@njit(cache=True, error_model="numpy")
def _shake(im: Record, rotor_speed: Array, n: int) -> None:
    """Vibration: imbalance turns with the rotor, the two blades shake at 2 and 4 times that."""
    for r in range(im.n_rotors):
        if n == 0:  # the speed holds through a control tick
            angle = rotor_speed[r] * im.h
            im.turn[r, 0], im.turn[r, 1] = math.cos(angle), math.sin(angle)
            im.size[r] = rotor_speed[r] * rotor_speed[r]
            c, s = im.phase[r, 0], im.phase[r, 1]
            unit = 1.5 - 0.5 * (c * c + s * s)  # keeps the phase's length at one
            im.phase[r, 0], im.phase[r, 1] = unit * c, unit * s
        c0, s0, tc, ts = im.phase[r, 0], im.phase[r, 1], im.turn[r, 0], im.turn[r, 1]
        c, s = c0 * tc - s0 * ts, c0 * ts + s0 * tc
        im.phase[r, 0], im.phase[r, 1] = c, s
        c2, s2 = c * c - s * s, 2.0 * c * s
        c4, s4 = c2 * c2 - s2 * s2, 2.0 * c2 * s2
        a, g = im.accel_shake[r] * im.size[r], im.gyro_shake[r] * im.size[r]
        im.accel[n, 0] += a * (c + 0.25 * c4)
        im.accel[n, 1] += a * (s + 0.25 * s4)
        im.accel[n, 2] += 0.5 * a * s2
        im.gyro[n, 0] += g * s
        im.gyro[n, 1] -= g * c
        im.gyro[n, 2] += 0.5 * g * c2


@njit(cache=True, error_model="numpy")
def read_inertial(im: Record, meas: Record) -> None:
    """Hand the samples since the last call to a measurement; `meas.gyro` is their mean."""
    n = im.n
    meas.imu_n = n
    im.n = 0
    if n == 0:
        return
    for i in range(3):
        meas.gyro[i] = 0.0
        for k in range(n):
            meas.imu_gyro[k, i], meas.imu_accel[k, i] = im.gyro[k, i], im.accel[k, i]
            meas.gyro[i] += im.gyro[k, i] / n


def build_inertial(
    robot: Robot, gravity: float, h: float, streams: dict[str, np.random.Generator]
) -> NDArray[Any]:
    """Return a (1,) array of INERTIAL; `streams` has "gyro", "accelerometer" and "vibration"."""
    out = np.zeros(1, INERTIAL)
    im, s, rotors = out[0], robot.sensors, robot.rotors
    n = len(rotors.azimuth_deg)
    im["h"], im["gravity"], im["n_rotors"] = h, gravity, n
    im["p_BI"] = [s.imu_x_m, s.imu_y_m, s.imu_z_m]
    im["index"] = IMU_BLOCK
    im["bias"][-1, :3] = s.gyro_bias_rad_s * streams["gyro"].standard_normal(3)
    im["bias"][-1, 3:] = s.accel_bias_mps2 * streams["accelerometer"].standard_normal(3)
    # rotors differ in balance and start anywhere
    spread = streams["vibration"].uniform(0.5, 1.5, n)
    angle = streams["vibration"].uniform(0.0, 2.0 * math.pi, n)
    im["phase"][:n] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    per = spread * rotors.thrust_coefficient_n_per_rad2s2 / rotors.thrust_max_n
    im["accel_shake"][:n] = s.vibration_mps2 * per
    im["gyro_shake"][:n] = s.vibration_rad_s * per
    return out


def draw_inertial(im: Record, robot: Robot, streams: dict[str, np.random.Generator]) -> None:
    """Fill the block of errors: the biases walk on from the last block's end."""
    s, h = robot.sensors, float(im["h"])
    walk = math.sqrt(WALK_EVERY * h)
    steps = IMU_BLOCK // WALK_EVERY
    parts = (
        ("gyro", slice(0, 3), s.gyro_noise_rad_s_sqrthz, s.gyro_walk_rad_s2_sqrthz),
        ("accelerometer", slice(3, 6), s.accel_noise_mps2_sqrthz, s.accel_walk_mps3_sqrthz),
    )
    for name, part, noise, drift in parts:
        draws = streams[name].standard_normal((IMU_BLOCK + steps, 3))
        bias = im["bias"][-1, part] + drift * walk * np.cumsum(draws[IMU_BLOCK:], axis=0)
        im["bias"][:, part] = bias
        im["error"][:, part] = np.repeat(bias, WALK_EVERY, axis=0)
        im["error"][:, part] += noise / math.sqrt(h) * draws[:IMU_BLOCK]
    im["index"] = 0
