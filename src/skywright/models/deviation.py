"""Draws the perturbed plant of one run from the root `plant`."""

import math

import numpy as np

from skywright.core.arrays import Array
from skywright.core.streams import build_stream
from skywright.description.mission.spec import Plant
from skywright.description.robot.limbs import list_limbs
from skywright.description.robot.spec import Robot
from skywright.models.arm_body import Deviation
from skywright.models.rigid_body import joint_names


def build_socket_error(plant: Plant) -> Array:
    """Return the true pose of static tracked things relative to the world file: (6,) m, rad."""
    turn = [
        plant.socket_roll_error_deg, plant.socket_pitch_error_deg, plant.socket_yaw_error_deg
    ]  # fmt: skip
    place = [plant.socket_x_error_m, plant.socket_y_error_m, plant.socket_z_error_m]
    return np.array([*place, *np.radians(turn)])


def build_deviation(plant: Plant, robot: Robot, seed: int) -> Deviation:
    """Draw the plant of a run: the stated errors, and the rotors' spread from the seed."""
    rng = build_stream(seed, "plant")
    n = len(robot.rotors.azimuth_deg)
    gain = (1.0 + plant.rotor_gain_error) * (
        1.0 + plant.rotor_gain_spread * np.clip(rng.standard_normal(n), -3.0, 3.0)
    )
    n_joints = len(joint_names(robot))
    markers = [np.clip(rng.standard_normal(k), -3.0, 3.0) for k in (3, 3, 6)]
    n_links = len(list_limbs(robot))
    springs = 1.0 + plant.spring_spread * np.clip(rng.standard_normal(n_joints + 1), -3.0, 3.0)
    zeros, lengths, camera = (
        np.clip(rng.standard_normal(k), -3.0, 3.0) for k in (n_joints, n_links, 6)
    )
    zeros = plant.joint_offset_error_deg + plant.joint_offset_spread_deg * zeros
    return Deviation(
        mass_factor=1.0 + plant.mass_error,
        inertia_factor=1.0 + plant.inertia_error,
        com_error=np.array([plant.com_x_error_m, plant.com_y_error_m, plant.com_z_error_m]),
        rotor_gain=gain,
        link_length_error=plant.link_length_error_m,
        link_length_errors=plant.link_length_spread_m * lengths,
        joint_offset=np.radians(zeros),
        drag_factor=1.0 + plant.drag_error,
        marker_error=plant.marker_error_m * markers[0],
        pipe_error=plant.marker_error_m * markers[1],
        socket_error=build_socket_error(plant),
        survey_error=np.repeat([plant.survey_error_m, math.radians(plant.survey_error_deg)], 3)
        * markers[2],
        camera_error=np.repeat(
            [plant.probe_camera_error_m, math.radians(plant.probe_camera_error_deg)], 3
        )
        * camera,
        spring_factor=(1.0 + plant.spring_error) * springs[:-1],
        hardening_factor=1.0 + plant.hardening_error,
        backlash_factor=1.0 + plant.backlash_error,
        servo_lag_factor=1.0 + plant.servo_lag_error,
        probe_spring_factor=(1.0 + plant.spring_error) * float(springs[-1]),
        sensor_noise_error=plant.sensor_noise_error,
    )
