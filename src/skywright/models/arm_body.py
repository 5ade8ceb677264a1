"""The arm's bodies in the scene: links, flexibility, sprung probe and servos."""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from skywright.core.rotations import quat_from_rot, rot_y
from skywright.models.rigid_body import (
    SLIDER_INERTIA,
    build_probe_parts,
    joint_names,
    link_com,
    link_offset,
    rod_inertia,
)
from skywright.robots.spec import Link, Robot

Array = NDArray[np.float64]

# contype/conaffinity: robot parts collide with the world, not with each other; the probe's pen
# with everything but the pipe, which only its tip may touch
ROBOT, WORLD, FEET, PEN = 1, 2, 4, 8
STOP_SLACK = math.radians(5.0)


class Deviation(NamedTuple):
    """How the plant differs from the nominal model (drawn from the root `plant`)."""

    mass_factor: float = 1.0
    inertia_factor: float = 1.0
    com_error: Array = np.zeros(3)
    rotor_gain: Array = np.ones(0)  # (n,) factor on each rotor's thrust
    link_length_error: float = 0.0
    joint_offset: Array = np.zeros(0)  # (n_joints,) rad, encoder zero error
    drag_factor: float = 1.0
    marker_error: Array = np.zeros(3)  # m, in T: where motion capture believes the tip to be


def add_arm(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: Robot, dev: Deviation, plant: bool
) -> None:
    """Add the arm's links, its probe and, in the plant, flexibility and servos."""
    assert robot.arm is not None
    names = list(robot.arm.links)
    bodies: list[mujoco.MjsBody] = []
    for i, (name, link) in enumerate(robot.arm.links.items()):
        parent, offset = link_offset(robot, name)
        last_parent = parent == len(names) - 2 and i == len(names) - 1
        if last_parent:  # calibration error: the second-last link is longer than believed
            offset = offset + np.array([dev.link_length_error, 0.0, 0.0])
        body = (base if parent < 0 else bodies[parent]).add_body(name=name, pos=offset)
        _add_link_joints(body, name, link, plant, robot)
        body.mass = link.mass_kg * dev.mass_factor
        body.ipos = [link_com(link), 0.0, 0.0]
        body.inertia = np.diag(rod_inertia(body.mass, link.length_m, link.radius_m))
        body.explicitinertial = True
        body.add_geom(
            name=f"{name} shell", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[link.radius_m, 0, 0],
            fromto=[0, 0, 0, link.length_m, 0, 0], rgba=[0.9, 0.55, 0.1, 1],
            contype=ROBOT, conaffinity=WORLD, mass=0.0,
        )  # fmt: skip
        bodies.append(body)
    tip = bodies[-1]
    if robot.probe is not None:
        _add_probe(spec, bodies, robot, dev, plant)
    else:
        tip.add_site(name="tip", pos=[robot.arm.links[names[-1]].length_m, 0, 0])
    if plant:
        _add_servos(spec, robot)


def _add_link_joints(
    body: mujoco.MjsBody, name: str, link: Link, plant: bool, robot: Robot
) -> None:
    if link.joint == "fixed":
        return
    axis = [float(link.axis == a) for a in "xyz"]
    slide = link.joint == "slide"
    joint = body.add_joint(
        name=name, axis=axis,
        type=mujoco.mjtJoint.mjJNT_SLIDE if slide else mujoco.mjtJoint.mjJNT_HINGE,
    )  # fmt: skip
    if not plant:
        return
    assert robot.arm is not None
    if not slide:  # mechanical stops, a little beyond what the controllers may use
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = [
            math.radians(link.joint_min_deg) - STOP_SLACK,
            math.radians(link.joint_max_deg) + STOP_SLACK,
        ]
    index = joint_names(robot).index(name)
    joint.armature = list(robot.arm.servos.values())[index].armature_kgm2
    if link.flex_stiffness_nm_per_rad is not None:
        inertia = compute_inertia_beyond(robot, name)
        k = link.flex_stiffness_nm_per_rad
        flex = body.add_joint(name=f"{name} flex", axis=axis, type=mujoco.mjtJoint.mjJNT_HINGE)
        flex.stiffness = np.array([k, 0.0, 0.0]) if np.ndim(flex.stiffness) else k
        damping = 2.0 * link.flex_damping_ratio * math.sqrt(k * inertia)
        flex.damping = np.array([damping, 0.0, 0.0]) if np.ndim(flex.damping) else damping


def compute_inertia_beyond(robot: Robot, name: str) -> float:
    """Inertia (kg m^2) about joint `name` of everything that hangs on it, arm stretched."""
    assert robot.arm is not None
    names = list(robot.arm.links)
    probe_on = (robot.probe.on or names[-1]) if robot.probe is not None else None
    total, reach = 0.0, {name: 0.0}  # reach: distance of a link's joint from joint `name`
    for other in names[names.index(name) :]:
        link = robot.arm.links[other]
        if other != name:
            parent = link_offset(robot, other)[0]
            if parent < 0 or names[parent] not in reach:
                continue  # another branch
            before = names[parent]
            reach[other] = reach[before] + robot.arm.links[before].length_m
        start = reach[other]
        total += link.mass_kg * (link.length_m**2 / 12 + (start + link_com(link)) ** 2)
        if robot.probe is not None and other == probe_on:
            middle = start + link.length_m + 0.5 * robot.probe.length_m
            total += robot.probe.mass_kg * middle**2
    return total


