"""COLLADA meshes of imported robots, against files whose triangles are known."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import imported_models as models
from skywright.core.arrays import Array
from skywright.core.rotations import rot_x, rot_z
from skywright.description.robot.loader import load_robot
from skywright.description.robot.mesh import decode_mesh
from skywright.errors import InputError
from skywright.models.importing import collada_meshes
from skywright.models.importing.collada_meshes import Surface, read_collada
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.importing.visuals import read_mesh

NAMESPACE = "http://www.collada.org/2005/11/COLLADASchema"
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
"""Of the cube, seen from outside counter-clockwise."""
FANS = [f for a, b, c, d in QUADS for f in ((a, b, c), (a, c, d))]
TRIANGLES = f'<triangles count="12" material="skin">@<p>{" ".join(str(i) for f in FANS for i in f)}</p></triangles>'  # noqa: E501
ONE = '<node id="n"><instance_geometry url="#g"/></node>'


def write_dae(
    path: Path, scene: str = ONE, shapes: str = TRIANGLES, asset: str = "", library: str = "",
    places: str = "",
) -> Path:  # fmt: skip
    """A unit cube as geometry `g`; `@` in `shapes` stands for its input."""
    places = places or " ".join(f"{x:g}" for x in CUBE.ravel())
    axes = "".join(f'<param name="{a}" type="float"/>' for a in "XYZ")
    path.write_text(f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="{NAMESPACE}" version="1.4.1"><asset>{asset}</asset>{library}
<library_geometries><geometry id="g"><mesh><source id="s"><float_array id="a" count="24">{places}
</float_array><technique_common><accessor source="#a" count="8" stride="3">{axes}</accessor>
</technique_common></source><vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
{shapes.replace("@", '<input semantic="VERTEX" source="#v" offset="0"/>')}
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="scene">{scene}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>""")
    return path


def join(surfaces: tuple[Surface, ...]) -> Array:
    """The corners (m, 3, 3) m of all triangles."""
    return np.concatenate([surface.vertices[surface.faces] for surface in surfaces])


def measure(corners: Array) -> tuple[float, Array]:
    """Volume (m^3) and centre (3,) m of a closed surface whose triangles are seen from outside."""
    parts = np.linalg.det(corners) / 6.0
    middles = np.sum(corners, axis=1) / 4.0
    return float(np.sum(parts)), np.asarray(parts @ middles / np.sum(parts))


@pytest.mark.parametrize("axis", ["X_UP", "Y_UP", "Z_UP"])
def test_units_and_nodes_place_the_mesh_and_up_axis_does_not(tmp_path: Path, axis: str) -> None:
    """Transforms act from the last to the first, outer nodes after inner ones; then the inch."""
    scene = (
        '<node id="a"><translate>1 2 3</translate><rotate>0 0 1 90</rotate>'
        '<node id="b"><matrix>1 0 0 4 0 1 0 0 0 0 1 -1 0 0 0 1</matrix><rotate>1 0 0 30</rotate>'
        '<scale>2 3 4</scale><instance_geometry url="#g"/></node></node>'
    )
    unit = f'<unit name="inch" meter="0.0254"/><up_axis>{axis}</up_axis>'
    found = join(read_mesh(write_dae(tmp_path / "a.dae", scene, asset=unit)))
    inner = CUBE * [2, 3, 4] @ rot_x(np.pi / 6).T + [4, 0, -1]
    want = 0.0254 * (inner @ rot_z(np.pi / 2).T + [1, 2, 3])
    np.testing.assert_allclose(found, want[np.array(FANS)], atol=1e-7)


POLYGONS = "".join(f"<p>{a} {b} {c} {d}</p>" for a, b, c, d in QUADS)
STRIPS = "".join(f"<p>{a} {b} {d} {c}</p>" for a, b, c, d in QUADS)
INDICES = " ".join(f"{i}" for q in QUADS for i in q)
WITH_NORMALS = " ".join(f"{i} {i}" for q in QUADS for i in q)


@pytest.mark.parametrize("shapes", [
    TRIANGLES,
    f'<polylist count="6">@<vcount>4 4 4 4 4 4</vcount><p>{INDICES}</p></polylist>',
    # another input beside, a line, and polygons of two corners, which are none
    f'<polylist count="8">@<input semantic="NORMAL" source="#s" offset="1"/><vcount>2 4 4 4 4 4 4 1'
    f'</vcount><p>0 0 1 1 {WITH_NORMALS} 0 0</p></polylist><lines count="1">@<p>0 1</p></lines>',
    f'<polygons count="6">@{POLYGONS}</polygons>',
    f'<tristrips count="6">@{STRIPS}</tristrips>',
    f'<trifans count="6">@{POLYGONS}</trifans>',
])  # fmt: skip
def test_all_kinds_of_faces_make_the_cube(tmp_path: Path, shapes: str) -> None:
    corners = join(read_mesh(write_dae(tmp_path / "a.dae", shapes=shapes)))
    assert len(corners) == 12
    volume, centre = measure(corners)
    assert volume == pytest.approx(1.0)
    np.testing.assert_allclose(centre, 0.5, atol=1e-12)


