"""Outlines of robots and worlds as 3-D curves, for 2-D drawings from above or the side."""

import math
from typing import NamedTuple

import numpy as np

from skywright.core.arrays import Array
from skywright.core.rotations import rot_z
from skywright.description.robot.limbs import end_of, list_limbs
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import Pipe, Tube
from skywright.description.world.structure import PLANE, Structure, build_surface, locate_point
from skywright.description.world.surface import build_cylinder, roll_points
from skywright.description.world.thing import Solid, Things
from skywright.description.world.things import locate_thing
from skywright.models.docking_body import list_feet
from skywright.models.rigid_body import build_body_model, compute_kinematics, joint_names
from skywright.models.rotors import build_rotors


class Outline(NamedTuple):
    """A drawn part: a closed or open polyline (n, 3) in m, and its style."""

    points: Array
    part: str
    """disc, spoke, hub, arm, probe, gear, pipe, post, box, weld, sector, path."""
    filled: bool = False


def outline_robot(robot: Robot, q: Array) -> list[Outline]:
    """Return the outlines of a robot in B with its joints at `q` (n_joints,)."""
    parts: list[Outline] = []
    rotors = build_rotors(robot.rotors)
    p = robot.platform
    turn = np.linspace(0.0, 2 * math.pi, 49)
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    foot = -p.gear_height_m
    for angle in (45, 135, 225, 315):
        way = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0.0])
        leg = [0.6 * p.body_radius_m * way, p.gear_radius_m * way + [0, 0, foot]]
        parts.append(Outline(np.array(leg), "gear"))
    parts.append(Outline(circle * p.gear_radius_m + [0, 0, foot], "gear"))
    for hub in rotors.position:
        parts.append(Outline(np.array([[0.0, 0.0, 0.0], hub]), "spoke"))
    low = p.body_radius_m * circle - [0, 0, 0.03]
    parts += [Outline(low, "hub", True), Outline(p.body_radius_m * circle, "hub", True)]
    for hub, axis in zip(rotors.position, rotors.axis, strict=True):
        u = np.cross(axis, [0.0, 1.0, 0.0])
        u /= np.linalg.norm(u)
        v = np.cross(axis, u)
        ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
        parts.append(Outline(hub + rotors.propeller_radius * ring, "disc", True))
    if robot.docking is not None:
        d = robot.docking
        for point in list_feet(d):
            hip = np.array([*(0.7 * p.body_radius_m / d.radius_m * point[:2]), 0.0])
            parts.append(Outline(np.array([hip, point]), "gear"))
        parts.append(Outline(circle * d.radius_m + [0, 0, d.height_m], "gear"))
    return parts + outline_arm(robot, q)


def outline_arm(robot: Robot, q: Array) -> list[Outline]:
    """Return the centre lines of the links and the probe in B."""
    if robot.arm is None:
        return []
    model = build_body_model(robot)
    k = compute_kinematics(model, q[: len(joint_names(robot))])
    parts = []
    for i, limb in enumerate(list_limbs(robot)):
        start = k["p"][i]
        end = start + k["R"][i] @ np.array(end_of(limb.link))
        parts.append(Outline(np.array([start, end]), "arm"))
    if robot.probe is not None:
        tip, axis = k["p_BT"], k["R_BT"][:, 2]
        parts.append(Outline(np.array([tip - axis * robot.probe.length_m, tip]), "probe"))
    return parts


def move(parts: list[Outline], p: Array, yaw: float) -> list[Outline]:
    """Transform outlines from B to W, at position `p` (3,) and heading `yaw` (rad)."""
    return place(parts, p, rot_z(yaw))


def place(parts: list[Outline], p: Array, R: Array) -> list[Outline]:
    """Transform outlines from B to W, at position `p` (3,) and attitude `R` (3, 3)."""
    return [part._replace(points=part.points @ R.T + p) for part in parts]


def outline_pipe(pipe: Pipe) -> list[Outline]:
    """Return both ends of the pipe and lines along it, in W."""
    cyl = build_cylinder(pipe)
    phi = np.linspace(-math.pi, math.pi, 73)
    parts = [Outline(surface_curve(pipe, s * cyl.half_length, phi), "pipe") for s in (-1.0, 1.0)]
    for angle in np.radians(np.arange(0, 360, 10)):
        s = np.array([-cyl.half_length, cyl.half_length])
        parts.append(Outline(surface_curve(pipe, s, angle), "pipe"))
    return parts


def surface_curve(pipe: Pipe, s: Array | float, phi: Array | float) -> Array:
    """Return points (n, 3) in W of the surface at axial positions `s` (m) and angles `phi`
    (rad)."""
    cyl = build_cylinder(pipe)
    return roll_points(cyl, np.asarray(s), cyl.radius * np.asarray(phi))[0]


def outline_tube(tube: Tube) -> list[Outline]:
    """Return both ends of a structure's pipe and lines along it, in W."""
    start = np.array([tube.x_m, tube.y_m, tube.z_m])
    way = np.array([tube.to_x_m, tube.to_y_m, tube.to_z_m]) - start
    axis = way / tube.length_m
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    phi = np.linspace(0.0, 2.0 * math.pi, 25)[:, None]
    ring = start + 0.5 * tube.diameter_m * (
        np.cos(phi) * across + np.sin(phi) * np.cross(axis, across)
    )
    lines = [Outline(np.array([p, p + way]), "pipe") for p in ring[:-1]]
    return [Outline(ring, "pipe"), Outline(ring + way, "pipe"), *lines]


def outline_things(things: Things) -> list[Outline]:
    """Return the bounding box of each solid in W."""
    out: list[Outline] = []
    for name, thing in things.items():
        for part in thing.list_parts():
            at = locate_thing(things, name).at(part.frame)
            for solid in part.solids:
                out += place(_outline_solid(solid), at.p, at.R)
    return out


def _outline_solid(solid: Solid) -> list[Outline]:
    """Return a line for a capsule between two ends, else the bounding box."""
    if solid.ends is not None:
        return [Outline(np.array(solid.ends, dtype=float), "box")]
    r = float(solid.size[0])
    half = {"box": solid.size, "sphere": (r, r, r)}.get(solid.shape, (r, r, float(solid.size[-1])))
    x, y, z = (float(v) for v in half)
    base = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0], [-x, -y, 0]])
    low, high = base - [0, 0, z], base + [0, 0, z]
    edges = [Outline(np.array([a, b]), "box") for a, b in zip(low[:4], high[:4], strict=True)]
    box = [Outline(low, "box", True), Outline(high, "box", True), *edges]
    return place(box, solid.frame.p, solid.frame.R)


def outline_structure(structure: Structure) -> list[Outline]:
    """Return the edges of the inspected surface, and of the plate behind it."""
    surface = build_surface(structure)
    half_x, half_y = 0.5 * structure.length_m, 0.5 * structure.width_m
    if surface.shape != PLANE:  # a quarter turn to each side of the frame's origin
        turn = 0.5 * math.pi * surface.radius
        half_x, half_y = (half_x, turn) if surface.along == 0 else (turn, half_y)
    u = np.linspace(-1.0, 1.0, 25)
    edges = [np.column_stack([half_x * u, np.full(25, s * half_y)]) for s in (-1.0, 1.0)]
    edges += [np.column_stack([np.full(25, s * half_x), half_y * u]) for s in (-1.0, 1.0)]
    out = []
    for edge in edges:
        line = np.array([locate_point(surface, place)[0] for place in edge])
        out.append(Outline(line, "box"))
        if surface.shape == PLANE:
            out.append(Outline(line - structure.thickness_m * surface.R_WS[:, 2], "box"))
    return out
