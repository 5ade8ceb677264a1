"""Export of a robot as URDF: `skywright show ROBOT --urdf FILE`.

The URDF is the nominal model: rigid links, the probe's spring released. Joints and inertias are
written from the description, not from the scene, so that a comparison of both is a test; shapes are
those of the scene. The root link `platform` is B and moves freely (URDF leaves that to the reader).
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_from_quat
from skywright.description.robot.limbs import (
    SIDES,
    Limb,
    end_of,
    list_joints,
    list_limbs,
    list_servos,
    turn_of,
)
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.models.bar import compute_bar_inertia
from skywright.models.bar_body import BAR
from skywright.models.drawing import Shape, build_drawing
from skywright.models.part_masses import (
    SLIDER_INERTIA,
    build_docking_parts,
    build_hand_body,
    build_probe_parts,
    finger_inertia,
    link_com,
    link_direction,
    link_inertia,
    place_fingers,
    platform_inertia,
    rod_inertia,
    tip_rotation,
)
from skywright.models.rigid_body import build_body_model, compute_hands_apart, find_tip
from skywright.models.rotors import build_rotors

FREE_SPEED = 1000.0  # rad/s: URDF requires a largest speed of every joint; a passive joint has none


def build_urdf(robot: Robot) -> str:
    """Return the robot as URDF text.

    Links: `platform` (B), `rotor0`... (massless, z along the thrust), `docking`, the links of the
    arms by name, `holder` and `slider` of the probe, `hand` or `left_hand` and `right_hand` (frames
    H), `bar` (in both hands, fixed to the left one), `tip` (frame T, massless). Each joint has the
    name and the zero of the link that it moves.
    """
    limbs = list_limbs(robot)
    out = _Writer(robot)
    p, gear = robot.platform, out.shapes.get("gear", ())
    out.add_link(
        "platform", p.mass_kg, np.array([p.com_x_m, p.com_y_m, p.com_z_m]),
        platform_inertia(p),
        out.shapes["platform"] + gear,
    )  # fmt: skip
    rotors = build_rotors(robot.rotors)
    for i, (place, axis) in enumerate(zip(rotors.position, rotors.axis, strict=True)):
        x = np.cross([0.0, 1.0, 0.0], axis)
        x /= np.linalg.norm(x)
        out.add_fixed(f"rotor{i}", "platform", place, np.column_stack([x, np.cross(axis, x), axis]))
    if robot.docking is not None:
        mass, com, inertia = build_docking_parts(robot.docking)
        out.add_fixed("docking", "platform", np.zeros(3), np.eye(3))
        out.fill_link("docking", mass, com, inertia, out.shapes["docking"])
    bounds = _joint_bounds(robot)
    for limb in limbs:
        out.add_link(
            limb.name, limb.link.mass_kg, link_com(limb.link), link_inertia(limb.link),
            out.shapes[limb.name],
        )  # fmt: skip
        out.add_joint(limb, "platform" if limb.parent < 0 else limbs[limb.parent].name, bounds)
    if robot.arm is not None:
        _add_ends(out, robot, limbs)
    return out.text()


def _add_ends(out: _Writer, robot: Robot, limbs: list[Limb]) -> None:
    """Hands, or the probe's holder and slider, and the frame T."""
    assert robot.arm is not None
    hand, tip = robot.arm.hand, find_tip(robot, limbs)
    for side in range(robot.arm.sides):
        i = max(n for n, limb in enumerate(limbs) if limb.side == side)
        if robot.probe is not None and side == limbs[tip].side:
            continue  # the arm ends in the probe
        name = f"{SIDES[side]}_hand" if robot.arm.sides == 2 else "hand"
        link, turn = limbs[i].link, tip_rotation(limbs[i].link)
        place = (link.length_m + hand.length_m) * link_direction(link)
        out.add_fixed(name, limbs[i].name, place, turn)
        if hand.kind == "gripper":
            for k, placed in enumerate(place_fingers(hand)):
                finger, shapes = f"{name}_finger{k}", out.shapes[f"hand{side} finger{k}"]
                out.add_fixed(finger, name, placed.p, placed.R)
                mass, inertia = 0.5 * hand.mass_kg, finger_inertia(hand)
                out.fill_link(finger, mass, placed.com, inertia, shapes)
        elif hand.mass_kg > 0.0:
            inertia, shapes = build_hand_body(hand)[1], out.shapes[f"hand{side}"]
            out.fill_link(name, hand.mass_kg, np.zeros(3), inertia, shapes, turn.T)
        if i == tip:
            out.add_fixed("tip", name, np.zeros(3), np.eye(3))
        if side == 0 and robot.arm.bar is not None:  # on the left hand, as in the scene
            inertia = compute_bar_inertia(robot.arm.bar)
            middle = np.array([0.0, -0.5 * compute_hands_apart(robot), 0.0])
            out.add_fixed(BAR, name, middle, np.eye(3))
            out.fill_link(BAR, robot.arm.bar.mass_kg, np.zeros(3), inertia, out.shapes[BAR])
    if robot.probe is None:
        return
    probe, parts = robot.probe, build_probe_parts(robot.probe)
    x, y, z = tip_rotation(limbs[tip].link, probe.pitch_deg).T
    out.add_fixed(
        "holder", limbs[tip].name, np.array(end_of(limbs[tip].link)), np.column_stack([z, y, -x])
    )
    half = np.array([0.5 * parts.holder_length, 0.0, 0.0])
    rod = rod_inertia(parts.holder_mass, parts.holder_length, probe.radius_m)
    out.fill_link("holder", parts.holder_mass, half, rod, out.shapes["holder"])
    out.add_fixed("slider", "holder", np.zeros(3), np.eye(3))
    com = np.array([parts.slider_com, 0.0, 0.0])
    ball = SLIDER_INERTIA * np.eye(3)
    out.fill_link("slider", parts.slider_mass, com, ball, out.shapes["slider"])
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    out.add_fixed("tip", "slider", np.array([probe.length_m, 0.0, 0.0]), turn)


