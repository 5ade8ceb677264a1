"""Total station, tracking camera and range finder of a flight: what they measure in a control tick.

The line of sight from the station to the prism and the distance below the robot come from the
scene's geometry, once a mission tick (`Sight`).
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from skywright.core.rotations import exp_so3, mat_mat
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.range_finder import (
    RANGE_BLOCK,
    Finder,
    RangePrecision,
    build_range_finder,
    draw_range_finder,
    step_range_finder,
)
from skywright.models.total_station import (
    STATION_BLOCK,
    Station,
    StationPrecision,
    build_total_station,
    draw_total_station,
    step_total_station,
)
from skywright.models.tracking_camera import (
    CAMERA_BLOCK,
    CameraErrors,
    Tracker,
    build_tracking_camera,
    draw_tracking_camera,
    step_tracking_camera,
)
from skywright.sim.simulation import Simulation

Array = NDArray[np.float64]
Record = Any

f8, i8 = np.float64, np.int64

LOCALISATION = np.dtype(
    [
        ("on", i8),
        ("station", Station.dtype),
        ("camera", Tracker.dtype),
        ("range_finder", Finder.dtype),
        ("ranges", i8),  # 1: there is a range finder
        ("clock", f8),  # s, station's clock ahead of the robot's
        ("attitude_noise", f8),  # rad, of the camera
        ("attitude_unit", f8, (CAMERA_BLOCK, 3)),
        ("visible", i8),
        ("distance", f8),  # m, below the robot
    ]
)


def build_sensors(
    robot: Robot, world: World, streams: dict[str, np.random.Generator]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return (1,) arrays of Station and Tracker; its frame is drawn."""
    prism, camera, station = robot.prism, robot.tracking_camera, world.total_station
    assert prism is not None and camera is not None
    heading, tilt, R_CW = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    exp_so3(np.array([0.0, 0.0, streams["camera"].uniform(-math.pi, math.pi)]), heading)
    exp_so3(math.radians(1.0) * streams["camera"].standard_normal(3) * [1.0, 1.0, 0.0], tilt)
    mat_mat(heading, tilt, R_CW)
    precision = StationPrecision(
        station.rate_max_hz, station.rate_mean_hz, station.latency_min_s, station.latency_mean_s,
        station.range_noise_m, station.angle_noise_rad, station.pointing_noise_m, station.relock_s,
    )  # fmt: skip
    errors = CameraErrors(
        camera.rate_hz, camera.scale, camera.walk_m_per_sqrt_m, camera.walk_m_per_sqrt_s,
        camera.yaw_rate_deg_per_min, 0.0, 0.0, camera.noise_m, camera.jump_interval_s,
        camera.jump_m,
    )  # fmt: skip
    place = np.array([station.x_m, station.y_m, station.z_m])
    p_BP = np.array([prism.x_m, prism.y_m, prism.z_m])
    return build_total_station(place, p_BP, precision), build_tracking_camera(R_CW, errors)


def fill_localisation(
    loc: Record, station: Record, camera: Record, clock: float, robot: Robot,
    streams: dict[str, np.random.Generator],
) -> None:  # fmt: skip
    """Fill a LOCALISATION record with sensors that have been calibrated; mission time starts."""
    assert robot.tracking_camera is not None
    loc["on"], loc["visible"], loc["distance"], loc["clock"] = 1, 1, math.inf, clock
    loc["station"], loc["camera"] = station, camera
    loc["station"]["next_t"] = loc["station"]["sent"] = loc["camera"]["next_t"] = 0.0
    loc["station"]["n"], loc["station"]["seen_since"] = 0, -math.inf
    loc["attitude_noise"] = robot.tracking_camera.attitude_noise_rad
    loc["camera"]["index"] = CAMERA_BLOCK  # noise of attitude and position are drawn together
    if robot.range_finder is not None:
        r = robot.range_finder
        loc["ranges"] = 1
        precision = RangePrecision(
            r.rate_hz, r.range_min_m, r.range_max_m, r.resolution_m, r.bias_m, r.noise_m
        )
        loc["range_finder"] = build_range_finder(streams["range_finder"], precision)[0]


def draw_localisation(loc: Record, streams: dict[str, np.random.Generator], samples: int) -> None:
    """Refill the blocks of noise that would not last for `samples` more samples."""
    if loc["station"]["index"] + samples > STATION_BLOCK:
        draw_total_station(loc["station"], streams["station"])
    if loc["camera"]["index"] + samples > CAMERA_BLOCK:
        draw_tracking_camera(loc["camera"], streams["camera"])
        loc["attitude_unit"] = streams["camera"].standard_normal((CAMERA_BLOCK, 3))
    if loc["ranges"] and loc["range_finder"]["index"] + samples > RANGE_BLOCK:
        draw_range_finder(loc["range_finder"], streams["range_finder"])


@njit(cache=True, error_model="numpy")
def sense_localisation(loc: Record, t: float, p_WB: Array, R_WB: Array, meas: Record) -> None:
    """Step the sensors and write what is new into the measurement."""
    step_total_station(loc.station, t, p_WB, R_WB, loc.visible > 0)
    meas.fix_fresh = loc.station.fresh
    if loc.station.fresh > 0.0:
        meas.fix_t = loc.station.stamp + loc.clock
        for i in range(3):
            meas.fix_p[i] = loc.station.p_WP[i]
    step_tracking_camera(loc.camera, t, p_WB, R_WB)
    meas.odo_fresh = loc.camera.fresh
    if loc.camera.fresh > 0.0:
        meas.odo_t = loc.camera.stamp
        turn, noise = np.empty(3), np.empty((3, 3))
        k = loc.camera.index % CAMERA_BLOCK
        for i in range(3):
            meas.odo_p[i] = loc.camera.p_CB[i]
            turn[i] = loc.attitude_noise * loc.attitude_unit[k, i]
        exp_so3(turn, noise)
        mat_mat(loc.camera.R_CB, noise, meas.odo_R)
    meas.range_fresh = 0.0
    if loc.ranges:
        step_range_finder(loc.range_finder, t, loc.distance)
        if loc.range_finder.fresh > 0.0 and loc.range_finder.valid > 0.0:
            meas.range_fresh, meas.range_t = 1.0, loc.range_finder.stamp
            meas.range = loc.range_finder.distance


class Sight:
    """Rays through the scene: past the robot, against everything else."""

    def __init__(self, sim: Simulation, robot_body: int) -> None:
        self._model, self._data = sim.scene.model, sim.data
        self._robot = set(np.flatnonzero(self._model.body_rootid == robot_body).tolist())
        self._geom = np.zeros(1, np.int32)

    def measure(self, start: Array, direction: Array) -> float:
        """Distance (m) from `start` (3,) along a unit vector to the first thing; inf: none."""
        gone = 0.0
        for _ in range(32):  # each part of the robot on the way
            far = mujoco.mj_ray(
                self._model, self._data, start + gone * direction, direction, None, 1, -1,
                self._geom,
            )  # fmt: skip
            if far < 0.0:
                return math.inf
            gone += float(far)
            if int(self._model.geom_bodyid[self._geom[0]]) not in self._robot:
                return gone
            gone += 1e-4
        return math.inf

    def sees(self, a: Array, b: Array) -> bool:
        """Whether nothing but the robot stands between two points (3,) m."""
        way = b - a
        far = float(np.linalg.norm(way))
        return far < 1e-6 or self.measure(a, way / far) >= far
