"""The 3-D scene of a robot in its world, shared by the replay and the live view."""

import contextlib
import io
import math
from typing import Any, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from skywright.core.arrays import Array, Mask
from skywright.description.robot.spec import Robot
from skywright.description.world.scenario import get_structures
from skywright.description.world.spec import Pipe, Weld, World
from skywright.description.world.surface import build_cylinder, find_weld_on_pipe, roll_points
from skywright.models.drawing import (
    Drawing,
    Shape,
    build_drawing,
    compute_part_poses,
    list_object_poses,
    multiply_quaternions,
    rotate_vectors,
)
from skywright.reports.meshes import Mesh, build_mesh, build_ribbon, merge_meshes
from skywright.run.kind import Sketch

Colour = tuple[int, int, int]

CCW: Colour = (51, 117, 214)
"""Propellers that turn counter-clockwise seen from above."""
CW: Colour = (120, 190, 255)
WELD: Colour = (20, 20, 24)
ESTIMATE: Colour = (214, 40, 170)
PLAN: Colour = (255, 255, 255)
WAYPOINT: Colour = (0, 153, 136)
AREA: Colour = (190, 60, 60)
WIND: Colour = (0, 150, 200)

# MuJoCo's holder frame has x along the probe; the tip's frame has z there: R_TH as a quaternion
_Q_TH = np.array([math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0])


class Poses(NamedTuple):
    """Poses of all moving nodes over n instants: (positions (n, 3), quaternions (n, 4))."""

    nodes: dict[str, tuple[Array, Array]]