def compute_servo_gains(robot: Robot, index: int) -> tuple[float, float]:
    """Return (kp N m/rad, kv N m s/rad) of servo `index`: a PD around the integrated command.

    Critically damped at the bandwidth 1/T of the servo for the inertia that the motor turns.
    """
    assert robot.arm is not None
    servo = list(robot.arm.servos.values())[index]
    inertia = servo.armature_kgm2 + compute_inertia_beyond(robot, joint_names(robot)[index])
    w = 1.0 / servo.velocity_time_constant_s
    return inertia * w * w, 2.0 * inertia * w


def _add_probe(
    spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], robot: Robot, dev: Deviation, plant: bool
) -> None:
    assert robot.arm is not None and robot.probe is not None
    probe, parts = robot.probe, build_probe_parts(robot.probe)
    names = list(robot.arm.links)
    on = names.index(probe.on) if probe.on else len(names) - 1
    length = robot.arm.links[names[on]].length_m
    # holder frame: x along the probe's axis
    quat = quat_from_rot(rot_y(math.radians(probe.pitch_deg)))
    holder = bodies[on].add_body(name="holder", pos=[length, 0, 0], quat=quat)
    holder.mass = parts.holder_mass * dev.mass_factor
    holder.ipos = [parts.holder_length / 2, 0, 0]
    holder.inertia = np.diag(rod_inertia(holder.mass, parts.holder_length, probe.radius_m))
    holder.explicitinertial = True
    holder.add_geom(
        name="holder shell", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[probe.radius_m, 0, 0],
        fromto=[0, 0, 0, parts.holder_length, 0, 0], rgba=[0.9, 0.9, 0.9, 1],
        contype=ROBOT, conaffinity=WORLD, mass=0.0,
    )  # fmt: skip
    slider = holder.add_body(name="slider")
    slider.mass = parts.slider_mass * dev.mass_factor
    slider.ipos = [parts.slider_com, 0, 0]
    slider.inertia = [SLIDER_INERTIA] * 3
    slider.explicitinertial = True
    slider.add_geom(
        name="tip", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[probe.tip_radius_m, 0, 0],
        pos=[probe.length_m - probe.tip_radius_m, 0, 0], rgba=[0.9, 0.1, 0.1, 1],
        contype=0, conaffinity=0, mass=0.0,
    )  # fmt: skip
    slider.add_geom(
        name="pen", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.6 * probe.radius_m, 0, 0],
        fromto=[parts.holder_length, 0, 0, probe.length_m - 2.0 * probe.tip_radius_m, 0, 0],
        rgba=[0.2, 0.2, 0.2, 1], contype=PEN, conaffinity=0, mass=0.0,
    )  # fmt: skip
    # site frame T: z along the probe, y along the link's y
    to_tip = quat_from_rot(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
    slider.add_site(name="tip", pos=[probe.length_m, 0, 0], quat=to_tip)
    if plant:
        k = probe.spring_n_per_m
        joint = slider.add_joint(
            name="spring", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=[-probe.spring_travel_m, 0.0],
        )  # fmt: skip
        joint.stiffness = np.array([k, 0.0, 0.0]) if np.ndim(joint.stiffness) else k
        damping = 2.0 * probe.spring_damping_ratio * math.sqrt(k * parts.slider_mass)
        joint.damping = np.array([damping, 0.0, 0.0]) if np.ndim(joint.damping) else damping
        joint.springref = probe.spring_preload_n / k
        joint.solref_limit = [0.004, 1.0]


def _add_servos(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Velocity servos: integrated command tracked by a PD with torque and speed limits.

    Through the belt a motor's angle is a fixed combination of joints: q_M = J_AM^-1 q_A.
    """
    assert robot.arm is not None
    joints = joint_names(robot)
    n = len(joints)
    belt = np.array(robot.arm.belt) if robot.arm.belt is not None else np.eye(n)
    motor_from_joint = np.linalg.inv(belt)
    for i, (name, servo) in enumerate(robot.arm.servos.items()):
        tendon = spec.add_tendon(name=name)
        for j, joint in enumerate(joints):
            if abs(motor_from_joint[i, j]) > 1e-12:
                tendon.wrap_joint(joint, motor_from_joint[i, j])
        kp, kv = compute_servo_gains(robot, i)
        act = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON,
            dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR, dynprm=[1.0] + [0.0] * 9,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED, gainprm=[kp] + [0.0] * 9,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE, biasprm=[0.0, -kp, -kv] + [0.0] * 7,
        )  # fmt: skip
        act.ctrllimited = act.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        act.ctrlrange = [-servo.no_load_speed_rad_s, servo.no_load_speed_rad_s]
        act.forcerange = [-servo.stall_torque_nm, servo.stall_torque_nm]
