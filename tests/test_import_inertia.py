"""Masses and inertias of SDF links: automatic, by default and malformed."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

import imported_models as models
from sdf_quad import FIXED, quad, read, take
from skywright.core.arrays import Array
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.rigid_body import build_body_model, compute_body


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
