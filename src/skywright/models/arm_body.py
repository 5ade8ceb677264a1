"""Bodies of the arm in the scene: links, flexibility, hands, sprung probe and servos."""

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import quat_from_rot, rot_y
from skywright.description.robot.arm import Link, Servo
from skywright.description.robot.limbs import (
    SIDES,
    Limb,
    end_of,
    list_grippers,
    list_joints,
    turn_of,
)
from skywright.description.robot.spec import Robot
from skywright.models.deviated_arm import list_true_limbs, list_true_servos
from skywright.models.gripper_body import add_fingers, add_grip_motor
from skywright.models.part_masses import (
    SLIDER_INERTIA,
    build_hand_body,
    build_probe_parts,
    link_com,
    link_direction,
    link_inertia,
    rod_inertia,
    set_inertia,
    tip_rotation,
)
from skywright.models.rigid_body import find_tip
from skywright.models.servo_gains import compute_inertia_beyond, compute_servo_gains

# contype/conaffinity. Robot parts collide with the world; arms also collide with arms and
# propellers (OWN, self_contact.py), but not with hub, booms and legs, whose coarse shapes surround
# the arms' mounts. The probe's pen collides with everything but the pipe, which only its tip may
# touch.
ROBOT, WORLD, FEET, PEN, OWN = 1, 2, 4, 8, 16
STOP_SLACK = math.radians(5.0)
SLIDE_SLACK = 0.002  # m
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
LIMITED = mujoco.mjtLimited.mjLIMITED_TRUE


class Deviation(NamedTuple):
    """Deviation of the plant from the nominal model, drawn from the root `plant`."""

    mass_factor: float = 1.0
    inertia_factor: float = 1.0
    com_error: Array = np.zeros(3)
    rotor_gain: Array = np.ones(0)  # (n,) factor on each rotor's thrust
    link_length_error: float = 0.0
    link_length_errors: Array = np.zeros(0)  # (n_links,) m, of links that carry another link
    joint_offset: Array = np.zeros(0)  # (n_joints,) rad, encoder zero error
    drag_factor: float = 1.0
    marker_error: Array = np.zeros(3)  # m, in T: error of the tip's position in motion capture
    pipe_error: Array = np.zeros(3)  # m, in W: error of a tracked pipe in motion capture
    socket_error: Array = np.zeros(6)  # m, rad: deviation of a socket from the world file
    survey_error: Array = np.zeros(6)  # m, rad: of motion capture's measurement of the socket
    camera_error: Array = np.zeros(6)  # m, rad: pose error of the probe's camera in T
    spring_factor: Array = np.ones(0)  # (n_joints,) on the stiffness of each joint's spring
    hardening_factor: float = 1.0  # on stiffness beyond the linear range over that within
    backlash_factor: float = 1.0
    servo_lag_factor: float = 1.0
    probe_spring_factor: float = 1.0
    sensor_noise_error: float = 0.0  # 1 sigma of the logarithm: models/deviated_sensors.py


def add_arm(
    spec: mujoco.MjSpec, base: mujoco.MjsBody, robot: Robot, dev: Deviation, plant: bool
) -> None:
    """Add the arms' links, hands and probe, and in the plant flexibility and servos."""
    limbs, servos = list_true_limbs(robot, dev), list_true_servos(robot, dev)
    last = [max(i for i, x in enumerate(limbs) if x.side == side) for side in _sides(limbs)]
    bodies: list[mujoco.MjsBody] = []
    for i, limb in enumerate(limbs):
        link, offset = limb.link, np.array(limb.offset)
        if i in last and limb.parent >= 0 and limb.parent == i - 1:
            # calibration error: the true second-last link is longer than the nominal one
            offset = offset + dev.link_length_error * link_direction(limbs[limb.parent].link)
        if limb.parent >= 0 and len(dev.link_length_errors):
            longer = dev.link_length_errors[limb.parent]
            offset = offset + longer * link_direction(limbs[limb.parent].link)
        body = (base if limb.parent < 0 else bodies[limb.parent]).add_body(
            name=limb.name, pos=offset
        )
        if link.is_turned:
            body.quat = quat_from_rot(turn_of(link))
        _add_link_joints(body, i, limbs, servos, plant, robot)
        body.mass = link.mass_kg * dev.mass_factor
        body.ipos = link_com(link)
        set_inertia(body, link_inertia(link) * dev.mass_factor)
        body.add_geom(
            name=f"{limb.name} shell", type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[link.radius_m, 0, 0], fromto=[0, 0, 0, *_shell_end(robot, limbs, i, i in last)],
            rgba=[0.9, 0.55, 0.1, 1],
            contype=ROBOT | OWN, conaffinity=WORLD | OWN, mass=0.0,
        )  # fmt: skip
        bodies.append(body)
    tip = find_tip(robot, limbs)
    for side, i in zip(_sides(limbs), last, strict=True):
        if robot.probe is None or side != limbs[tip].side:  # an arm has a hand or the probe
            _add_hand(bodies[i], side, limbs[i].link, robot, dev, plant, is_tip=i == tip)
    if robot.probe is not None:
        _add_probe(spec, bodies[tip], limbs[tip], robot, dev, plant)
    if plant:
        _add_servos(spec, robot, servos)
        for limb in limbs:
            _add_springs(spec, limb, servos)
        assert robot.arm is not None
        for hand in list_grippers(robot):
            add_grip_motor(spec, f"hand{SIDES.index(hand)}", robot.arm.hand)