def test_instances_are_drawn_each_and_mirrored_ones_from_outside(tmp_path: Path) -> None:
    nodes = '<library_nodes><node id="part"><scale>-2 1 1</scale><instance_geometry url="#g"/></node></library_nodes>'  # noqa: E501
    scene = (
        f'{ONE}<node id="m"><translate>0 5 0</translate><instance_node url="#part"/></node>'
        '<node id="k"><translate>0 0 7</translate><instance_node url="#part"/></node>'
    )
    surfaces = read_mesh(write_dae(tmp_path / "a.dae", scene, library=nodes))
    found = [measure(surface.vertices[surface.faces]) for surface in surfaces]
    assert [volume for volume, _ in found] == pytest.approx([1.0, 2.0, 2.0])
    np.testing.assert_allclose(
        [centre for _, centre in found], [[0.5, 0.5, 0.5], [-1, 5.5, 0.5], [-1, 0.5, 7.5]],
        atol=1e-12,
    )  # fmt: skip


def library(diffuse: str) -> str:
    """A material `paint`."""
    return f"""<library_effects><effect id="e"><profile_COMMON><technique sid="common"><lambert>
<diffuse>{diffuse}</diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="paint"><instance_effect url="#e"/></material>
</library_materials>"""


BOUND = (
    '<node id="n"><instance_geometry url="#g"><bind_material><technique_common>'
    '<instance_material symbol="skin" target="#paint"/></technique_common></bind_material>'
    "</instance_geometry></node>"
)
BLUE = library("<color>0 0.2 0.8 1</color>")


def take(folder: Path, visual: str = "", **parts: str) -> tuple[Imported, dict[str, str]]:
    """Import a hexarotor whose platform is the cube; returns the colour of each mesh."""
    file = models.write_hexa(folder)
    write_dae(folder / "hexa_base" / "body.dae", **parts)
    base = folder / "hexa_base" / "model.sdf"
    base.write_text(base.read_text().replace("</geometry>", f"</geometry>{visual}"))
    made = import_robot(Request(file, assume=True), folder / "made")
    meshes = load_robot(made.path)[0].meshes
    for mesh in meshes.values():
        assert measure(decode_mesh(mesh.data)[0][decode_mesh(mesh.data)[1]])[0] > 0.0
    return made, {name: mesh.color for name, mesh in meshes.items()}


@pytest.mark.parametrize(("visual", "colors", "color"), [
    ("", BLUE, "#0033cc"),
    ("<material><diffuse>1 0 0 1</diffuse></material>", BLUE, "#ff0000"),
    ("", library('<texture texture="t" texcoord="u"/>'), "#8a919c"),
    ("", library("<color>a b c</color>"), "#8a919c"),
    ("", library("<color>nan 0 0 1</color>"), "#8a919c"),
    ("", "", "#8a919c"),
])  # fmt: skip
def test_the_robot_s_file_paints_first_and_the_mesh_s_then(
    tmp_path: Path, visual: str, colors: str, color: str
) -> None:
    made, found = take(tmp_path, visual, scene=BOUND, library=colors)
    assert list(found.values()) == [color]
    assert not [note for note in made.notes if "left out: " in note and ".dae" in note]


def test_a_mesh_of_many_colours_is_drawn_in_few(tmp_path: Path) -> None:
    """Each colour is a table of the robot file."""
    parts, bound, paint = "", "", ""
    for i in range(70):
        paint += library(f"<color>{i / 70} 0 0 1</color>").replace('"e"', f'"e{i}"').replace(
            '"paint"', f'"paint{i}"').replace('"#e"', f'"#e{i}"')  # fmt: skip
        parts += TRIANGLES.replace("skin", f"skin{i}")
        bound += f'<instance_material symbol="skin{i}" target="#paint{i}"/>'
    one = '<instance_material symbol="skin" target="#paint"/>'
    _, found = take(tmp_path, scene=BOUND.replace(one, bound), shapes=parts, library=paint)
    assert len(found) == 1


