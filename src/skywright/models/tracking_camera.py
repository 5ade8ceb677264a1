"""The tracking camera: visual odometry in its own frame, with scale error, drift and jumps.

Its initial pose is arbitrary, its scale is wrong by some per cent, position and heading drift, and
a correction of its map makes the position jump. The errors are of the class of an Intel RealSense
T265 (Sanchez-Cuevas 2020, section 2). While the camera stands still its image does not change and
its position does not drift.
"""

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skywright.core.compiled import helper
from skywright.core.record import Array, Mat3, Record, Vec3
from skywright.core.rotations import mat_mat, mat_vec
from skywright.core.scratch import local

CAMERA_BLOCK = 4096
"""Samples whose noise is drawn at a time."""


class Tracker(Record):
    """Parameters and state of a tracking camera."""

    # parameters
    period: float  # s, between samples
    R_CW: Mat3  # its frame C at the start
    scale: float  # length in C per metre
    walk_per_sqrt_m: float  # m per sqrt(m) of path, each axis
    walk_per_sqrt_s: float  # m per sqrt(s), each axis
    yaw_rate: float  # rad/s, steady drift of the heading
    yaw_walk: float  # rad per sqrt(s)
    scale_walk: float  # per sqrt(s)
    noise_std: float  # m, each sample, each axis
    jump_rate: float  # 1/s
    jump_std: float  # m, each axis
    # state
    started: float
    next_t: float  # s
    p_WB: Vec3  # m, true, at the last sample
    yaw: float  # rad, drift of the heading so far
    growth: float  # drift of the scale so far
    p_C: Vec3  # m, without the sample's own noise
    index: int
    unit: Annotated[Array, CAMERA_BLOCK, 12]  # normal draws; the last is uniform
    # the sample of this step
    fresh: float
    stamp: float  # s
    p_CB: Vec3  # m
    R_CB: Mat3


class CameraErrors(NamedTuple):
    """Errors of a tracking camera; the defaults are assumed, from reports on the T265."""

    rate_hz: float = 200.0  # data sheet
    scale: float = 0.95  # assumed, 0.85 to 1.05, fixed in a run
    walk_m_per_sqrt_m: float = 0.015  # assumed: 1 to 2 per cent of some metres of path
    walk_m_per_sqrt_s: float = 0.0  # assumed: no drift at standstill
    yaw_rate_deg_per_min: float = 1.0  # assumed, 0.5 to 2
    yaw_walk_deg_per_sqrt_s: float = 0.0
    scale_walk_per_sqrt_s: float = 0.0
    noise_std_m: float = 0.5e-3  # assumed
    jump_interval_s: float = 60.0  # assumed
    jump_std_m: float = 0.01  # assumed, jumps of 1 to 3 cm


def build_tracking_camera(R_CW: Array, errors: CameraErrors | None = None) -> NDArray[Any]:
    """Return a (1,) array of Tracker; `draw_tracking_camera` must fill its noise first."""
    e = errors or CameraErrors()
    out = np.zeros(1, Tracker.dtype)
    cam = out[0]
    cam["period"], cam["R_CW"], cam["scale"] = 1.0 / e.rate_hz, R_CW, e.scale
    cam["walk_per_sqrt_m"], cam["walk_per_sqrt_s"] = e.walk_m_per_sqrt_m, e.walk_m_per_sqrt_s
    cam["yaw_rate"] = math.radians(e.yaw_rate_deg_per_min) / 60.0
    cam["yaw_walk"] = math.radians(e.yaw_walk_deg_per_sqrt_s)
    cam["scale_walk"], cam["noise_std"] = e.scale_walk_per_sqrt_s, e.noise_std_m
    cam["jump_rate"] = 1.0 / e.jump_interval_s if e.jump_interval_s > 0 else 0.0
    cam["jump_std"] = e.jump_std_m
    cam["index"] = CAMERA_BLOCK
    return out


def draw_tracking_camera(cam: Any, stream: np.random.Generator) -> None:
    """Fill the block of noise; call it before `index` reaches CAMERA_BLOCK."""
    cam["unit"][:, :11] = stream.standard_normal((CAMERA_BLOCK, 11))
    cam["unit"][:, 11] = stream.random(CAMERA_BLOCK)
    cam["index"] = 0


@helper
def step_tracking_camera(cam: Any, t: float, p_WB: Array, R_WB: Array) -> None:
    """Take a sample if one is due; the first one is the origin of the camera's frame."""
    cam.fresh = 0.0
    if cam.started == 0.0:
        cam.started = 1.0
        cam.next_t = t
        for i in range(3):
            cam.p_WB[i] = p_WB[i]
    if t < cam.next_t - 1e-9:
        return
    cam.next_t += cam.period
    k, dt = cam.index % CAMERA_BLOCK, cam.period
    cam.index += 1
    u = cam.unit[k]
    moved, step = local(3), local(3)
    length = 0.0
    for i in range(3):
        moved[i] = p_WB[i] - cam.p_WB[i]
        length += moved[i] ** 2
        cam.p_WB[i] = p_WB[i]
    length = math.sqrt(length)
    walk = math.sqrt(cam.walk_per_sqrt_m**2 * length + cam.walk_per_sqrt_s**2 * dt)
    jump = cam.jump_std if u[11] < cam.jump_rate * dt else 0.0
    for i in range(3):
        moved[i] += walk * u[i] + jump * u[3 + i]
    cam.yaw += cam.yaw_rate * dt + cam.yaw_walk * math.sqrt(dt) * u[6]
    cam.growth += cam.scale_walk * math.sqrt(dt) * u[7]
    frame, turn, R_CW = local(3, 3), local(3, 3), local(3, 3)
    turn[:] = 0.0
    c, s = math.cos(cam.yaw), math.sin(cam.yaw)
    turn[0, 0], turn[0, 1], turn[1, 0], turn[1, 1], turn[2, 2] = c, -s, s, c, 1.0
    for i in range(3):
        for j in range(3):
            frame[i, j] = cam.R_CW[i, j]
    mat_mat(frame, turn, R_CW)  # the heading drifts about the vertical
    mat_vec(R_CW, moved, step)
    size = cam.scale * math.exp(cam.growth)
    for i in range(3):
        cam.p_C[i] += size * step[i]
        cam.p_CB[i] = cam.p_C[i] + cam.noise_std * u[8 + i]
    mat_mat(R_CW, R_WB, frame)
    for i in range(3):
        for j in range(3):
            cam.R_CB[i, j] = frame[i, j]
    cam.fresh, cam.stamp = 1.0, t
