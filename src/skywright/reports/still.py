"""Still 3-D picture of a run: robot, pipe, and the probe's path coloured by its signal."""

import math
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.description.world.surface import build_cylinder, build_weld_curve, roll_points
from skywright.inspection.weld import WeldResult
from skywright.models.deviation import build_socket_error
from skywright.models.drawing import (
    build_drawing,
    compute_part_poses,
    get_opening,
    is_propeller,
    list_object_poses,
    multiply_quaternions,
    rotate_vectors,
)
from skywright.reports.meshes import Mesh, build_mesh, build_ribbon
from skywright.reports.render import Camera, Item, render_scene
from skywright.run.result import RunResult

CCW, CW = (0.17, 0.42, 0.78), (0.45, 0.72, 0.96)
PATH_WIDTH = 0.007  # m
WELD = (0.45, 0.40, 0.34)
LINE = (0.76, 0.07, 0.12)
SIGNAL = LinearSegmentedColormap.from_list("signal", ["#d7ecff", "#ffe14d", "#ff9500"])
"""Colours of the probe's weld signal, from none to strong; light, on dark steel."""


def render_run(
    result: RunResult, width: int, height: int, t: float | None = None, camera: Camera | None = None
) -> Array:
    """Return a picture (height, width, 3) uint8 of the robot at time `t` (s), with the scan so far
    on the pipe. `t` defaults to the end of the scan (or of the run). The default camera shows robot
    and pipe.
    """
    samples = result.samples
    scanning = [i for i, p in enumerate(result.phases) if p.name == "scan"]
    scan = np.flatnonzero(np.isin(samples["phase"], scanning))
    i = int(scan[-1]) if len(scan) else len(samples) - 1
    if t is not None:
        i = min(int(np.searchsorted(samples["t"], t)), len(samples) - 1)
    items = _build_items(result, samples[i])
    if len(scan) and isinstance(result.details, WeldResult):
        items += _paint_scan(result, samples[scan], samples["t"][i])
    camera = camera or place_camera(result, samples[i])
    return np.asarray(render_scene(items, camera, width, height))


def place_camera(result: RunResult, row: Any) -> Camera:
    """Return a camera that shows the robot of a sample, and the pipe if the world has one."""
    centre = np.array(row["p_WB"])
    pipe = result.description.true_world.pipe
    if pipe is None:
        side = np.array([-0.6, -1.0, 0.5])
        look = centre
    else:
        cyl = build_cylinder(pipe)
        way = cyl.p_WP - centre
        way[2] = 0.0
        way /= np.linalg.norm(way)
        right = np.cross(way, [0.0, 0.0, 1.0])
        look = 0.47 * centre + 0.53 * cyl.p_WP - [0.0, 0.0, 0.1] - 0.09 * right
        side = -0.95 * way + 0.75 * right + [0.0, 0.0, 0.42]
    return Camera(look + 3.0 * side / np.linalg.norm(side), look, math.radians(27.0))


def _build_items(result: RunResult, row: Any) -> list[Item]:
    d = result.description
    drawing = build_drawing(d.robot, d.true_world, build_socket_error(d.plant))
    items = []
    for shape in drawing.world:
        if shape.kind != "plane":
            mesh = build_mesh(shape, 96)
            items.append(_paint(mesh, shape.rgba[:3]))
    one = row[None]
    poses = compute_part_poses(
        drawing,
        one["p_WB"],
        one["q_WB"],
        one["q"],
        one["spring"],
        list_object_poses(one),
        get_opening(one),
    )
    placed: list[tuple[Array, Array]] = []
    for part, (p, q) in zip(drawing.parts, poses, strict=True):
        if part.parent >= 0 and part.motion != "free":
            p0, q0 = placed[part.parent]
            p, q = p0 + rotate_vectors(q0, p), multiply_quaternions(q0, q)
        placed.append((p, q))
        for shape in part.shapes:
            mesh = build_mesh(shape, 48)
            n = len(mesh.vertices)
            vertices = rotate_vectors(np.repeat(q, n, axis=0), mesh.vertices) + p
            opacity, colour = float(shape.rgba[3]), tuple(shape.rgba[:3])
            if is_propeller(part, shape):
                spin = d.robot.rotors.spin[int(shape.name[9:])]
                opacity, colour = 0.42, CCW if spin == "ccw" else CW
            items.append(_paint(Mesh(vertices, mesh.faces), colour, opacity))
    return items


def _paint_scan(result: RunResult, scan: NDArray[Any], until: float) -> list[Item]:
    """Return bands for the weld, the path coloured by the weld signal, and the estimated lines."""
    weld, pipe = result.details, result.description.true_world.pipe
    assert isinstance(weld, WeldResult) and pipe is not None
    items = []
    low, high = float(np.nanmin(weld.c)) - 0.02, float(np.nanmax(weld.c)) + 0.02
    c = np.linspace(low, high, 120)
    for true in result.description.world.list_welds():
        if abs(true.angle_deg) < 60:
            s = build_weld_curve(true, pipe.diameter_m / 2).place(c)
            items.append(_band(result, s, c, 2.0 * true.half_width_m, 0.0006, WELD))
    step = max(1, len(scan) // 1500)
    keep = np.flatnonzero(scan["t"] <= until)[::step]
    top = 1.5 * float(np.nanquantile(weld.weld[weld.contact], 0.98)) if weld.contact.any() else 1.0
    level = np.clip(weld.weld[keep] / max(top, 1e-9), 0.0, 1.0)
    colours = SIGNAL(level)[:, :3]
    if len(keep) > 2:
        items.append(_band(result, weld.s[keep], weld.c[keep], PATH_WIDTH, 0.0018, colours))
    for line in weld.lines:
        s, c = line.follow(np.linspace(-0.5, 0.5, 400) * (high - low))
        items.append(_band(result, s, c, 0.0035, 0.0026, LINE))
    return items


def _band(result: RunResult, s: Array, c: Array, width: float, lift: float, colour: Any) -> Item:
    pipe = result.description.true_world.pipe
    assert pipe is not None
    cyl = build_cylinder(pipe)
    points, normals = roll_points(cyl, s, c)
    mesh = build_ribbon(points + lift * normals, normals, width)
    if np.ndim(colour) == 2:
        return Item(mesh.vertices, mesh.faces, np.concatenate([colour, colour]))
    return _paint(mesh, colour)


def _paint(mesh: Mesh, colour: Any, opacity: float = 1.0) -> Item:
    colours = np.broadcast_to(np.asarray(colour, float), (len(mesh.vertices), 3))
    return Item(mesh.vertices, mesh.faces, colours, opacity)
