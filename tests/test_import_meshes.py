"""Meshes of imported robots: where they are found, where they end up, what is left out and why."""

from __future__ import annotations

import csv
import math
import runpy
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import imported_models as models
from skywright.core.arrays import Array
from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.description.robot.loader import load_robot
from skywright.description.robot.mesh import MAX_TRIANGLES, decode_mesh, encode_mesh
from skywright.description.robot.spec import Robot
from skywright.description.world.spec import World
from skywright.errors import InputError
from skywright.models.drawing import build_drawing
from skywright.models.importing import visuals
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.importing.looks import list_looks
from skywright.models.importing.opening import open_file
from skywright.models.rigid_body import build_body_model, compute_kinematics
from skywright.reports.meshes import build_mesh
from skywright.reports.scene3d import Scene3d

CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def write_stl(path: Path, vertices: Array = CORNERS, faces: Array = FACES) -> Path:
    """A binary STL file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *vertices[f].ravel().astype(np.float32), 0) for f in faces
    )
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(faces)) + body)
    return path


def write_text_stl(path: Path) -> Path:
    """The same in text."""
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"  vertex {x:e} {y} {z}\n" for x, y, z in CORNERS[f])
        + "endloop\nendfacet\n"
        for f in FACES
    )
    path.write_text(f"solid part\n{facets}endsolid part\n")
    return path


def write_obj(path: Path) -> Path:
    """The same as a Wavefront file."""
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    lines += [f"f {a} {b} {c}" for a, b, c in FACES + 1]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def take(file: Path, folder: Path, **more: Any) -> tuple[Imported, Robot]:
    """Import with guesses."""
    made = import_robot(Request(file, **({"assume": True} | more)), folder / "made")
    return made, load_robot(made.path)[0]


def draw(file: Path, visual: str, link: str = "main_body", before: str = "") -> Path:
    """Put a visual on a link of a URDF file, and materials before it."""
    text = file.read_text().replace('<robot name="flyer">', f'<robot name="flyer">{before}')
    file.write_text(text.replace(f'<link name="{link}">', f'<link name="{link}">{visual}'))
    return file


def mesh_tag(uri: str, scale: str = "0.01 0.01 0.01") -> str:
    return (
        f'<visual><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/><geometry><mesh filename="{uri}" '
        f'scale="{scale}"/></geometry><material name="red"/></visual>'
    )


WANT = 0.01 * CORNERS @ (rot_z(0.6) @ rot_y(-0.5) @ rot_x(0.4)).T + [0.1, 0.2, 0.3]
RED = '<material name="red"><color rgba="0.8 0.2 0.2 1"/></material>'


def check_corners(found: Array, want: Array = WANT, atol: float = 2e-6) -> None:
    """Each of the corners is there, in any order."""
    apart = np.linalg.norm(found[:, None] - want[None], axis=2)
    assert np.max(apart.min(axis=0)) < atol
    assert np.max(apart.min(axis=1)) < atol


@pytest.mark.parametrize("uri", [
    "package://flyer_description/meshes/part.stl", "meshes/part.stl", "../lib/part.obj",
    "../lib/text.stl",
    "file://{}/flyer_description/meshes/part.stl",
])  # fmt: skip
def test_a_mesh_is_found_scaled_and_placed(tmp_path: Path, uri: str) -> None:
    root = tmp_path / "flyer_description"
    write_stl(root / "meshes" / "part.stl")
    write_stl(root / "urdf" / "meshes" / "part.stl")
    write_obj(root / "lib" / "part.obj")
    write_text_stl(root / "lib" / "text.stl")
    file = draw(models.write_urdf_quad(root / "urdf"), mesh_tag(uri.format(tmp_path)), before=RED)
    made, robot = take(file, tmp_path)
    assert made.meshes == 1
    (mesh,) = robot.meshes.values()
    assert (mesh.on, mesh.color) == ("platform", "#cc3333")
    check_corners(decode_mesh(mesh.data)[0])
    source = load_robot(made.path)[1][f"robot.meshes.{next(iter(robot.meshes))}.data"]
    assert source.kind == "imported"
    assert source.note.endswith("4 of 4 triangles")


def test_a_mesh_on_a_link_moves_with_it(tmp_path: Path) -> None:
    """In the robot file the link has other axes; what is drawn is in the same place."""
    write_stl(tmp_path / "part.stl")
    file = draw(models.write_urdf_quad(tmp_path), mesh_tag("part.stl"), "slider")
    _, robot = take(file, tmp_path)
    (mesh,) = robot.meshes.values()
    assert mesh.on == "link_slider"
    k = compute_kinematics(build_body_model(robot), np.zeros(2))
    vertices = decode_mesh(mesh.data)[0] @ k["R"][1].T + k["p"][1]
    R1 = rot_z(0.7) @ rot_y(-0.2) @ rot_x(0.3)
    p1 = np.array([0.05, 0.0, -0.04])
    R2, p2 = R1 @ rot_y(0.4), p1 + R1 @ [0.1, 0.02, 0.03]
    check_corners(vertices, WANT @ R2.T + p2)


def test_mjcf_places_its_geoms_by_itself(tmp_path: Path) -> None:
    file = models.write_quad(tmp_path)
    write_obj(tmp_path / "body.obj")
    text = file.read_text().replace('<mesh file="body.obj"/>',
                                    '<mesh file="body.obj" scale="0.01 0.01 0.01"/>')  # fmt: skip
    file.write_text(text.replace('mesh="body" material="skin"',
                                 'mesh="body" pos="0.1 0 0" euler="90 0 0"'))  # fmt: skip
    made, robot = take(file, tmp_path)
    (mesh,) = robot.meshes.values()
    assert made.notes[-1].startswith("contacts: ")
    check_corners(decode_mesh(mesh.data)[0], 0.01 * CORNERS @ rot_x(math.pi / 2).T + [0.1, 0, 0])


@pytest.mark.parametrize(("mesh", "geom", "want"), [
    ('scale=".01 .02 .03" refpos="1 2 3" refquat="0.6 0 0 0.8"', "",
     (CORNERS - [1, 2, 3]) @ rot_z(2.0 * math.atan2(0.8, 0.6)) * [0.01, 0.02, 0.03]),
    # a contact pair calls the geom by its name, and another shape is fitted to the mesh
    ('scale=".01 .01 .01"', 'name="shell" mass=".01"', 0.01 * CORNERS),
])  # fmt: skip
def test_mjcf_meshes_have_frames_names_and_fitted_shapes(
    tmp_path: Path, mesh: str, geom: str, want: Array
) -> None:
    file = models.write_quad(tmp_path)
    write_obj(tmp_path / "body.obj")
    text = file.read_text().replace('<mesh file="body.obj"/>', f'<mesh file="body.obj" {mesh}/>')
    text = text.replace('mesh="body" material="skin"', f'mesh="body" {geom}')
    if geom:
        text = text.replace("</body></worldbody>", '<geom type="box" mesh="body" mass="0"/>'
                            '</body><geom name="floor" type="plane" size="1 1 1"/></worldbody>'
                            '<contact><pair geom1="shell" geom2="floor"/></contact>')  # fmt: skip
    file.write_text(text)
    (found,) = take(file, tmp_path)[1].meshes.values()
    check_corners(decode_mesh(found.data)[0], want)


def test_a_scale_beyond_numbers_leaves_the_mesh_out(tmp_path: Path) -> None:
    write_stl(tmp_path / "part.stl")
    file = draw(models.write_urdf_quad(tmp_path), mesh_tag("part.stl", "1e308 1e308 1e308"))
    made, robot = take(file, tmp_path)
    assert not robot.meshes
    assert "mesh left out: part.stl reaches" in made.notes[-1]


def test_a_mesh_of_sdf_is_placed_relative_to_a_frame(tmp_path: Path) -> None:
    """The link is at x = 0.2, turned by 90 deg about z, and the frame at x = 0.5."""
    file = models.write(
        tmp_path / "model.sdf",
        """<sdf version="1.9"><model name="m">