class Scene3d:
    """A robot in its world on a viser server; `show` moves the robot."""

    def __init__(
        self, server: viser.ViserServer, robot: Robot, world: World, error: Array | None = None
    ) -> None:
        """Draw the world and the robot, which waits at the origin; `error` as in build_drawing."""
        self.server, self.robot, self.world = server, robot, world
        self.drawing: Drawing = build_drawing(robot, world, error)
        self._handles: dict[str, Any] = {}
        self._names = self._name_nodes()
        self._draw_world()
        self._draw_robot()

    # --- moving --------------------------------------------------------------------------------

    def compute_poses(self, samples: NDArray[Any]) -> Poses:
        """Return the poses of all moving nodes for recorded samples."""
        q = np.asarray(samples["q"], float)
        found = compute_part_poses(
            self.drawing, samples["p_WB"], samples["q_WB"], q, samples["spring"],
            list_object_poses(samples),
        )  # fmt: skip
        nodes = {}
        for part, name, pose in zip(self.drawing.parts, self._names, found, strict=True):
            if part.name == "holder":
                pose = self._place_holder(samples)
            if part.motion != "fixed" or part.name == "holder":
                nodes[name] = pose
        return Poses(nodes)

    def show(self, poses: Poses, i: int, moved: dict[str, tuple[Mask, Mask]] | None = None) -> None:
        """Move the robot to instant `i` of `poses`.

        `moved` restricts it to the nodes whose position, quaternion (masks (n,)) differ visibly.
        """
        for name, (positions, quaternions) in poses.nodes.items():
            handle = self._handles[name]
            if moved is None or moved[name][0][i]:
                handle.position = positions[i]
            if moved is None or moved[name][1][i]:
                handle.wxyz = quaternions[i]

    def _place_holder(self, samples: NDArray[Any]) -> tuple[Array, Array]:
        """The probe's holder from the true tip: a flexible arm bends before the probe."""
        assert self.robot.probe is not None
        q_WH = multiply_quaternions(samples["q_WT"], np.broadcast_to(_Q_TH, (len(samples), 4)))
        back = np.zeros((len(samples), 3))
        back[:, 0] = samples["spring"] - self.robot.probe.length_m
        return samples["p_WT"] + rotate_vectors(q_WH, back), q_WH

    # --- drawing -------------------------------------------------------------------------------

    def _name_nodes(self) -> list[str]:
        """Scene tree names; the probe hangs on the world, because its tip is known directly."""
        names: list[str] = []
        for part in self.drawing.parts:
            above = names[part.parent] if part.parent >= 0 and part.name != "holder" else ""
            names.append(f"{above}/{part.name.replace('/', '_')}")
        return names

    def _draw_robot(self) -> None:
        spin = self.robot.rotors.spin
        for part, name in zip(self.drawing.parts, self._names, strict=True):
            self._handles[name] = self.server.scene.add_frame(
                name, show_axes=False, position=part.position, wxyz=part.quaternion
            )
            colours: dict[tuple[Colour, float], list[Shape]] = {}
            for shape in part.shapes:
                colour, opacity = _colour(shape)
                if shape.name.startswith("propeller"):
                    colour = CCW if spin[int(shape.name[9:])] == "ccw" else CW
                    opacity = 0.45
                colours.setdefault((colour, opacity), []).append(shape)
            for i, ((colour, opacity), shapes) in enumerate(colours.items()):
                self._mesh(f"{name}/look{i}", merge_meshes(_meshes(shapes)), colour, opacity)

    def _draw_world(self) -> None:
        scene = self.server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(cast_shadow=True)
        for shape in self.drawing.world:
            if shape.kind == "plane":
                scene.add_grid(
                    "/ground", 20.0, 20.0, cell_size=0.25, section_size=1.0,
                    cell_color=(222, 226, 230), section_color=(190, 197, 205),
                    plane_color=(244, 245, 247), plane_opacity=1.0, shadow_opacity=0.25,
                    position=(0.0, 0.0, -0.001),
                )  # fmt: skip
            else:
                colour, opacity = _colour(shape)
                self._mesh(f"/world/{shape.name}", build_mesh(shape, 64), colour, opacity)
        pipe, welds = self.world.pipe, self.world.list_welds()
        for k, weld in enumerate(welds):
            assert pipe is not None
            points, normals = weld_curve(pipe, weld)
            for i, (p, n) in enumerate(zip(points, normals, strict=True)):
                ribbon = build_ribbon(p + 0.0006 * n, n, 2.0 * weld.half_width_m)
                self._mesh(f"/world/weld{k}_{i}", ribbon, WELD, 1.0, double=True)

        area = get_structures(self.world).area
        if area is not None:
            x, y = (area.x_min_m, area.x_max_m), (area.y_min_m, area.y_max_m)
            edges = _list_edges(x, y, (0.0, area.z_max_m))
            scene.add_line_segments(
                "/world/area", edges, np.array(AREA, np.uint8), thickness=1.0,
                thickness_units="screen",
            )  # fmt: skip

    def draw_wind(self, at: Array) -> None:
        """Draw the steady wind as an arrow that ends at `at` (3,), 0.12 m for each m/s."""
        wind = self.world.wind
        toward = math.radians(wind.toward_deg)
        v = np.array([math.cos(toward) * wind.mean_mps, math.sin(toward) * wind.mean_mps, 0.0])
        v[2] = wind.vertical_mps
        speed = float(np.linalg.norm(v))
        if wind.kind == "none" or speed < 1e-6:
            return
        tail = at - 0.12 * v
        self.server.scene.add_arrows(
            "/wind", np.array([[tail, at]]), WIND, shaft_radius=0.012, head_radius=0.035,
            head_length=0.09,
        )  # fmt: skip
        self.server.scene.add_label("/wind/text", f"wind {speed:.1f} m/s", position=tail)

    def draw_surface_line(
        self, name: str, s: Array, c: Array, width: float, colour: Colour, lift: float = 0.001
    ) -> None:
        """Draw a band along (s, c) (n,), m on the unrolled pipe, `lift` (m) above the surface."""
        assert self.world.pipe is not None
        points, normals = roll_points(build_cylinder(self.world.pipe), s, c)
        mesh = build_ribbon(points + lift * normals, normals, width)
        self._mesh(name, mesh, colour, 1.0, double=True)

    def draw_sketch(self, sketch: Sketch) -> None:
        """Draw a mission's numbered way-points and its path on the pipe."""
        self._draw_path(sketch.on_pipe)
        for i, p in enumerate(sketch.points):
            self.server.scene.add_icosphere(
                f"/waypoints/{i}", radius=0.025, color=WAYPOINT, subdivisions=2, position=p
            )
            self.server.scene.add_label(f"/waypoints/{i}/name", f"{i + 1}", position=(0, 0, 0.05))

    def _draw_path(self, path_sphi: Array) -> None:
        """Draw a path on the pipe: (n, 2) s (m) and phi (rad)."""
        if self.world.pipe is None or len(path_sphi) < 2:
            return
        s, c = path_sphi[:, 0], 0.5 * self.world.pipe.diameter_m * path_sphi[:, 1]
        way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(s), np.diff(c)))])
        _, keep = np.unique(np.floor(way / 0.002), return_index=True)  # points 2 mm apart
        if len(keep) > 1:
            self.draw_surface_line("/plan", s[keep], c[keep], 0.004, PLAN, lift=0.0003)

    def _mesh(
        self, name: str, mesh: Mesh, colour: Colour, opacity: float, double: bool = False
    ) -> Any:
        solid = opacity >= 1.0
        return self.server.scene.add_mesh_simple(
            name, mesh.vertices, mesh.faces, color=colour, opacity=None if solid else opacity,
            side="double" if double or not solid else "front", cast_shadow=solid and not double,
            receive_shadow=solid,
        )  # fmt: skip