def _shell_end(robot: Robot, limbs: list[Limb], i: int, is_last: bool) -> Array:
    """Return the end (3,) m of a link's capsule: a hand's ball must protrude from it, also along
    the link."""
    assert robot.arm is not None
    end, hand, link = np.array(end_of(limbs[i].link)), robot.arm.hand, limbs[i].link
    if not is_last or hand.mass_kg == 0.0:
        return end
    if robot.probe is not None and limbs[i].side == limbs[find_tip(robot, limbs)].side:
        return end
    ball = hand.radius_m + link.radius_m
    return end * max(min(1.0, 1.0 + (hand.length_m - ball) / link.length_m), 0.1)


def _sides(limbs: list[Limb]) -> list[int]:
    return sorted({limb.side for limb in limbs if limb.side >= 0})


def _add_link_joints(
    body: mujoco.MjsBody,
    index: int,
    limbs: list[Limb],
    servos: list[tuple[str, Servo]],
    plant: bool,
    robot: Robot,
) -> None:
    name, link = limbs[index].name, limbs[index].link
    if link.joint == "fixed":
        return
    axis = [float(link.axis == a) for a in "xyz"]
    slide = link.joint == "slide"
    joint = body.add_joint(name=name, axis=axis, type=SLIDE if slide else HINGE)
    if not plant:
        return
    if not _is_soft(link):
        joint.limited, joint.range = LIMITED, _stops(link)
    if link.passive:
        _set_coefficient(joint, "damping", link.damping_nms_per_rad)
        joint.frictionloss = link.friction_nm
    elif robot.arm is not None and robot.arm.belt is None:  # through a belt: _add_servos
        joint.armature = servos[limbs[index].servo][1].armature_kgm2
    if link.flex_stiffness_nm_per_rad is not None:
        k = link.flex_stiffness_nm_per_rad
        flex = body.add_joint(name=f"{name} flex", axis=axis, type=HINGE)
        damping = link.flex_damping_nms_per_rad
        if damping is None:
            inertia = compute_inertia_beyond(robot, index)
            damping = 2.0 * link.flex_damping_ratio * math.sqrt(k * inertia)
        _set_coefficient(flex, "damping", damping)
        slack = 0.5 * _backlash(limbs[index], servos)
        if slack == 0.0:
            _set_coefficient(flex, "stiffness", k)
        if link.flex_linear_deg is not None and link.flex_beyond == "stop":
            end = math.radians(link.flex_linear_deg) + slack
            flex.limited, flex.range = LIMITED, [-end, end]
            flex.solref_limit = [0.01, 1.0]
    if link.lateral_stiffness_nm_per_rad is not None:
        k, inertia = link.lateral_stiffness_nm_per_rad, compute_inertia_beyond(robot, index)
        across = [1.0, 0.0, 0.0] if link.axis == "y" else [0.0, 1.0, 0.0]
        bend = body.add_joint(name=f"{name} lateral", axis=across, type=HINGE)
        _set_coefficient(bend, "stiffness", k)
        damping = 2.0 * link.lateral_damping_ratio * math.sqrt(k * inertia)
        _set_coefficient(bend, "damping", damping)


def _is_soft(link: Link) -> bool:
    """Whether a joint has a compliant spring, so that shaft and output link differ in angle."""
    return link.flex_stiffness_nm_per_rad is not None and link.flex_linear_deg is not None


def _stops(link: Link) -> list[float]:
    """Return the mechanical stops (rad; slides: m) of a link, slightly beyond the usable range."""
    slack = STOP_SLACK if link.joint == "hinge" else SLIDE_SLACK
    return [link.reach[0] - slack, link.reach[1] + slack]