<frame name="ahead"><pose>0.5 0 0 0 0 0</pose></frame>
<link name="base"><pose degrees="true">0.2 0 0 0 0 90</pose>
<visual name="v"><pose relative_to="ahead">0 0 0.1 0 0 0</pose>
<geometry><mesh><uri>part.stl</uri></mesh></geometry></visual></link></model></sdf>""",
    )
    (look,) = list_looks(open_file(file), "")
    np.testing.assert_allclose(look.p, [0.0, -0.3, 0.1], atol=1e-12)
    np.testing.assert_allclose(look.R, rot_z(-math.pi / 2), atol=1e-12)


def test_sdf_finds_meshes_beside_the_model_that_it_includes(tmp_path: Path) -> None:
    file = models.write_hexa(tmp_path)
    write_stl(tmp_path / "hexa_base" / "body.stl")
    base = tmp_path / "hexa_base" / "model.sdf"
    for uri in ("model://hexa_base/body.stl", "body.stl"):
        base.write_text(base.read_text().replace("model://hexa_base/body.dae", uri)
                        .replace("model://hexa_base/body.stl", uri))  # fmt: skip
        made = import_robot(Request(file, assume=True), tmp_path / uri[:4])
        mesh = next(iter(load_robot(made.path)[0].meshes.values()))
        check_corners(decode_mesh(mesh.data)[0], CORNERS, 1e-4)


@pytest.mark.parametrize(("uri", "says"), [
    ("package://lost/meshes/part.stl", "lost/meshes/part.stl' of flyer.urdf was not found"),
    ("../../../../../../../../outside.stl", "lies outside of the model's folders"),
    ("part.dae", "part.dae: not XML"),
    ("part.png", r"valid meshes: .stl, .obj, .msh, .dae"),
    ("text.stl", "text.stl"),
    ("cut.stl", "cut.stl"),
    ("nan.stl", "nan.stl"),
    ("big.stl", "big.stl: 0 MB; at most 0 are read"),
    ("far.stl", "far.stl reaches"),
    ("\\0.stl", "was not found"),
])  # fmt: skip
def test_what_is_no_mesh_is_left_out_with_the_reason(
    tmp_path: Path, uri: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "a" / "b" / "c" / "d" / "e"
    here.mkdir(parents=True)
    for name in ("part.dae", "part.png", "text.stl"):
        (here / name).write_text("solid of no triangles; vertex 1 2 3")
    whole = write_stl(here / "part.stl").read_bytes()
    (here / "cut.stl").write_bytes(whole[:150])
    write_stl(here / "nan.stl", CORNERS * np.nan)
    write_stl(here / "far.stl", CORNERS * 1e6)
    write_stl(here / "big.stl", np.tile(CORNERS, (2, 1)), np.concatenate([FACES, FACES + 4]))
    write_stl(tmp_path / "outside.stl")
    if uri == "big.stl":
        monkeypatch.setattr(visuals, "LARGEST_FILE", 300)
    if uri.startswith(".."):
        uri = "../../../../../outside.stl"
    file = draw(models.write_urdf_quad(here), mesh_tag(uri))
    made, robot = take(file, tmp_path)
    assert not robot.meshes
    notes = [note for note in made.notes if note.startswith("mesh left out: ")]
    assert len(notes) == 1
    assert says in notes[0].replace("\n", " ")
    assert len(notes[0]) < 400


def test_meshes_can_be_left_out(tmp_path: Path) -> None:
    write_stl(tmp_path / "part.stl")
    file = draw(models.write_urdf_quad(tmp_path), mesh_tag("part.stl"))
    assert take(file, tmp_path, meshes=False)[0].meshes == 0


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), most=st.integers(50, 600))
def test_a_simplified_mesh_is_small_and_in_the_same_place(seed: int, most: int) -> None:
    """Cells of a grid: the surface stays within a cell of where it was, and the limit is used."""
    rng = np.random.default_rng(seed)
    n = 40
    u, v = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, n), indexing="ij")
    size = rng.uniform(0.1, 2.0, 3)
    ball = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], -1) * size
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = i * n + j
    faces = np.concatenate([np.stack([a, a + 1, a + n], 1), np.stack([a + 1, a + n + 1, a + n], 1)])
    vertices, kept = visuals.simplify(ball.reshape(-1, 3), faces, most)
    assert 0 < len(kept) <= most
    # a ball of extent d in cells of c has about 2 pi (d / c)^2 triangles
    off = np.linalg.norm(vertices[:, None] - ball.reshape(1, -1, 3), axis=2).min(axis=1)
    cell = np.ptp(vertices, axis=0).max() * math.sqrt(2.0 * math.pi / most)
    assert np.max(off) < cell, "the surface stays near"
    text = encode_mesh(vertices, kept)
    back, same = decode_mesh(text)
    np.testing.assert_array_equal(same, kept)
    assert np.max(np.abs(back - vertices)) <= 1.01 * np.ptp(vertices, axis=0).max() / 65535.0


def test_triangles_that_share_no_corner_fit_into_a_table() -> None:
    rng = np.random.default_rng(1)
    n = MAX_TRIANGLES - 500
    soup = rng.uniform(-1, 1, (n, 1, 3)) + 0.01 * rng.normal(size=(n, 3, 3))
    vertices, faces = visuals.simplify(soup.reshape(-1, 3), np.arange(3 * n).reshape(n, 3), n)
    back, same = decode_mesh(encode_mesh(vertices, faces))
    assert len(same) > 0.95 * (2**16 // 3), "the grid is as fine as the limit allows"
    edges = back[same[:, 0]] - back[same[:, 1]]
    assert np.linalg.norm(edges, axis=1).max() < 0.5, "no corner is that of another triangle"


GOOD = encode_mesh(CORNERS, FACES)
HEAVY = encode_mesh(np.zeros((3, 3)), np.zeros((MAX_TRIANGLES + 1, 3), int))


@pytest.mark.parametrize(("change", "says"), [
    ({"data": "????"}, "holds no triangles"),
    ({"data": GOOD[: len(GOOD) // 2 // 4 * 4]}, "triangles"),
    ({"data": HEAVY}, "valid: 1 to 24000, whole"),
    ({"data": encode_mesh(CORNERS, FACES + 1)}, "a vertex that does not exist"),
    ({"data": encode_mesh(CORNERS * 100.0, FACES)}, "farther away than 20 m"),
    ({"on": "wing"}, "meshes.body.on is 'wing'; valid: platform"),
    ({"color": "red"}, "color"),
])  # fmt: skip
def test_a_table_that_holds_no_mesh_is_refused(
    tmp_path: Path, change: dict[str, str], says: str
) -> None:
    table = {"on": "platform", "color": "#102030", "data": GOOD} | change
    lines = "".join(f'{key} = "{value}"\n' for key, value in table.items())
    file = tmp_path / "robot.toml"
    file.write_text(f'[robot]\nname = "x"\nextends = "hexarotor"\n[robot.meshes.body]\n{lines}')
    with pytest.raises(InputError, match=says) as refused:
        load_robot(file)
    assert len(str(refused.value)) < 300


def test_pages_draw_the_mesh_and_contacts_take_the_shapes(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text('[robot]\nname = "x"\nextends = "hexarotor"\n[robot.meshes.body]\n'
                    f'color = "#102030"\ndata = "{GOOD}"\n')  # fmt: skip
    robot = load_robot(file)[0]
    world = World(name="nowhere")
    platform = build_drawing(robot, world).parts[0]
    names = [shape.name for shape in platform.shapes]
    assert names == [f"propeller{i}" for i in range(6)] + ["body"]
    check_corners(build_mesh(platform.shapes[-1]).vertices, CORNERS, 1e-4)
    plain = build_drawing(robot, world, meshes=False).parts[0]
    assert "hub" in [shape.name for shape in plain.shapes]
    drawn = [m for m in Scene3d(robot, world).meshes if m["rgb"] == [16, 32, 48]]
    assert len(drawn) == 1


def test_the_page_has_the_record_of_public_models(repository: Path) -> None:
    module = runpy.run_path(str(repository / "docs" / "generate_imports.py"))
    text = module["PAGE"].read_text(encoding="utf-8")
    assert text == module["build_page"](text), "run: python docs/generate_imports.py"
    with module["KEPT"].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 5
    assert len({row["from"] for row in rows}) >= 4
    assert sum(row["outcome"].startswith("refused") for row in rows) <= 1
    found = [float(row["deviation"].split()[0]) for row in rows if row["deviation"]]
    assert max(found) < 1e-6