LEAVES = "".join(
    f'<node id="n{i}"><instance_node url="#n{i + 1}"/><instance_node url="#n{i + 1}"/></node>'
    for i in range(39, -1, -1)
)
BAD = {
    "entities": {"asset": "&lol;"},
    "deep": {"scene": "<node>" * 300 + "</node>" * 300},
    "instances of instances": {
        "library": f'<library_nodes><node id="n40"/>{LEAVES}</library_nodes>',
        "scene": '<node><instance_node url="#n0"/></node>',
    },
    "many transforms": {
        "library": f'<library_nodes><node id="n">{"<scale/>" * 9000}</node></library_nodes>',
        "scene": '<node><instance_node url="#n"/></node>' * 99,
    },
    "no node": {"scene": '<node><instance_node url="#n"/></node>'},
    "a node in itself": {
        "library": '<library_nodes><node id="n"><instance_node url="#n"/></node></library_nodes>',
        "scene": '<node><instance_node url="#n"/></node>',
    },
    "a skin": {"scene": '<node><instance_controller url="#c"/></node>'},
    "no geometry": {"scene": '<node><instance_geometry url="#other"/></node>'},
    "nothing": {"scene": "<node/>"},
    "no number": {"places": "0 0 0 1 x 0"},
    "too few": {"places": "0 0 0 1 0 0"},
    "infinite": {"places": "1e99 " * 24},
    "unit": {"asset": '<unit meter="0"/>'},
    "unit, no number": {"asset": '<unit meter="inch"/>'},
    "matrix": {"scene": ONE.replace('"n">', '"n"><matrix>1 2 3</matrix>')},
    "negative": {"shapes": '<triangles count="1">@<p>0 -1 2</p></triangles>'},
    "beyond": {"shapes": '<triangles count="1">@<p>0 1 8</p></triangles>'},
    "polygons of gigabytes": {
        "shapes": "<polylist>@<vcount>2000000000 2000000000</vcount><p>0 1 2</p></polylist>"
    },
    "offset": {
        "shapes": TRIANGLES.replace("@", '<input semantic="VERTEX" source="#v" offset="9"/>')
    },
    "no source": {"shapes": TRIANGLES.replace("@", "")},
}
SAYS = {
    "entities": "a document type or entity declaration is refused",
    "deep": "200 nested",
    "instances of instances": "its scene has more than 100000 elements",
    "many transforms": "its scene has more than 100000 elements",
    "a node in itself": "its scene has more than 100000 elements",
    "no node": "<instance_node> of '#n', which does not exist",
    "a skin": "<instance_controller> of a node, a skin, is not read",
    "no geometry": "<instance_geometry> of '#other', which does not exist",
    "nothing": "its scene holds no triangles",
    "infinite": "not finite",
    "unit": "meter of <unit> is 0; valid: above 0",
    "unit, no number": "meter of <unit> is 'inch'",
    "matrix": "<matrix> of a node is '1 2 3'; 16 finite number(s) are required",
    "negative": "index -1 of a vertex; valid: 0 to 7",
    "polygons of gigabytes": "<vcount> has 4000000000 corners of polygons, <p> 3",
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_left_out_with_one_note(tmp_path: Path, name: str) -> None:
    path = write_dae(tmp_path / "bad.dae", **BAD[name])
    if name == "entities":
        text = path.read_text()
        path.write_text(text.replace("<COLLADA", '<!DOCTYPE x [<!ENTITY lol "ha">]><COLLADA', 1))
    with pytest.raises(InputError, match=r"bad\.dae") as refused:
        read_mesh(path)
    assert SAYS.get(name, "not read as COLLADA") in str(refused.value)
    assert "\n" not in str(refused.value)


def test_what_is_no_collada_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.dae"
    path.write_text("<html/>")
    with pytest.raises(InputError, match="the root element is <html>; valid: <COLLADA>"):
        read_mesh(path)
    with zipfile.ZipFile(path, "w") as packed:  # pycollada alone would unpack it
        packed.writestr("b.dae", "<COLLADA/>")
    with pytest.raises(InputError, match=r"not a text file|not XML"):
        read_collada(path, 10_000)
    good = write_dae(tmp_path / "b.dae", ONE * 2)
    for wrong in ('offset="3" stride="3"', 'stride="4"'):  # pycollada ignores both
        path.write_text(good.read_text().replace('stride="3"', wrong))
        with pytest.raises(InputError, match="<accessor> of vertices has offset"):
            read_mesh.__wrapped__(path)
    with pytest.raises(InputError, match="larger than"):
        read_collada(good, 1000)
    monkeypatch.setattr(collada_meshes, "MOST_TRIANGLES", 23)
    with pytest.raises(InputError, match="more than 23 triangles"):
        read_collada(good, 10_000)


def test_the_import_goes_on_without_a_broken_mesh(tmp_path: Path) -> None:
    made, found = take(tmp_path, scene="<node/>")
    assert not found
    assert made.deviations.worst()[1] < 1e-6
    (note,) = [note for note in made.notes if ".dae" in note]
    assert note.startswith("mesh left out: ") and note.endswith("its scene holds no triangles")


def test_without_pycollada_the_note_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "collada", None)
    made, found = take(tmp_path)
    assert not found
    assert [note for note in made.notes if ".dae" in note] == [
        "mesh left out: COLLADA meshes (.dae) need pycollada: pip install 'skywright[collada]'"
    ]


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, data) -> None:
    folder = tmp_path_factory.getbasetemp()
    text = write_dae(folder / "good.dae", BOUND, library=BLUE).read_text()
    at = data.draw(st.integers(0, len(text) - 1))
    size = data.draw(st.integers(0, 40))
    put = data.draw(st.sampled_from(["", "-", "9", "<", "#", "e9", ' "', "</node>", "nan "]))
    path = folder / f"cut{at}_{size}_{len(put)}.dae"
    path.write_text(text[:at] + put + text[at + size :])
    try:
        surfaces = read_collada(path, 100_000)
    except InputError as error:
        assert len(str(error)) < 500
    else:
        assert np.all(np.isfinite(join(surfaces)))
    path.unlink()