def _backlash(limb: Limb, servos: list[tuple[str, Servo]]) -> float:
    """Return the backlash (rad) of a link's servo."""
    return math.radians(servos[limb.servo][1].backlash_deg) if limb.servo >= 0 else 0.0


def _add_springs(spec: mujoco.MjSpec, limb: Limb, servos: list[tuple[str, Servo]]) -> None:
    """Add the springs that are not plain joint springs: those with play, and the hardening part."""
    link = limb.link
    k, slack = link.flex_stiffness_nm_per_rad, 0.5 * _backlash(limb, servos)
    if k is None:
        return
    if _is_soft(link):
        # the stop limits the output link, in its frame; the servo's shaft turns further by the
        # deflection
        tendon = spec.add_tendon(name=f"{limb.name} stop", limited=LIMITED, range=_stops(link))
        tendon.wrap_joint(limb.name, 1.0)
        tendon.wrap_joint(f"{limb.name} flex", 1.0)
    if slack > 0.0:  # the gear's play is in series with the spring: no torque within it
        tendon = spec.add_tendon(name=f"{limb.name} spring")
        tendon.wrap_joint(f"{limb.name} flex", 1.0)
        _set_coefficient(tendon, "stiffness", k)
        tendon.springlength = [-slack, slack]
    if link.flex_linear_deg is not None and link.flex_beyond == "hardening":
        end = math.radians(link.flex_linear_deg) + slack
        tendon = spec.add_tendon(name=f"{limb.name} hard spring")
        tendon.wrap_joint(f"{limb.name} flex", 1.0)
        _set_coefficient(tendon, "stiffness", k * (link.flex_hardening - 1.0))
        tendon.springlength = [-end, end]


def _set_coefficient(thing: Any, name: str, value: float) -> None:
    """Set a stiffness or damping, which MuJoCo may store as the coefficients of a polynomial."""
    poly = np.ndim(getattr(thing, name)) > 0
    setattr(thing, name, np.array([value, 0.0, 0.0]) if poly else value)


def _add_hand(
    link_body: mujoco.MjsBody, side: int, link: Link, robot: Robot, dev: Deviation, plant: bool,
    is_tip: bool,
) -> None:  # fmt: skip
    """Add the end of an arm as a separate body, so that its contacts do not count as collisions."""
    assert robot.arm is not None
    hand, way = robot.arm.hand, link_direction(link)
    at = (link.length_m + hand.length_m) * way
    quat = quat_from_rot(tip_rotation(link))
    body = link_body
    if hand.mass_kg > 0.0:
        body = link_body.add_body(name=f"hand{side}", pos=at)
        touch: dict[str, Any] = {
            "contype": ROBOT | OWN, "conaffinity": WORLD | OWN, "mass": 0.0,
            "rgba": [0.85, 0.2, 0.2, 1],
            "friction": [hand.friction, 0.005, 0.0001], "condim": 4, "priority": 1,
            "solref": [0.008, 0.5], "solimp": [0.9, 0.9, 0.001, 0.5, 2.0],
        }  # fmt: skip
        if hand.kind == "gripper":
            body.quat = quat
            add_fingers(body, hand, dev.mass_factor, plant, touch)
            quat = np.array([1.0, 0.0, 0.0, 0.0])
        else:
            body.mass = hand.mass_kg * dev.mass_factor
            body.ipos = np.zeros(3)  # MuJoCo's default is the body's own offset from its parent
            set_inertia(body, build_hand_body(hand)[1] * dev.mass_factor)
        if hand.kind == "ball":
            body.add_geom(
                name=f"hand{side} ball", type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[hand.radius_m, 0, 0], pos=-hand.radius_m * way, **touch,
            )  # fmt: skip
        elif hand.kind == "hook":
            bars = {"shank": [*(-hand.length_m * way), 0, 0, 0]} if hand.length_m > 0.0 else {}
            bars["bar"] = [0, 0, 0, hand.hook_length_m, 0, 0]
            for name, ends in bars.items():
                body.add_geom(
                    name=f"hand{side} {name}", type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                    size=[hand.radius_m, 0, 0], fromto=ends, **touch,
                )  # fmt: skip
        at = np.zeros(3)
    body.add_site(name=f"hand{side}", pos=at, quat=quat)
    if is_tip:
        body.add_site(name="tip", pos=at, quat=quat)


