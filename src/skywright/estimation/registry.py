"""Estimators by name, and the parameters that they take from data sheets.

An estimator is a module with `step_c`: a cfunc of the one signature (core/signature.py) that reads
`meas`, `body` and `cmd` of a BELIEF and fills `est`. The loop calls it by address, so another one
recompiles nothing.
"""

from __future__ import annotations

import importlib
import math
from typing import Any, NamedTuple

from skywright.errors import InputError
from skywright.models.rotors import build_rotors
from skywright.robots.spec import Robot
from skywright.worlds.spec import World

ESTIMATORS = {
    "filter": "skywright.estimation.error_state",
    "observer": "skywright.estimation.observer",
    # the plant's own state; the filter runs beneath for the external force and the tip's samples
    "truth": "skywright.estimation.error_state",
}

TIP_WALK = 5e-4
"""m/sqrt(s): walk of the tip's correction; the gain is then a bandwidth of about 12 rad/s."""


class Estimator(NamedTuple):
    """An estimator ready to fly."""

    name: str
    compiled: Any  # numba cfunc


def load_estimator(name: str) -> Estimator:
    """Return the estimator called `name`; raises InputError for an unknown one."""
    if name not in ESTIMATORS:
        raise InputError(f"estimator {name!r} is unknown; valid: {', '.join(sorted(ESTIMATORS))}")
    return Estimator(name, importlib.import_module(ESTIMATORS[name]).step_c)


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
