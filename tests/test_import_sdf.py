"""SDF files: versions, frames, limits, inertias and includes, judged by hand and by MuJoCo."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import imported_models as models
from skywright.core.arrays import Array
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.importing.sdf import Sdf, read_sdf
from skywright.models.importing.xml_input import read_xml
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip
from skywright.models.rotors import build_rotors

HUBS = [(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]
FIXED = '<joint name="pj" type="fixed"><parent>base</parent><child>pod</child></joint>'


def links(parent: str = "base") -> str:
    """The links and joints of four rotors of 20 g."""
    return "".join(
        f"""<link name="prop{i}"><pose>{x} {y} 0.05 0 0 0</pose>
{models.inertial("sdf", 0.02, "0 0 0", models.SMALL)}</link><joint name="spin{i}" type="revolute">
<parent>{parent}</parent><child>prop{i}</child><axis><xyz>0 0 1</xyz></axis></joint>"""
        for i, (x, y) in enumerate(HUBS)
    )


def plugins() -> str:
    return "".join(
        f"""<plugin filename="motor" name="m{i}"><jointName>spin{i}</jointName>
<linkName>prop{i}</linkName><turningDirection>{"ccw" if i % 2 else "cw"}</turningDirection>
<timeConstantUp>0.02</timeConstantUp><timeConstantDown>0.02</timeConstantDown>
<maxRotVelocity>1000</maxRotVelocity><motorConstant>9e-6</motorConstant>
<momentConstant>0.016</momentConstant></plugin>"""
        for i in range(4)
    )


def base() -> str:
    body = models.inertial("sdf", 1.5, "0 0 0", models.BODY)
    return f'<link name="base">{body}</link>{links()}'


def quad(folder: Path, extra: str, version: str = "1.9") -> Path:
    """A quadrotor of 1.58 kg, whose frame is that of the model."""
    text = f'<model name="q">{base()}{plugins()}{extra}</model>'
    return models.write(folder / "q" / "model.sdf", f'<sdf version="{version}">{text}</sdf>')


def take(file: Path, folder: Path) -> tuple[Imported, Any]:
    made = import_robot(Request(file, assume=True), folder / "made")
    return made, load_robot(made.path)[0]


def read(file: Path) -> Sdf:
    return read_sdf(file, read_xml(file))


def arm(limits: str = "<lower>-1</lower><upper>1</upper>") -> str:
    """One hinge, whose link is yawed by 90 deg, with a tool 0.2 m along x of the link."""
    small = models.inertial("sdf", 0.1, "0.05 0 0", models.SMALL)
    return f"""<link name="upper"><pose>0.1 0 -0.1 0 0 {math.pi / 2}</pose>{small}</link>
