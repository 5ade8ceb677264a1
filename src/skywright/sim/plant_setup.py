"""Fill the plant's record from robot, world and the deviation of the truth from the belief."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.streams import build_stream
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.description.world.surface import build_cylinder
from skywright.description.world.things import find_first
from skywright.models.arm_body import Deviation, compute_servo_gains, compute_servo_lag
from skywright.models.compliant_arms import count_command_ticks, is_compliant
from skywright.models.force_sensor import build_force_sensor
from skywright.models.rotors import build_rotors, compute_watt_per_n15
from skywright.models.scene import Scene
from skywright.models.things.tape import Tape
from skywright.sim.camera import fill_camera
from skywright.sim.friction import fill_friction
from skywright.sim.limb_drag import fill_limbs
from skywright.sim.loads import fill_loads
from skywright.sim.plant import PLANT
from skywright.sim.surface_effects import fill_surface
from skywright.sim.tape import fill_tape
from skywright.sim.wind import fill_wind


def build_plant(
    robot: Robot, world: World, scene: Scene, dev: Deviation, seed: int
) -> NDArray[Any]:
    """Fill the PLANT record from robot, world and deviation."""
    out = np.zeros(1, PLANT)
    pl, rotors, index = out[0], build_rotors(robot.rotors), scene.places
    n = len(rotors.thrust_min)
    pl["n_rotors"], pl["n_joints"] = n, scene.n_joints
    pl["rotor_p"][:n], pl["rotor_axis"][:n] = rotors.position, rotors.axis
    pl["k_f"], pl["rotor_tau"] = rotors.k_f, rotors.time_constant
    pl["rotor_drag"] = rotors.drag_coefficient * dev.drag_factor
    pl["watt_per_n15"] = compute_watt_per_n15(rotors, world.air_density_kg_m3)
    pl["avionics"] = robot.battery.avionics_power_w
    p = robot.platform
    areas = np.array([p.drag_area_x_m2, p.drag_area_y_m2, p.drag_area_z_m2])
    pl["half_rho_area"] = 0.5 * world.air_density_kg_m3 * areas * dev.drag_factor
    fill_limbs(pl["limbs"], robot, scene.model, world.air_density_kg_m3)
    fill_wind(
        pl["wind"], world.wind, rotors.position, 1.0 / robot.control.rate_hz,
        build_stream(seed, "wind_start"),
    )  # fmt: skip
    pl["joint_qpos"][: scene.n_joints] = index.joint_qpos
    pl["joint_dof"][: scene.n_joints] = index.joint_dof
    n_joints = scene.n_joints
    if robot.arm is not None and n_joints:
        n_servos = len(list_servos(robot))
        belt = np.eye(n_servos) if robot.arm.belt is None else np.array(robot.arm.belt)
        pl["motor_from_joint"][:n_servos, :n_servos] = np.linalg.inv(belt)
        for j, (_, servo) in enumerate(list_servos(robot)):
            pl["servo_lag"][j] = servo.stall_torque_nm / compute_servo_gains(robot, j)[0]
    pl["slider_qpos"], pl["platform"] = index.slider_qpos, index.platform_body
    pl["tip_site"], pl["tip_force"] = index.tip_site, index.sensor_tip_force
    pl["n_collision"] = len(index.sensor_collision)
    pl["collision"][: len(index.sensor_collision)] = index.sensor_collision
    pl["marker_T"] = dev.marker_error
    pl["com_B"] = scene.model.body_ipos[index.platform_body]
    # sensors
    pl["enc_lsb"] = 2.0 * math.pi / 4096
    pl["enc_offset"][: len(dev.joint_offset)] = dev.joint_offset
    servos = list_servos(robot)
    for j, limb in enumerate(list_joints(robot)):
        pl["joint_servo"][j] = limb.servo
        if limb.servo >= 0:
            pl["enc_lsb"][j] = 2.0 * math.pi / servos[limb.servo][1].encoder_counts
    if is_compliant(robot):
        _fill_position_servos(pl, robot, world, scene, seed)
    pl["n_objects"] = len(index.object_qpos)
    pl["object_qpos"][: len(index.object_qpos)] = index.object_qpos
    fill_loads(pl["loads"], scene.model)
    fill_camera(pl["camera"], robot, world, index.object_qpos, dev.pipe_error)
    m = world.mocap
    pl["mocap_period"], pl["mocap_latency"] = 1.0 / m.rate_hz, m.latency_s
    pl["mocap_sigma_p"], pl["mocap_sigma_R"] = m.position_noise_m, m.attitude_noise_rad
    pl["mocap_dropout"], pl["mocap_last"] = m.dropout_fraction, -1.0 / m.rate_hz
    pl["mocap_outlier"], pl["mocap_outlier_size"] = m.outlier_fraction, m.outlier_m
    if world.pipe is not None:
        cyl = build_cylinder(world.pipe)
        pl["has_pipe"] = int(robot.probe is not None)
        pl["p_WP"], pl["R_WP"], pl["radius"] = cyl.p_WP, cyl.R_WP, cyl.radius
        pl["half_length"] = cyl.half_length
        fill_friction(pl["friction"], world.pipe, build_stream(seed, "friction"))
    if robot.probe is not None:
        pl["tip_radius"] = robot.probe.tip_radius_m
        if robot.force_sensor is not None:
            pl["force_on"] = 1
            pl["force_sensor"] = build_force_sensor(robot.force_sensor)[0]
            pl["force_spring"] = robot.probe.spring_n_per_m
            pl["force_preload"] = robot.probe.spring_preload_n
    pl["docking_force"] = index.sensor_docking
    fill_surface(pl["surface"], world, robot.rotors.propeller_radius_m)
    return out


def _fill_position_servos(pl: Any, robot: Robot, world: World, scene: Scene, seed: int) -> None:
    """Servos that take angles, springs with their encoders, and hands."""
    index = scene.places
    servos, joints = list_servos(robot), list_joints(robot)
    pl["positioned"] = 1
    pl["servo_every"] = count_command_ticks(robot)
    pl["deflection_slot"] = -1
    pl["flex_qpos"] = -1
    for j, limb in enumerate(joints):
        pl["flex_qpos"][j] = index.flex_qpos[j]
        pl["deflection_on"][j] = int(limb.link.deflection_encoder)
        if limb.servo >= 0:
            servo = servos[limb.servo][1]
            pl["servo_lsb"][j] = math.radians(servo.resolution_deg)
            pl["servo_speed"][j] = servo.no_load_speed_rad_s
            pl["servo_tau"][j] = compute_servo_lag(servo)
    pl["deflection_wave"][: len(joints)] = build_stream(seed, "deflection").uniform(
        0.0, 2.0 * math.pi, len(joints)
    )
    pl["n_hands"] = len(index.hand_sites)
    pl["hand_site"][: len(index.hand_sites)] = index.hand_sites
    pl["hand_force"] = -1
    pl["hand_force"][: len(index.hand_sites)] = index.sensor_hand_force
    fill_tape(pl["tape"], find_first(world.things, Tape), index.hand_bodies)
