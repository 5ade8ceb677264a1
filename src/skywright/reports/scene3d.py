"""The 3-D scene of a robot in its world as data for the ground station's page.

One dictionary holds parts, meshes, lines, labels and arrows. Lengths are in m, vectors in W unless
an item names its part; quaternions are wxyz. Arrays are base64 of little-endian numbers.
"""

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skywright.core.arrays import Array
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import Pipe, Weld, World
from skywright.description.world.surface import build_cylinder, find_weld_on_pipe, roll_points
from skywright.models.drawing import (
    Drawing,
    Shape,
    build_drawing,
    compute_part_poses,
    get_opening,
    is_propeller,
    list_object_poses,
    multiply_quaternions,
    rotate_vectors,
)
from skywright.reports.meshes import Mesh, build_mesh, build_ribbon, merge_meshes
from skywright.run.kind import Mark, Sketch

Colour = tuple[int, int, int]

# Colour-blind safe: Okabe and Ito's palette, or colours that differ in lightness.
CCW: Colour = (51, 117, 214)
"""Colour of propellers that turn counter-clockwise seen from above."""
CW: Colour = (120, 190, 255)
WELD: Colour = (20, 20, 24)
ESTIMATE: Colour = (214, 40, 170)
PLAN: Colour = (255, 255, 255)
WAYPOINT: Colour = (0, 153, 136)
AREA: Colour = (190, 60, 60)
WIND: Colour = (0, 150, 200)
WIND_SCALE = 0.12
"""Length (m) of an arrow per m/s of wind."""

# MuJoCo's holder frame has x along the probe, the tip's frame has z: R_TH as a quaternion
_Q_TH = np.array([math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0])