<joint name="shoulder" type="revolute"><parent>base</parent><child>upper</child>
<axis><xyz>0 1 0</xyz><limit>{limits}</limit></axis></joint>
<link name="tool"><pose relative_to="upper">0.2 0 0 0 0 0</pose>{small}</link>
<joint name="t" type="fixed"><parent>upper</parent><child>tool</child></joint>"""


@pytest.mark.parametrize("version", ["1.4", "1.5", "1.10", "1.12"])
def test_a_version_is_two_numbers(tmp_path: Path, version: str) -> None:
    """From 1.5 on, the axis is y of the yawed link, -x of the model; before, y of the model."""
    robot = take(quad(tmp_path, arm(), version), tmp_path)[1]
    tip = compute_tip(build_body_model(robot), np.array([0.5]))[0]
    along = np.array([0.0, 0.2, 0.0])  # the tool from the joint
    turned = along if version == "1.4" else 0.2 * np.array([0.0, math.cos(0.5), -math.sin(0.5)])
    np.testing.assert_allclose(tip, np.array([0.1, 0.0, -0.1]) + turned, atol=1e-9)


@pytest.mark.parametrize("version", ["1.x", "one", "1", "1.10.2", ""])
def test_a_version_that_is_none_is_refused(tmp_path: Path, version: str) -> None:
    with pytest.raises(InputError, match=f"model.sdf: version is '{version}'; valid: MAJOR.MINOR"):
        take(quad(tmp_path, arm(), version), tmp_path)


def test_thousands_of_frames_in_a_chain(tmp_path: Path) -> None:
    frames = "".join(
        f'<frame name="f{i}"><pose relative_to="f{i + 1}">0.001 0 0 0 0 0</pose></frame>'
        for i in range(3000)
    )
    pod = f'<link name="pod"><pose relative_to="f0"/></link>{FIXED}'
    file = quad(tmp_path, f'{frames}<frame name="f3000"/>{pod}')
    np.testing.assert_allclose(read(file).spec.body("pod").pos, [3.0, 0.0, 0.0], atol=1e-9)
    for last in ('<frame name="f3000"><pose relative_to="f5"/></frame>',
                 '<frame name="f3000" attached_to="f5"/>'):  # fmt: skip
        with pytest.raises(InputError, match=r"'f[0-9]+' is circular"):
            take(quad(tmp_path, f"{frames}{last}{pod}"), tmp_path)


@pytest.mark.parametrize(
    ("limits", "low", "high"),
    [
        ("<lower>-inf</lower><upper>inf</upper>", -180.0, 180.0),  # assumed
        ("<lower>-Infinity</lower><upper>0.5</upper>", -360.0, math.degrees(0.5)),
        ("<lower>-0.5</lower><upper> +inf </upper>", math.degrees(-0.5), 360.0),
    ],
)
def test_infinite_limits_are_none(tmp_path: Path, limits: str, low: float, high: float) -> None:
    more = f"{limits}<effort>inf</effort><velocity>inf</velocity>"
    made, robot = take(quad(tmp_path, arm(more)), tmp_path)
    link, sources = list_joints(robot)[0].link, load_robot(made.path)[1]
    assert (link.joint_min_deg, link.joint_max_deg) == pytest.approx((low, high))
    free = low == -180.0
    assert sources["robot.arm.upper.joint_min_deg"].kind == ("assumed" if free else "imported")
    servo = list_servos(robot)[0][1]
    assert math.isfinite(servo.stall_torque_nm)
    assert math.isfinite(servo.no_load_speed_rad_s)
    for key in ("stall_torque_nm", "no_load_speed_rad_s"):
        assert sources[f"robot.arm.upper_servo.{key}"].kind == "assumed"


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ("<lower>nan</lower>", "'shoulder': lower is 'nan'"),
        ("<velocity>nan</velocity>", "limit of .*'shoulder'.* 'nan'"),
        ("<effort>-inf</effort>", "limit of .*'shoulder'.* -inf"),
        ("<lower>inf</lower><upper>inf</upper>", "'shoulder': both limits are inf"),
        ("<lower>inf</lower><upper>-inf</upper>", "'shoulder': lower limit inf is above"),
    ],
)
def test_limits_that_cannot_be_are_refused(tmp_path: Path, limits: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        take(quad(tmp_path, arm(limits)), tmp_path)


def full(model: mujoco.MjModel, name: str) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it, in the frame of a body."""
    body, R = model.body(name), np.zeros(9)
    mujoco.mju_quat2Mat(R, body.iquat)
    R = R.reshape(3, 3)
    return float(body.mass[0]), body.ipos.copy(), R @ np.diag(body.inertia) @ R.T


BOX = ("<box><size>0.1 0.2 0.3</size></box>", 'type="box" size=".05 .1 .15"')
ROD = "<radius>0.03</radius><length>0.2</length>"
SHAPES = {
    "box": [(BOX, 100.0)],
    "sphere": [(("<sphere><radius>0.1</radius></sphere>", 'type="sphere" size=".1"'), None)],
    "cylinder": [((f"<cylinder>{ROD}</cylinder>", 'type="cylinder" size=".03 .1"'), 500.0)],
    "capsule": [((f"<capsule>{ROD}</capsule>", 'type="capsule" size=".03 .1"'), 500.0)],
    "ellipsoid": [(("<ellipsoid><radii>.1 .2 .3</radii></ellipsoid>",
                    'type="ellipsoid" size=".1 .2 .3"'), 50.0)],
    "two": [(BOX, None), ((f"<cylinder>{ROD}</cylinder>", 'type="cylinder" size=".03 .1"'), 70.0)],
}  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("common", [None, 250.0])
def test_an_automatic_inertia_is_that_of_mujoco_s_shapes(
    tmp_path: Path, name: str, common: float | None
) -> None:
    collisions, geoms = "", ""
    for i, ((shape, geom), density) in enumerate(SHAPES[name]):
        at, turn = f"0.1 {0.2 * i} -0.3", "0.4 -0.5 0.6"
        own = "" if density is None else f"<density>{density}</density>"
        collisions += f"""<collision name="c{i}"><pose>{at} {turn}</pose>{own}
<geometry>{shape}</geometry></collision>"""
        geoms += f'<geom {geom} pos="{at}" euler="{turn}" density="{density or common or 1000.0}"/>'
    other = mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler angle="radian" eulerseq="XYZ"/>
