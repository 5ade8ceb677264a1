"""SDF files: versions, frames, limits and includes, judged by hand and by MuJoCo."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

import imported_models as models
from sdf_quad import FIXED, HUBS, base, plugins, quad, read, take
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.rigid_body import build_body_model, compute_body, compute_tip
from skywright.models.rotors import build_rotors


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
        ("<velocity>nan</velocity>", "joint 'shoulder': velocity of <limit> is 'nan'"),
        ("<effort>-inf</effort>", "joint 'shoulder': effort of <limit> is -inf"),
        ("<lower>inf</lower><upper>inf</upper>", "'shoulder': both limits are inf"),
        ("<lower>inf</lower><upper>-inf</upper>", "'shoulder': lower limit inf is above"),
    ],
)
def test_limits_that_cannot_be_are_refused(tmp_path: Path, limits: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        take(quad(tmp_path, arm(limits)), tmp_path)


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