class Scene3d:
    """A robot in its world; `data` is the input of the page."""

    def __init__(self, robot: Robot, world: World, error: Array | None = None) -> None:
        """Draw the world and the robot; `error` as in build_drawing."""
        self.robot, self.world = robot, world
        self.drawing: Drawing = build_drawing(robot, world, error)
        self.parents = [-1 if part.name == "holder" else part.parent for part in self.drawing.parts]
        """Parent of each part; the probe's parent is the world, because the pose of its tip is
        known."""
        self.meshes: list[dict[str, Any]] = []
        self.lines: list[dict[str, Any]] = []
        self.labels: list[dict[str, Any]] = []
        self.arrows: list[dict[str, Any]] = []
        self._draw_world()
        self._draw_robot()

    @property
    def data(self) -> dict[str, Any]:
        """The scene as plain JSON."""
        parts = [
            {"name": part.name, "parent": parent, "p": _round(part.position),
             "q": _round(part.quaternion, 6)}
            for part, parent in zip(self.drawing.parts, self.parents, strict=True)
        ]  # fmt: skip
        return {
            "parts": parts, "meshes": self.meshes, "lines": self.lines, "labels": self.labels,
            "arrows": self.arrows,
        }  # fmt: skip

    # --- moving --------------------------------------------------------------------------------

    def compute_poses(self, samples: NDArray[Any]) -> list[tuple[Array, Array]]:
        """Return (positions (n, 3), quaternions (n, 4)) of each part relative to its parent."""
        q = np.asarray(samples["q"], float)
        found = compute_part_poses(
            self.drawing, samples["p_WB"], samples["q_WB"], q, samples["spring"],
            list_object_poses(samples), get_opening(samples),
        )  # fmt: skip
        return [
            self._place_holder(samples) if part.name == "holder" else pose
            for part, pose in zip(self.drawing.parts, found, strict=True)
        ]

    def _place_holder(self, samples: NDArray[Any]) -> tuple[Array, Array]:
        """Return the pose of the probe's holder from the true tip, because a flexible arm bends."""
        assert self.robot.probe is not None
        q_WH = multiply_quaternions(samples["q_WT"], np.broadcast_to(_Q_TH, (len(samples), 4)))
        back = np.zeros((len(samples), 3))
        back[:, 0] = samples["spring"] - self.robot.probe.length_m
        return samples["p_WT"] + rotate_vectors(q_WH, back), q_WH

    # --- drawing -------------------------------------------------------------------------------

    def _draw_robot(self) -> None:
        spin = self.robot.rotors.spin
        for i, part in enumerate(self.drawing.parts):
            colours: dict[tuple[Colour, float], list[Shape]] = {}
            for shape in part.shapes:
                colour, opacity = _colour(shape)
                if is_propeller(part, shape):
                    colour = CCW if spin[int(shape.name[9:])] == "ccw" else CW
                    opacity = 0.45
                colours.setdefault((colour, opacity), []).append(shape)
            for (colour, opacity), shapes in colours.items():
                self._mesh(merge_meshes([build_mesh(s) for s in shapes]), colour, opacity, part=i)

    def _draw_world(self) -> None:
        for shape in self.drawing.world:
            if shape.kind != "plane":  # the page draws the ground
                colour, opacity = _colour(shape)
                self._mesh(build_mesh(shape, 64), colour, opacity)
        pipe, welds = self.world.pipe, self.world.list_welds()
        for weld in welds:
            assert pipe is not None
            for p, n in zip(*weld_curve(pipe, weld), strict=True):
                ribbon = build_ribbon(p + 0.0006 * n, n, 2.0 * weld.half_width_m)
                self._mesh(ribbon, WELD, 1.0, double=True)
        area = get_structures(self.world).area
        if area is not None:
            x, y = (area.x_min_m, area.x_max_m), (area.y_min_m, area.y_max_m)
            edges = _list_edges(x, y, (0.0, area.z_max_m))
            self.lines.append({"v": encode(edges, "<f4"), "rgb": list(AREA)})

    def draw_wind(self, at: Array) -> None:
        """Draw the steady wind as an arrow that ends at `at` (3,)."""
        wind = self.world.wind
        toward = math.radians(wind.toward_deg)
        v = np.array([math.cos(toward) * wind.mean_mps, math.sin(toward) * wind.mean_mps, 0.0])
        v[2] = wind.vertical_mps
        speed = float(np.linalg.norm(v))
        if wind.kind == "none" or speed < 1e-6:
            return
        tail = at - WIND_SCALE * v
        self.arrows.append({"from": _round(tail), "to": _round(at), "rgb": list(WIND)})
        self.labels.append({"p": _round(tail), "text": f"wind {speed:.1f} m/s"})

    def draw_surface_line(
        self, s: Array, c: Array, width: float, colour: Colour, lift: float = 0.001,
        since: float | None = None,
    ) -> None:  # fmt: skip
        """Draw a band along (s, c) (n,), m on the unrolled pipe, `lift` (m) above the surface.

        It is visible from time `since` (s).
        """
        assert self.world.pipe is not None
        points, normals = roll_points(build_cylinder(self.world.pipe), s, c)
        mesh = build_ribbon(points + lift * normals, normals, width)
        self._mesh(mesh, colour, 1.0, double=True, since=since)

    def draw_ball(
        self, p_W: Array, radius: float, colour: Colour, since: float | None = None
    ) -> None:
        """Draw a ball of `radius` (m) at p_W (3,) m, visible from time `since` (s)."""
        one = np.array([1.0, 0.0, 0.0, 0.0])
        shape = Shape("", "sphere", np.array([radius, 0.0, 0.0]), np.array(p_W), one, np.ones(4))
        self._mesh(build_mesh(shape, 16), colour, 1.0, since=since)

    def draw_sketch(self, sketch: Sketch) -> None:
        """Draw a mission's numbered way-points and its path on the pipe."""
        self._draw_path(sketch.on_pipe)
        for i, p in enumerate(sketch.points):
            self.draw_ball(p, 0.025, WAYPOINT)
            self.labels.append({"p": _round(p + [0.0, 0.0, 0.05]), "text": f"{i + 1}"})

    def draw_mark(self, mark: Mark, start: float) -> None:
        """Draw a result of a mission; `start` (s) is the mission time at the start of the
        replay."""
        since = max(mark.since_s - start, 0.0)
        if mark.p_W is not None:
            self.draw_ball(mark.p_W, mark.size_m, mark.colour, since=since)
        if len(mark.on_pipe) > 1 and self.world.pipe is not None:
            s, c = mark.on_pipe[:, 0], 0.5 * self.world.pipe.diameter_m * mark.on_pipe[:, 1]
            self.draw_surface_line(s, c, mark.size_m, mark.colour, 0.0015, since=since)

    def _draw_path(self, path_sphi: Array) -> None:
        """Draw a path on the pipe: (n, 2) s (m) and phi (rad)."""
        if self.world.pipe is None or len(path_sphi) < 2:
            return
        s, c = path_sphi[:, 0], 0.5 * self.world.pipe.diameter_m * path_sphi[:, 1]
        way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(s), np.diff(c)))])
        _, keep = np.unique(np.floor(way / 0.002), return_index=True)  # points 2 mm apart
        if len(keep) > 1:
            self.draw_surface_line(s[keep], c[keep], 0.004, PLAN, lift=0.0003)

    def _mesh(
        self, mesh: Mesh, colour: Colour, opacity: float, double: bool = False, part: int = -1,
        since: float | None = None,
    ) -> None:  # fmt: skip
        item: dict[str, Any] = {
            "part": part, "v": encode(mesh.vertices, "<f4"), "f": encode(mesh.faces, "<u4"),
            "rgb": list(colour), "a": round(opacity, 3),
        }  # fmt: skip
        if double or opacity < 1.0:
            item["double"] = True
        if since is not None:
            item["since"] = round(float(since), 2)
        self.meshes.append(item)


def encode(values: Any, kind: str) -> str:
    """Return an array as base64 of numbers of `kind` (a NumPy type such as "<f4")."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode("ascii")


def _round(values: Any, digits: int = 4) -> list[float]:
    return [round(float(x), digits) for x in values]


def _list_edges(*ranges: tuple[float, float]) -> Array:
    """Return the edges (12, 2, 3) of a box from its range on each axis."""
    corners = np.array([[x, y, z] for x in ranges[0] for y in ranges[1] for z in ranges[2]])
    apart = np.sum(corners[:, None] != corners[None], axis=2)
    return corners[np.argwhere(np.triu(apart == 1))]


def weld_curve(pipe: Pipe, weld: Weld) -> tuple[list[Array], list[Array]]:
    """Return the pieces of the true weld on the pipe: points and normals (n, 3) in W."""
    s, c = find_weld_on_pipe(pipe, weld, 4001)
    inside = np.isfinite(s)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    points, normals = [], []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start > 1:
            p, n = roll_points(build_cylinder(pipe), s[start:stop:10], c[start:stop:10])
            points.append(p)
            normals.append(n)
    return points, normals


def _colour(shape: Shape) -> tuple[Colour, float]:
    r, g, b, a = (float(x) for x in shape.rgba)
    return (round(255 * r), round(255 * g), round(255 * b)), a