<worldbody><body name="pod">{geoms}</body></worldbody></mujoco>"""
    )
    said = "" if common is None else f"<density>{common}</density>"
    pod = f'<link name="pod"><inertial auto="true">{said}</inertial>{collisions}</link>{FIXED}'
    found = read(quad(tmp_path, pod, "1.11"))
    for mine, theirs in zip(full(found.spec.compile(), "pod"), full(other, "pod"), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-12)
    guessed = common is None and None in [density for _, density in SHAPES[name]]
    assert any("1000 kg/m^3" in note for note in found.notes) == guessed
    assert set(found.assumed) == ({"pod"} if guessed else set())


def test_the_inertia_of_a_cone_is_that_of_its_discs(tmp_path: Path) -> None:
    """Its apex is at z = length/2."""
    shape = "<cone><radius>0.1</radius><length>0.4</length></cone>"
    pod = f"""<link name="pod"><inertial auto="true"><density>200</density></inertial>
<collision name="c"><geometry>{shape}</geometry></collision></link>{FIXED}"""
    mass, com, inertia = full(read(quad(tmp_path, pod, "1.12")).spec.compile(), "pod")
    n = 20000
    z = -0.2 + 0.4 * (np.arange(n) + 0.5) / n
    r = 0.1 * (0.2 - z) / 0.4
    m = 200.0 * math.pi * r**2 * 0.4 / n
    middle = np.sum(m * z) / np.sum(m)
    across = np.sum(m * (r**2 / 4.0 + (z - middle) ** 2))
    np.testing.assert_allclose(mass, np.sum(m), rtol=1e-6)
    np.testing.assert_allclose(com, [0.0, 0.0, middle], atol=1e-6)
    want = np.diag([across, across, np.sum(m * r**2 / 2.0)])
    np.testing.assert_allclose(inertia, want, atol=1e-8)


def test_an_automatic_inertia_enters_the_robot(tmp_path: Path) -> None:
    """A box of 0.1 kg, of a frame 0.2 m above the link, beside a given mass that scales it."""
    shape = "<geometry><box><size>0.1 0.1 0.1</size></box></geometry>"
    pod = (
        """<frame name="up" attached_to="pod"><pose>0 0 0.2 0 0 0</pose></frame><link name="pod">
