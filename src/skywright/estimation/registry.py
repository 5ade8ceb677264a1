"""Estimators by name, and the parameters that they take from data sheets.

An estimator is a module with `step_c`: a cfunc of the one signature (core/signature.py) that reads
`meas`, `body` and `cmd` of a BELIEF and fills `est`. The loop calls it by address, so another one
recompiles nothing.
"""

from __future__ import annotations

import importlib
import math
from typing import Any, NamedTuple

import numpy as np

from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.things import find_first
from skywright.errors import InputError
from skywright.models.rotors import build_rotors
from skywright.models.things.marker import Marker

ESTIMATORS = {
    "filter": "skywright.estimation.error_state",
    "observer": "skywright.estimation.observer",
    # the plant's own state; the filter runs beneath for the external force and the tip's samples
    "truth": "skywright.estimation.error_state",
}

STATION = "skywright.estimation.station_camera"
"""The filter, also beneath the truth, where a total station takes the place of motion capture."""

TIP_WALK = 5e-4
"""m/sqrt(s): walk of the tip's correction; the gain is then a bandwidth of about 12 rad/s."""


class Estimator(NamedTuple):
    """An estimator ready to fly."""

    name: str
    compiled: Any  # numba cfunc


def load_estimator(name: str, localisation: str = "mocap") -> Estimator:
    """Return the estimator called `name` for a world's localisation; InputError if unknown."""
    if name not in ESTIMATORS:
        raise InputError(f"estimator {name!r} is unknown; valid: {', '.join(sorted(ESTIMATORS))}")
    module = STATION if localisation == "total-station" else ESTIMATORS[name]
    return Estimator(name, importlib.import_module(module).step_c)


def check_localisation(name: str, robot: Robot, world: World) -> None:
    """Raise InputError where a robot or an estimator cannot do with the world's localisation."""
    kind = world.localisation
    if kind == "mocap":
        return
    says = f"world.localisation = {kind!r} tells a place and a heading only: "
    if name == "observer":
        raise InputError(f"{says}mission.estimator = 'observer' needs motion capture; use 'filter'")
    if find_first(world.things, Marker) is not None and robot.camera is None:
        raise InputError(f"{says}a marker needs motion capture, or robot.camera to see it")
    if world.pipe is not None and world.pipe.tracked:
        raise InputError(f"{says}world.pipe.tracked needs motion capture")
    if robot.probe is not None and (kind == "gnss" or robot.force_sensor is None):
        raise InputError(
            f"{says}the probe of {robot.name!r} needs the markers that motion capture sees"
        )
    if kind == "gnss":
        return
    missing = [
        f"[robot.{part}]" for part in ("prism", "tracking_camera") if getattr(robot, part) is None
    ]
    if missing:
        raise InputError(
            f"world.localisation = {kind!r}: robot {robot.name!r} has no "
            f"{' and no '.join(missing)}; give it one, or set world.localisation='mocap'"
        )


def fill_parameters(belief: Any, robot: Robot, world: World, imu_period: float) -> None:
    """Write the parameters of all estimators into a BELIEF record.

    They are what data sheets say: noise densities, stated accuracy of the motion capture, and the
    vibration at hover.
    """
    s, m = robot.sensors, world.mocap
    rotors = build_rotors(robot.rotors)
    obs, flt = belief["obs"], belief["flt"]
    obs["bandwidth"] = robot.control.observer_bandwidth_rad_s
    obs["rotor_tau"] = rotors.time_constant
    flt["h"] = imu_period
    flt["p_BI"] = [s.imu_x_m, s.imu_y_m, s.imu_z_m]
    flt["q_v"], flt["q_R"] = s.accel_noise_mps2_sqrthz**2, s.gyro_noise_rad_s_sqrthz**2
    flt["q_ba"], flt["q_bg"] = s.accel_walk_mps3_sqrthz**2, s.gyro_walk_rad_s2_sqrthz**2
    flt["p_ba"], flt["p_bg"] = s.accel_bias_mps2**2, s.gyro_bias_rad_s**2
    # a fix's correlated errors look like motion: they are not weighed, and stay in the estimate
    fix = world.gnss.errors
    flt["p_BF"] = [s.antenna_x_m, s.antenna_y_m, s.antenna_z_m]
    flt["r_fix"] = np.maximum([fix.noise_level_m, fix.noise_level_m, fix.noise_up_m], 1e-5) ** 2
    flt["r_heading"] = max(math.radians(fix.heading_noise_deg), 1e-5) ** 2
    # a perfect sensor would leave nothing to weigh: a floor far below any real one
    flt["r_p"] = max(m.position_noise_m, 1e-5) ** 2
    flt["r_R"] = max(m.attitude_noise_rad, 1e-5) ** 2
    # velocity and attitude shake with the integral of what the rotors do to the unit at hover
    mass = float(belief["body"]["mass"])
    n = len(rotors.thrust_min)
    share = mass * world.gravity_mps2 / (n * robot.rotors.thrust_max_n)
    speed = math.sqrt(share * robot.rotors.thrust_max_n / rotors.k_f)
    flt["vibration_v"] = 0.5 * n * (s.vibration_mps2 * share / speed) ** 2
    flt["vibration_R"] = 0.5 * n * (s.vibration_rad_s * share / speed) ** 2
    flt["q_c"] = TIP_WALK**2
    flt["r_c"] = 2.0 * flt["r_p"]  # the platform's own error counts too
    flt["P_c"] = 1e-4
