"""The onboard camera: it measures the pose of a marker, with noise, in its field of view.

Frame C: z along the optical axis, x to the right, y down. What a marker detector makes of an image
is modelled, not the image: bearings with a noise of angle, the distance with one in proportion to
it, the attitude with its own; and nothing outside the field of view, beyond the range, or seen too
much from the side. What stands in between is not looked at.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from skywright.core.rotations import exp_so3, mat_mat, mat_t_mat, mat_t_vec, mat_vec, quat_to_rot
from skywright.description.robot.camera import Camera
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.surface import build_cylinder
from skywright.description.world.things import find_carrier, list_movers, locate_thing
from skywright.models.things.marker import Marker

Record = Any
Array = Any

CAMERA_NOISE = 12  # draws a tick: six for the camera, six for motion capture of the marker
PIPE_NOISE = 6

CAMERA = np.dtype(
    [
        ("on", np.int64),
        ("p_BC", np.float64, 3),  # m
        ("R_BC", np.float64, (3, 3)),
        ("edge", np.float64),  # tangent of half the field of view
        ("range_max", np.float64),  # m
        ("side_min", np.float64),  # cosine of the slant beyond which the marker is not read
        ("sigma_bearing", np.float64),  # rad
        ("sigma_range", np.float64),  # of the distance
        ("sigma_R", np.float64),  # rad
        ("period", np.float64),  # s
        ("next", np.float64),  # s, next image
        # the marker
        ("marker", np.int64),  # 1: the world has one
        ("object_qpos", np.int64),  # of the thing that it sits on, -1: it does not move
        ("p_OM", np.float64, 3),  # m, on that thing, or in W
        ("R_OM", np.float64, (3, 3)),
        ("p_WM", np.float64, 3),  # m, truth of this tick
        ("R_WM", np.float64, (3, 3)),
        # a pipe that motion capture tracks
        ("pipe", np.int64),
        ("p_WP", np.float64, 3),  # m, with the error of its targets' calibration
        ("R_WP", np.float64, (3, 3)),
    ]
)
"""The camera and the marker: parameters and truth, part of the plant."""


def fill_camera(
    record: Record, robot: Robot, world: World, object_qpos: Array, pipe_error: Array
) -> None:
    """Write a CAMERA record; `object_qpos` are the addresses of the world's things, in order.

    `pipe_error` (3,) m, in W: of the calibration of a tracked pipe's targets.
    """
    record["object_qpos"] = -1
    record["R_OM"] = record["R_WM"] = np.eye(3)
    for name, thing in world.things.items():
        if isinstance(thing, Marker):
            carrier = find_carrier(world.things, name)
            at = locate_thing(world.things, name, carrier)
            record["marker"] = 1
            record["p_OM"], record["R_OM"] = record["p_WM"], record["R_WM"] = at
            if carrier is not None:
                record["object_qpos"] = object_qpos[list_movers(world.things).index(carrier)]
    if world.pipe is not None and world.pipe.tracked:
        cylinder = build_cylinder(world.pipe)
        record["pipe"] = 1
        record["p_WP"], record["R_WP"] = cylinder.p_WP + pipe_error, cylinder.R_WP
    if robot.camera is not None:
        c: Camera = robot.camera
        record["on"] = 1
        record["p_BC"], record["R_BC"] = [c.x_m, c.y_m, c.z_m], c.rotation
        record["edge"] = math.tan(0.5 * math.radians(c.field_of_view_deg))
        record["range_max"] = c.range_max_m
        record["side_min"] = math.cos(math.radians(c.slant_max_deg))
        record["sigma_bearing"], record["sigma_range"] = c.bearing_noise_rad, c.range_noise_fraction
        record["sigma_R"], record["period"] = c.attitude_noise_rad, 1.0 / c.rate_hz


@njit(cache=True, error_model="numpy")
def place_marker(cam: Record, qpos: Array) -> None:
    """Fill the marker's true pose: fixed, or with the thing that it sits on."""
    at = cam.object_qpos
    if at < 0:
        return
    rot, vec = np.empty((3, 3)), np.empty(3)
    quat_to_rot(qpos[at + 3 : at + 7], rot)
    mat_vec(rot, cam.p_OM, vec)
    for a in range(3):
        cam.p_WM[a] = qpos[at + a] + vec[a]
    mat_mat(rot, cam.R_OM, cam.R_WM)


@njit(cache=True, error_model="numpy")
def is_seen(cam: Record, p_CM: Array, R_CM: Array) -> bool:
    """Whether a marker at p_CM (3,) m, z of R_CM its normal, is in view and not too slanted."""
    x, y, z = p_CM[0], p_CM[1], p_CM[2]
    if z <= 0.02 or abs(x) > cam.edge * z or abs(y) > cam.edge * z:
        return False
    distance = math.sqrt(x * x + y * y + z * z)
    facing = -(x * R_CM[0, 2] + y * R_CM[1, 2] + z * R_CM[2, 2]) / distance
    return bool(distance <= cam.range_max and facing >= cam.side_min)


@njit(cache=True, error_model="numpy")
def take_image(cam: Record, t: float, p_WB: Array, R_WB: Array, draw: Array, meas: Record) -> None:
    """Fill meas.marker_fresh, and p_BM, R_BM when the camera saw the marker this tick."""
    meas.marker_fresh = 0.0
    if cam.on == 0 or cam.marker == 0 or t < cam.next - 1e-9:
        return
    cam.next += cam.period
    d, p_B, p_C = np.empty(3), np.empty(3), np.empty(3)
    R_WC, R_CM = np.empty((3, 3)), np.empty((3, 3))
    for a in range(3):
        d[a] = cam.p_WM[a] - p_WB[a]
    mat_t_vec(R_WB, d, p_B)
    for a in range(3):
        d[a] = p_B[a] - cam.p_BC[a]
    mat_t_vec(cam.R_BC, d, p_C)
    mat_mat(R_WB, cam.R_BC, R_WC)
    mat_t_mat(R_WC, cam.R_WM, R_CM)
    if not is_seen(cam, p_C, R_CM):
        return
    distance = math.sqrt(p_C[0] * p_C[0] + p_C[1] * p_C[1] + p_C[2] * p_C[2])
    turn, rot, noisy = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    share = 1.0 + cam.sigma_range * draw[2]
    p_C[0] = share * (p_C[0] + distance * cam.sigma_bearing * draw[0])
    p_C[1] = share * (p_C[1] + distance * cam.sigma_bearing * draw[1])
    p_C[2] = share * p_C[2]
    for a in range(3):
        turn[a] = cam.sigma_R * draw[3 + a]
    exp_so3(turn, rot)
    mat_mat(R_CM, rot, noisy)
    mat_vec(cam.R_BC, p_C, p_B)
    for a in range(3):
        meas.p_BM[a] = cam.p_BC[a] + p_B[a]
    mat_mat(cam.R_BC, noisy, meas.R_BM)
    meas.marker_fresh = 1.0


@njit(cache=True, error_model="numpy")
def capture_body(
    p: Array, R: Array, sigma_p: float, sigma_R: float, draw: Array, p_seen: Array, R_seen: Array
) -> None:
    """Fill p_seen, R_seen with a motion-capture sample of a body; draw (6,): place, attitude."""
    turn, rot = np.empty(3), np.empty((3, 3))
    for a in range(3):
        p_seen[a] = p[a] + sigma_p * draw[a]
        turn[a] = sigma_R * draw[3 + a]
    exp_so3(turn, rot)
    mat_mat(R, rot, R_seen)