<inertial auto="true">{mass}</inertial><collision name="c"><density>100</density>
<pose relative_to="up">0 0 0 0 0 0</pose>"""
        + f"{shape}</collision></link>{FIXED}"
    )
    for given, mass in (("", 0.1), ("<mass>0.4</mass>", 0.4)):
        found = read(quad(tmp_path, pod.replace("{mass}", given), "1.11")).spec.compile()
        m, com, inertia = full(found, "pod")
        assert m == pytest.approx(mass)
        np.testing.assert_allclose(com, [0.0, 0.0, 0.2], atol=1e-12)
        np.testing.assert_allclose(inertia, mass * 0.1**2 / 6.0 * np.eye(3), atol=1e-12)
    made, robot = take(quad(tmp_path, pod.replace("{mass}", ""), "1.11"), tmp_path)
    assert compute_body(build_body_model(robot), np.zeros(0))[0] == pytest.approx(1.68)
    assert any("link pod: 0.1 kg of its collision shapes" in note for note in made.notes)
    assert load_robot(made.path)[1]["robot.platform.mass_kg"].kind == "imported"


@pytest.mark.parametrize(
    ("collision", "says"),
    [
        ("", "link 'pod': .*requires a <collision>"),
        ("<collision name='c'><geometry><mesh><uri>a.dae</uri></mesh></geometry></collision>",
         "link 'pod': collision 'c': the inertia of <mesh> is not computed .*valid: box"),
        ("<collision name='c'><geometry><sphere/></geometry></collision>", "size of <sphere>"),
        ("<collision name='c'><density>0</density><geometry><sphere><radius>1</radius></sphere>"
         "</geometry></collision>", "<density> is 0"),
    ],
)  # fmt: skip
def test_shapes_without_a_closed_form_are_refused(
    tmp_path: Path, collision: str, says: str
) -> None:
    pod = f'<link name="pod"><inertial auto="true"/>{collision}</link>{FIXED}'
    with pytest.raises(InputError, match=says):
        take(quad(tmp_path, pod, "1.11"), tmp_path)


TERMS = "<inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia>"


@pytest.mark.parametrize(
    ("inertial", "says", "assumed"),
    [
        ("", "has no <inertial>", {"mass_kg", "com_x_m", "inertia_xx_kgm2", "inertia_yy_kgm2",
                                   "inertia_zz_kgm2"}),
        ("<inertial><mass>0.05</mass></inertial>", "has no <inertia> (1 kg m^2",
         {"inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2"}),
        ("<inertial><mass>0.05</mass><inertia><ixx>1</ixx></inertia></inertial>",
         "has no <iyy> and <izz>", {"inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2"}),
        (f"<inertial>{TERMS}</inertial>", "has no <mass> (1 kg",
         {"mass_kg", "com_x_m", "inertia_yy_kgm2", "inertia_zz_kgm2"}),
        (f"<inertial><mass>0.05</mass>{TERMS}</inertial>", "", set()),
    ],
)  # fmt: skip
def test_default_masses_and_inertias_are_assumed(
    tmp_path: Path, inertial: str, says: str, assumed: set[str]
) -> None:
    """The pod is 0.5 m ahead, so its mass enters the moments about y and z."""
    pod = f'<link name="pod"><pose>0.5 0 0 0 0 0</pose>{inertial}</link>{FIXED}'
    made, robot = take(quad(tmp_path, pod), tmp_path)
    assert any(note.startswith(f"link pod {says}") for note in made.notes) == bool(says)
    sources = load_robot(made.path)[1]
    keys = {key: sources[f"robot.platform.{key}"] for key in (
        "mass_kg", "com_x_m", "inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2")}  # fmt: skip
    found = {key for key, source in keys.items() if source.kind == "assumed"}
    assert found - {"inertia_xx_kgm2"} == assumed - {"inertia_xx_kgm2"}
    if "mass_kg" in assumed:  # 1 g to 2 kg beside the 1.58 kg of the rest
        assert keys["mass_kg"].range == pytest.approx((1.581, 3.58))
        assert "defaults for pod" in keys["mass_kg"].note
    for key in found:
        low, high = keys[key].range
        assert low < getattr(robot.platform, key) < high


@pytest.mark.parametrize(
    ("inertial", "says"),
    [
        ("<mass></mass>", "<mass> is empty; valid: one number"),
        ("<mass>-0.1</mass>", "<mass> is -0.1 kg; valid: 0 or more"),
        ("<mass>heavy</mass>", "mass is 'heavy'"),
        ("<mass>1</mass><inertia><ixx> </ixx></inertia>", "<ixx> is empty"),
    ],
)
def test_numbers_of_an_inertia_are_checked(tmp_path: Path, inertial: str, says: str) -> None:
    pod = f'<link name="pod"><inertial>{inertial}</inertial></link>{FIXED}'
    with pytest.raises(InputError, match=f"model.sdf: link 'pod': {says}"):
        take(quad(tmp_path, pod), tmp_path)


def test_an_empty_mass_of_urdf_names_the_link(tmp_path: Path) -> None:
    file = models.write_urdf_quad(tmp_path)
    file.write_text(file.read_text().replace('mass value="0.08"', 'mass value=""'))
    with pytest.raises(InputError, match=r"flyer.urdf: mass of link 'upper' is ''.* required"):
        take(file, tmp_path)


@pytest.mark.parametrize(
    ("entries", "mass"),
    [
        ([("1.6", "gps.sdf")], 0.01),
        ([("1.10", "new.sdf"), ("1.9", "gps.sdf"), ("99.0", "future.sdf")], 0.02),
        ([("99.0", "future.sdf")], 0.03),
        ([], 0.04),
    ],
)
def test_model_config_names_the_file(
    tmp_path: Path, entries: list[tuple[str, str]], mass: float
) -> None:
    for name, m in (("gps", 0.01), ("new", 0.02), ("future", 0.03), ("model", 0.04)):
        link = f'<link name="pod">{models.inertial("sdf", m, "0 0 0", models.SMALL)}</link>'
        text = f'<sdf version="1.6"><model name="gps">{link}</model></sdf>'
        models.write(tmp_path / "gps" / f"{name}.sdf", text)
    listed = "".join(f'<sdf version="{v}">{file}</sdf>' for v, file in entries)
    config = models.write(tmp_path / "gps" / "model.config", f"<model>{listed}</model>")
    joint = FIXED.replace(">pod<", ">gps::pod<")
    file = quad(tmp_path, f"<include><uri>model://gps</uri></include>{joint}")
    robot = take(file, tmp_path)[1]
    assert compute_body(build_body_model(robot), np.zeros(0))[0] == pytest.approx(1.58 + mass)
    config.write_text('<model><sdf version="1.6">lost.sdf</sdf></model>')
    with pytest.raises(InputError, match=r"model.config: names 'lost.sdf', which is not beside it"):
        read(file)


@pytest.mark.parametrize("merge", ["", ' merge="true"'])
@pytest.mark.parametrize("deep", [False, True])
def test_plugins_of_an_include_name_the_included_links(
    tmp_path: Path, merge: str, deep: bool
) -> None:
    """In an include of an include too; names of joints alone would give rotors by their names."""
    text = f'<sdf version="1.9"><model name="x3">{base()}</model></sdf>'
    models.write(tmp_path / "x3" / "model.sdf", text)
    include = f"<include{merge}><uri>model://x3</uri>{plugins()}</include>"
    if deep:
        text = f'<sdf version="1.9"><model name="mid">{include}</model></sdf>'
        models.write(tmp_path / "mid" / "model.sdf", text)
        include = "<include><uri>model://mid</uri><name>a</name></include>"
    text = f'<sdf version="1.9"><model name="top">{include}</model></sdf>'
    made, robot = take(models.write(tmp_path / "top" / "model.sdf", text), tmp_path)
    assert (made.rotors, made.rotor_origin) == (4, "plug-in tags")
    assert robot.rotors.thrust_max_n == pytest.approx(9.0)
    places = build_rotors(robot.rotors).position
    np.testing.assert_allclose(places, [(x, y, 0.05) for x, y in HUBS], atol=1e-12)


POD = """<link name="case"><pose>0 0 0.1 0 0 0</pose>{mass}</link>
<link name="pod"><pose>0.1 0 0.2 0 0 0</pose>{mass}</link>
<joint name="in" type="fixed"><parent>case</parent><child>pod</child></joint>
<frame name="hook" attached_to="seat"><pose>0 0 0.3 0 0 0</pose></frame>
<frame name="seat" attached_to="case"/>"""


@pytest.mark.parametrize(
    ("parent", "child"),
    [
        ("mount", "box::case"),
        ("__model__", "box::hook"),  # a frame of a frame of a link
        ("base", "box"),  # the included model itself: its first link
        ("nut", "box"),  # the frame of a joint: its child
    ],
)
def test_a_joint_may_join_frames(tmp_path: Path, parent: str, child: str) -> None:
    """A hinge without a pose is at the frame of its child; that frame's link moves."""
    small = models.inertial("sdf", 0.1, "0 0 0", models.SMALL)
    text = f'<sdf version="1.7"><model name="box">{POD.replace("{mass}", small)}</model></sdf>'
    models.write(tmp_path / "box" / "model.sdf", text)
    more = f"""<frame name="mount" attached_to="base"><pose>0 0 0.5 0 0 0</pose></frame>
<link name="bolt"/><joint name="nut" type="fixed"><parent>base</parent><child>bolt</child></joint>
<include><uri>model://box</uri><pose>0 0.3 0 0 0 0</pose></include>
<joint name="hinge" type="revolute"><parent>{parent}</parent><child>{child}</child>
<axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis></joint>"""
    model = read(quad(tmp_path, more, "1.7")).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    over = model.body(model.body("box::case").parentid[0]).name
    assert over == ("bolt" if parent == "nut" else "base")
    np.testing.assert_allclose(data.body("box::pod").xpos, [0.1, 0.3, 0.2], atol=1e-12)
    up = {"box::case": 0.1, "box::hook": 0.4, "box": 0.0}[child]
    np.testing.assert_allclose(data.joint("hinge").xanchor, [0.0, 0.3, up], atol=1e-12)


@pytest.mark.parametrize(
    ("ends", "says"),
    [
        ("<parent>base</parent><child>lost</child>", "'pj' joins 'lost', which is no link"),
        ("<parent>base</parent><child>world</child>", "'pj' joins 'world', which is no link"),
        ("<parent>f</parent><child>pod</child>", "attached_to 'f' is circular"),
        ("<parent>mine</parent><child>pod</child>", "'pj' joins link 'pod' to itself"),
    ],
)
def test_ends_of_a_joint_that_cannot_be_are_refused(tmp_path: Path, ends: str, says: str) -> None:
    more = f"""<link name="pod"/><joint name="pj" type="fixed">{ends}</joint>
<frame name="f" attached_to="g"/><frame name="g" attached_to="f"/>
<frame name="mine" attached_to="pod"/>"""
    with pytest.raises(InputError, match=says):
        take(quad(tmp_path, more), tmp_path)