def _joint_bounds(robot: Robot) -> dict[str, tuple[float, float, float, float]]:
    """Return lower, upper (rad; m), effort (N m; N) and speed (rad/s; m/s) of every moving joint.

    Through a belt several servos act on a joint: effort and speed are those that they reach
    together.
    """
    model = build_body_model(robot)[0]
    servos = [servo for _, servo in list_servos(robot)]
    stall = np.array([servo.stall_torque_nm for servo in servos])
    speed = np.array([servo.no_load_speed_rad_s for servo in servos])
    if robot.arm is not None and robot.arm.belt is not None:
        belt = np.array(robot.arm.belt)  # joint speeds = belt @ motor speeds
        stall, speed = np.abs(np.linalg.inv(belt)).T @ stall, np.abs(belt) @ speed
    out = {}
    for j, limb in enumerate(list_joints(robot)):
        effort, fastest = 0.0, FREE_SPEED
        if limb.servo >= 0:
            effort, fastest = stall[limb.servo], speed[limb.servo]
        out[limb.name] = (model["q_min"][j], model["q_max"][j], effort, fastest)
    return out


class _Writer:
    """The XML tree of a robot in construction."""

    def __init__(self, robot: Robot) -> None:
        parts = build_drawing(robot, World(name="nowhere"), meshes=False).parts
        self.shapes = {part.name: part.shapes for part in parts}
        self.root = ET.Element("robot", name=robot.name)
        self.links: dict[str, ET.Element] = {}

    def text(self) -> str:
        ET.indent(self.root)
        return f'<?xml version="1.0"?>\n{ET.tostring(self.root, encoding="unicode")}\n'

    def add_link(
        self, name: str, mass: float, com: Array, inertia: Array, shapes: tuple[Shape, ...]
    ) -> None:
        self._start_link(name)
        self.fill_link(name, mass, com, inertia, shapes)

    def add_fixed(self, name: str, parent: str, place: Array, turn: Array) -> None:
        """Add a link fixed to `parent` at `place` (3,), with the axes `turn` (3, 3)."""
        self._start_link(name)
        joint = ET.SubElement(self.root, "joint", name=name, type="fixed")
        _add_origin(joint, place, turn)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=name)

    def add_joint(
        self, limb: Limb, parent: str, bounds: dict[str, tuple[float, float, float, float]]
    ) -> None:
        link = limb.link
        if link.joint == "fixed":
            kind = "fixed"
        else:
            kind = "prismatic" if link.joint == "slide" else "revolute"
        joint = ET.SubElement(self.root, "joint", name=limb.name, type=kind)
        _add_origin(joint, np.array(limb.offset), turn_of(link))
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=limb.name)
        if kind == "fixed":
            return
        ET.SubElement(joint, "axis", xyz=" ".join(str(int(link.axis == a)) for a in "xyz"))
        lower, upper, effort, speed = (_number(x) for x in bounds[limb.name])
        ET.SubElement(joint, "limit", lower=lower, upper=upper, effort=effort, velocity=speed)
        if link.passive:
            damping, friction = _number(link.damping_nms_per_rad), _number(link.friction_nm)
            ET.SubElement(joint, "dynamics", damping=damping, friction=friction)

    def fill_link(
        self,
        name: str,
        mass: float,
        com: Array,
        inertia: Array,
        shapes: tuple[Shape, ...],
        turn: Array | None = None,
    ) -> None:
        """Add mass, centre (3,), inertia (3, 3) about it, and shapes, which `turn` rotates into the
        link."""
        link = self.links[name]
        inertial = ET.SubElement(link, "inertial")
        _add_origin(inertial, com, np.eye(3))
        ET.SubElement(inertial, "mass", value=_number(mass))
        terms = {
            f"i{'xyz'[a]}{'xyz'[b]}": _number(inertia[a, b]) for a in range(3) for b in range(a, 3)
        }
        ET.SubElement(inertial, "inertia", terms)
        for shape in shapes:
            _add_shape(link, shape, np.eye(3) if turn is None else turn)

    def _start_link(self, name: str) -> None:
        assert name not in self.links  # description/robot/spec.py rejects the names used here
        self.links[name] = ET.SubElement(self.root, "link", name=name)