def start_server(host: str = "127.0.0.1", port: int = 0) -> viser.ViserServer:
    """Start a viser server without its greeting; port 0 takes a free one."""
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, verbose=False)
    # a page may ask viser for a public address through a tunnel: never here
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    return server


def stop_server(server: viser.ViserServer) -> None:
    """Stop a viser server without its farewell."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


class View(NamedTuple):
    """A place of the camera."""

    name: str
    position: Array  # (3,) m
    look_at: Array  # (3,) m


FOV = math.radians(45.0)
ASPECT = 1.3  # narrower than most windows, so that what must be seen fits


def build_view(name: str, points: Array, look_at: Array, side: Array, margin: float = 1.15) -> View:
    """Return the nearest camera in direction `side` (3,) from `look_at` that sees all points.

    `points` (n, 3) and `look_at` (3,) in W; the camera stays above the ground.
    """
    back = side / np.linalg.norm(side)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    d = points - look_at
    half = math.tan(FOV / 2)
    across, above = np.abs(d @ right) / (half * ASPECT), np.abs(d @ up) / half
    distance = float(np.max(d @ back + margin * np.maximum(across, above)))
    position = look_at + max(distance, 0.4) * back
    position[2] = max(position[2], 0.2)
    return View(name, position, look_at)


def set_camera(server: viser.ViserServer, view: View) -> None:
    """Start the camera at a view."""
    camera = server.initial_camera
    camera.fov = FOV
    camera.position, camera.look_at = view.position, view.look_at


def _list_edges(*ranges: tuple[float, float]) -> Array:
    """Return the edges (12, 2, 3) of a box from its range on each axis."""
    corners = np.array([[x, y, z] for x in ranges[0] for y in ranges[1] for z in ranges[2]])
    apart = np.sum(corners[:, None] != corners[None], axis=2)
    return corners[np.argwhere(np.triu(apart == 1))]


def build_views(robot: Robot, world: World, flown: Array) -> list[View]:
    """Return places to look from; the first is the start. `flown` (n, 3): platform positions."""
    reach = 0.5 * robot.platform.diameter_m
    around = reach * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-0.4, 0.6)])
    points = (flown[:, None] + around).reshape(-1, 3)
    if world.pipe is None or robot.arm is None:
        look_at = 0.5 * (points.min(axis=0) + points.max(axis=0))
        views = [
            build_view("overview", points, look_at, np.array([-0.5, -1.0, 0.5])),
            build_view("from above", points, look_at, np.array([-1e-3, -1e-2, 1.0])),
        ]
        if get_structures(world).area is not None:  # gaps are seen along the way
            views.append(build_view("from behind", points, look_at, np.array([-1.0, 0.0, 0.15])))
        return views
    cyl = build_cylinder(world.pipe)
    ends = cyl.p_WP + np.outer([-cyl.half_length, cyl.half_length], cyl.R_WP[:, 1])
    distance = np.linalg.norm(flown - cyl.p_WP, axis=1)
    near = flown[distance <= distance.min() + 0.3].mean(axis=0)
    way = near - cyl.p_WP  # from the pipe to where the robot works
    flat = way * [1, 1, 0]
    size = float(np.linalg.norm(flat))
    flat = flat / size if size > 0.05 else np.array([-1.0, 0.0, 0.0])
    left = np.cross([0.0, 0.0, 1.0], flat)
    touch = cyl.p_WP + cyl.radius * way / max(float(np.linalg.norm(way)), 1e-6)
    close = touch + 0.35 * way
    seen = np.concatenate([points, ends, ends * [1, 1, 0]])
    middle = 0.5 * (0.5 * (seen.min(axis=0) + seen.max(axis=0)) + close)
    # a probe works on the side that the platform is on; hands reach around, above or below
    near_by, rise, work = 0.16, 0.7, touch
    if robot.probe is None:
        near_by, rise, work = cyl.radius + 0.4, 0.0, cyl.p_WP
    spot = work + near_by * np.array([flat, left, -left, [0, 0, 1.0], [0, 0, -1.0]])
    up = np.array([0.0, 0.0, 1.0])
    return [
        build_view("overview", seen, middle, 0.6 * flat + left + 0.4 * up, margin=1.05),
        build_view("robot", near + 1.1 * around, close, 0.5 * flat + left + 0.35 * up),
        build_view(
            "probe" if robot.probe is not None else "pipe",
            spot,
            work,
            0.7 * flat + 0.9 * left + rise * up,
        ),
    ]


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


def _meshes(shapes: list[Shape]) -> list[Mesh]:
    return [build_mesh(shape) for shape in shapes]
