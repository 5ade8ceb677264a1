"""Localisation without motion capture: the sensors of a flight and the calibration before it.

As in Sanchez-Cuevas 2020, section 3.1, the camera is aligned with the station on a flight before
the mission: a path through a box of 6 x 5 x 3 m, both sensors recorded, then time, frame and scale
by the same functions as `skywright locate`. The mission's filter starts from that and goes on
estimating how the camera errs (estimation/station_camera.py).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.localisation.calibration import Calibration, calibrate
from skywright.models.localisation.drift_filter import DriftModel
from skywright.models.localisation.time_alignment import estimate_offset
from skywright.sim.localisation import build_sensors, fill_localisation
from skywright.vehicle.sensor_flight import build_inspection_path, record_flight

Record = Any

LAG = 0.25
"""s, of the filter's horizon: 98 % of the station's samples arrive sooner."""
CALIBRATION_SPEED = 0.7  # m/s, mean
# what may have changed since the calibration, 1 sigma
TILT_SINCE, HEADING_SINCE = math.radians(0.2), math.radians(1.0)
SCALE_SINCE, CLOCK_SINCE = 0.005, 2e-3


def prepare_localisation(
    plant: Record, fus: Record, robot: Robot, world: World, seed: int,
    streams: dict[str, np.random.Generator],
) -> Calibration:  # fmt: skip
    """Fly the calibration, and fill the plant's LOCALISATION and the belief's FUSION records.

    Raises InputError where the calibration finds too little.
    """
    assert robot.prism is not None and robot.tracking_camera is not None
    station, camera = build_sensors(robot, world, streams)
    clock = world.total_station.clock_s * streams["station"].standard_normal()
    path = build_inspection_path(seed, world.total_station.calibration_s, CALIBRATION_SPEED)
    seen = record_flight(
        path, station, camera, streams["station"], streams["camera"], station_clock=float(clock)
    )
    try:
        offset = estimate_offset(seen.station, seen.camera).offset
        found = calibrate(seen.station, seen.camera, offset, p_BP=np.array(station[0]["p_BP"]))
    except InputError as error:
        raise InputError(
            "world.total_station and robot.tracking_camera cannot be calibrated on a flight of "
            f"{world.total_station.calibration_s:g} s: {error}"
        ) from error
    fill_localisation(plant["localisation"], station[0], camera[0], float(clock), robot, streams)
    _fill_fusion(fus, found, robot, world)
    return found


def _fill_fusion(fus: Record, found: Calibration, robot: Robot, world: World) -> None:
    """What the filter knows: data sheets, and what the calibration found."""
    prism, camera = robot.prism, robot.tracking_camera
    assert prism is not None and camera is not None
    drift = DriftModel(0.0, 0.0, 0.0, 0.0)
    middle = found.span[0] + 0.5 * (found.span[1] - found.span[0])
    fus["lag"], fus["p_BP"] = LAG, [prism.x_m, prism.y_m, prism.z_m]
    fus["R_WC"], fus["scale"] = found.frame.rotation, found.frame.scale
    fus["clock"] = -(found.time_offset + found.skew * (middle - found.epoch))
    fus["r_fix"] = max(found.noise.station, 1e-4) ** 2
    fus["r_odo"] = max(camera.noise_m, 1e-5) ** 2
    fus["r_odo_R"] = max(camera.attitude_noise_rad, 1e-5) ** 2
    fus["q_walk_m"] = max(found.noise.per_sqrt_m, 1e-3) ** 2
    fus["q_walk_s"] = max(found.noise.per_sqrt_s, 1e-4) ** 2
    fus["q_yaw"], fus["q_tilt"], fus["q_scale"] = drift.yaw**2, drift.tilt**2, drift.scale**2
    fus["std_0"] = [
        math.hypot(found.rotation_std, TILT_SINCE), math.hypot(found.rotation_std, HEADING_SINCE),
        math.hypot(found.scale_std, SCALE_SINCE), math.hypot(found.offset_std, CLOCK_SINCE),
    ]  # fmt: skip
    if robot.range_finder is not None:
        r = robot.range_finder
        fus["r_range"] = max(r.noise_m, 1e-5) ** 2 + r.resolution_m**2 / 12.0
        fus["bias_0"] = r.bias_m