def _add_shape(link: ET.Element, shape: Shape, turn: Array) -> None:
    """Add a visual and collision shape; a capsule becomes a cylinder and two spheres (URDF has
    none)."""
    place, axes = turn @ shape.position, turn @ rot_from_quat(shape.quaternion)
    radius, half = float(shape.size[0]), float(shape.size[1])
    solids: list[tuple[str, dict[str, str], Array]] = []
    if shape.kind in ("capsule", "cylinder"):
        size = {"radius": _number(radius), "length": _number(2.0 * half)}
        solids.append(("cylinder", size, place))
    if shape.kind == "capsule":
        solids += [
            ("sphere", {"radius": _number(radius)}, place + end * half * axes[:, 2])
            for end in (-1.0, 1.0)
        ]
    if shape.kind == "sphere":
        solids.append(("sphere", {"radius": _number(radius)}, place))
    if shape.kind == "box":
        solids.append(("box", {"size": _numbers(2.0 * shape.size)}, place))
    for use in ("visual", "collision"):
        for tag, size, at in solids:
            element = ET.SubElement(link, use)
            _add_origin(element, at, axes)
            ET.SubElement(ET.SubElement(element, "geometry"), tag, size)
            if use == "visual":
                rgba = _numbers(shape.rgba.round(3))
                material = ET.SubElement(element, "material", name=rgba.replace(" ", "_"))
                ET.SubElement(material, "color", rgba=rgba)


def _add_origin(element: ET.Element, place: Array, turn: Array) -> None:
    ET.SubElement(element, "origin", xyz=_numbers(place), rpy=_numbers(roll_pitch_yaw(turn)))


def roll_pitch_yaw(r: Array) -> Array:
    """Return (roll, pitch, yaw) rad with r = Rz(yaw) Ry(pitch) Rx(roll), gimbal lock included."""
    yaw = math.atan2(r[1, 0], r[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-r[2, 0], c * r[0, 0] + s * r[1, 0])
    roll = math.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    return np.array([roll, pitch, yaw])


def _number(x: float) -> str:
    """Return the shortest text that parses to the same double."""
    return repr(float(x) + 0.0)


def _numbers(values: Array) -> str:
    return " ".join(_number(x) for x in values)