def _add_probe(
    spec: mujoco.MjSpec,
    link_body: mujoco.MjsBody,
    limb: Limb,
    robot: Robot,
    dev: Deviation,
    plant: bool,
) -> None:
    assert robot.probe is not None
    probe, parts = robot.probe, build_probe_parts(robot.probe)
    # holder frame: x along the probe's axis
    turn = rot_y(math.radians(probe.pitch_deg) + (math.pi / 2 if limb.link.along == "-z" else 0.0))
    holder = link_body.add_body(name="holder", pos=end_of(limb.link), quat=quat_from_rot(turn))
    holder.mass = parts.holder_mass * dev.mass_factor
    holder.ipos = [parts.holder_length / 2, 0, 0]
    holder.inertia = np.diag(rod_inertia(holder.mass, parts.holder_length, probe.radius_m))
    holder.explicitinertial = True
    holder.add_geom(
        name="holder shell", type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[probe.radius_m, 0, 0],
        fromto=[0, 0, 0, parts.holder_length, 0, 0], rgba=[0.9, 0.9, 0.9, 1],
        contype=ROBOT | OWN, conaffinity=WORLD | OWN, mass=0.0,
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
        rgba=[0.2, 0.2, 0.2, 1], contype=PEN, conaffinity=OWN, mass=0.0,
    )  # fmt: skip
    # site frame T: z along the probe, y along the link's y
    to_tip = quat_from_rot(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))
    slider.add_site(name="tip", pos=[probe.length_m, 0, 0], quat=to_tip)
    if limb.side >= 0:
        slider.add_site(name=f"hand{limb.side}", pos=[probe.length_m, 0, 0], quat=to_tip)
    if plant:
        k = probe.spring_n_per_m * dev.probe_spring_factor
        joint = slider.add_joint(
            name="spring", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE, range=[-probe.spring_travel_m, 0.0],
        )  # fmt: skip
        _set_coefficient(joint, "stiffness", k)
        damping = 2.0 * probe.spring_damping_ratio * math.sqrt(k * parts.slider_mass)
        _set_coefficient(joint, "damping", damping)
        joint.springref = probe.spring_preload_n / probe.spring_n_per_m
        joint.solref_limit = [0.004, 1.0]
        if robot.force_sensor is not None:  # less stiffness beyond the knee
            knee = (robot.force_sensor.knee_n - probe.spring_preload_n) / probe.spring_n_per_m
            tendon = spec.add_tendon(name="spring beyond")
            tendon.wrap_joint("spring", 1.0)
            _set_coefficient(tendon, "stiffness", -k * (1.0 - robot.force_sensor.hard_share))
            tendon.springlength = [-knee, 1.0]


def _add_servos(spec: mujoco.MjSpec, robot: Robot, servos: list[tuple[str, Servo]]) -> None:
    """Add the servos: a PD with a torque limit around the command.

    A velocity servo integrates its command. A torque servo applies the commanded torque. The
    command of a position servo already includes its lag and speed limit (vehicle/actuators).

    Through the belt a motor's angle is a fixed combination of joints: q_M = J_AM^-1 q_A. Its rotor
    therefore couples them: the joints' inertia grows by J_AM^-T diag(armature) J_AM^-1 (the motors'
    kinetic energy in joint speeds), which MuJoCo computes from the armature of a tendon.
    """
    assert robot.arm is not None
    joints = [limb.name for limb in list_joints(robot) if limb.servo >= 0]
    n = len(joints)
    belt = np.array(robot.arm.belt) if robot.arm.belt is not None else np.eye(n)
    motor_from_joint = np.linalg.inv(belt)
    for i, (name, servo) in enumerate(servos):
        tendon = spec.add_tendon(name=name)
        for j, joint in enumerate(joints):
            if abs(motor_from_joint[i, j]) > 1e-12:
                tendon.wrap_joint(joint, motor_from_joint[i, j])
        if robot.arm.belt is not None:
            tendon.armature = servo.armature_kgm2
        tendon.frictionloss = servo.friction_nm
        kp, kv = compute_servo_gains(robot, i, servo)
        gain, bias = (1.0, [0.0] * 3) if servo.mode == "torque" else (kp, [0.0, -kp, -kv])
        velocity = servo.mode == "velocity"
        dynamics = mujoco.mjtDyn.mjDYN_INTEGRATOR if velocity else mujoco.mjtDyn.mjDYN_NONE
        act = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_TENDON,
            dyntype=dynamics, dynprm=[1.0] + [0.0] * 9,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED, gainprm=[gain] + [0.0] * 9,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE, biasprm=bias + [0.0] * 7,
        )  # fmt: skip
        if velocity:
            act.ctrllimited = LIMITED
            act.ctrlrange = [-servo.no_load_speed_rad_s, servo.no_load_speed_rad_s]
        act.forcelimited = LIMITED
        act.forcerange = [-servo.stall_torque_nm, servo.stall_torque_nm]
