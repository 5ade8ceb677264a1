"""MJCF files that MuJoCo reads in a way of its own, or that would exhaust it."""

# ruff: noqa: E501

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import imported_models as models
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.models.importing import opening
from skywright.models.importing.importer import Imported, Request, import_robot
from skywright.models.importing.opening import open_file
from skywright.models.rigid_body import build_body_model, compute_body


def take(file: Path, tmp_path: Path, name: str = "made", **given: Any) -> tuple[Imported, Any]:
    """Import with guesses; return what was made and the robot as it is read from its file."""
    made = import_robot(Request(file, **({"assume": True} | given)), tmp_path / name)
    return made, load_robot(made.path)[0]


def change(tmp_path: Path, *changes: tuple[str, str]) -> Path:
    """The quadrotor of MJCF with other text."""
    file = models.write_quad(tmp_path)
    text = file.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)
    return file


@pytest.mark.parametrize(("old", "new", "says"), [
    ("<freejoint/>", '<freejoint/><body><joint name="j" range="-inf inf" limited="true"/>'
     '<geom size=".1"/></body>', "range of joint 'j' is -inf inf; two finite numbers"),
    ("<freejoint/>", '<freejoint/><body><joint name="j" range="-1 inf"/><geom size=".1"/></body>',
     "range of joint 'j' is -1 inf"),
    ("0.1 12", "0.1 inf", "ctrlrange of actuator '' is 0.1 inf"),
    ('pos="0.15 0.17 0.09"/>', 'pos="inf 0.17 0.09"/>', "site_pos holds numbers that are not"),
])  # fmt: skip
@pytest.mark.filterwarnings("error")
def test_infinite_numbers_are_named(tmp_path: Path, old: str, new: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        take(change(tmp_path, (old, new)), tmp_path)


def test_a_range_beyond_a_turn_is_compared(tmp_path: Path) -> None:
    """Numbers of which the difference is no float."""
    arm = """<mujoco><compiler angle="radian"/><worldbody><body name="b"><geom size=".05" mass=".2"/><body name="l" pos=".1 0 0">
<joint name="j" range="-1e308 1e308" limited="true"/><geom size=".05" pos=".1 0 0" mass=".1"/>
</body></body></worldbody></mujoco>"""
    file = models.write(tmp_path / "arm.xml", arm)
    made, _ = take(models.write_quad(tmp_path), tmp_path, arm=file)
    assert made.joints == ["arm/j"]


@pytest.mark.parametrize("text", [
    ('autolimits="true"', 'autolimits="true" alignfree="true"'),
    ("<freejoint/>", '<freejoint align="true"/>'),
])  # fmt: skip
def test_b_stays_the_body_s_frame(tmp_path: Path, text: tuple[str, str]) -> None:
    """MuJoCo would turn it to the principal axes of the inertia."""
    _, plain = take(models.write_quad(tmp_path), tmp_path, "plain")
    _, robot = take(change(tmp_path, text), tmp_path)
    assert robot.rotors == plain.rotors
    assert robot.platform.inertia_xz_kgm2 == pytest.approx(plain.platform.inertia_xz_kgm2)


def test_meshes_stay_in_place_with_alignfree(tmp_path: Path) -> None:
    """The drawn meshes come from a second reading of the file."""
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
    models.write(tmp_path / "body.obj", obj)
    tables = []
    for i, text in enumerate(("", ' alignfree="true"')):
        file = change(tmp_path, ('autolimits="true"', f'autolimits="true"{text}'))
        tables.append(take(file, tmp_path, f"made{i}")[1].meshes)
    assert tables[0] == tables[1] and tables[0]


def test_contact_pairs_of_pictures_are_left_out(tmp_path: Path) -> None:
    file = change(
        tmp_path,
        ('<geom class="picture"', '<geom name="seen" class="picture"'),
        ('<geom type="box"', '<geom name="box" type="box"'),
        ("<actuator>", '<contact><pair geom1="seen" geom2="box"/></contact><actuator>'),
    )
    _, robot = take(file, tmp_path)
    assert compute_body(build_body_model(robot), np.zeros(0))[0] == pytest.approx(1.2)


# files and copies


@pytest.mark.parametrize("tag", ["include", "attach"])
@pytest.mark.parametrize("between", [True, False])
def test_a_file_that_reads_itself_is_refused(tmp_path: Path, tag: str, between: bool) -> None:
    """MuJoCo's reader follows attached files until its stack overflows, and the process dies."""
    other = "parts/other.xml" if between else "robot.xml"
    names = {
        "robot.xml": other,
        "parts/other.xml": "../robot.xml" if tag == "attach" else "robot.xml",
    }
    for name, file in names.items():
        use = f'<include file="{file}"/>' if tag == "include" else (
            f'<asset><model name="m" file="{file}"/></asset>'
            '<worldbody><attach model="m" body="b" prefix="p"/></worldbody>'
        )  # fmt: skip
        text = f'<mujoco>{use}<worldbody><body name="b"/></worldbody></mujoco>'
        models.write(tmp_path / name, text)
    with pytest.raises(InputError, match=f"{tag}(e)?s itself by way of") as error:
        open_file(tmp_path / "robot.xml")
    assert "\n" not in str(error.value)


def test_attached_files_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also an attached file that attaches another one beside it, by a relative path."""
    leaf = '<worldbody><body name="leaf"><geom size=".1" mass=".25"/></body></worldbody>'
    models.write(tmp_path / "parts" / "leaf.xml", f'<mujoco model="leaf">{leaf}</mujoco>')
    asset = '<mujoco><asset><model file="leaf.xml"/></asset></mujoco>'
    models.write(tmp_path / "parts" / "list.xml", asset)
    attach = '<body name="mid"><attach model="leaf" body="leaf" prefix="l/"/></body>'
    use = f'<include file="list.xml"/><worldbody>{attach}</worldbody>'
    models.write(tmp_path / "parts" / "mid.xml", f"<mujoco>{use}</mujoco>")
    file = change(tmp_path, ("<asset>", '<asset><model name="mid" file="parts/mid.xml"/>'),
                  ("<freejoint/>", '<freejoint/><attach model="mid" body="mid" prefix="m/"/>'))  # fmt: skip
    monkeypatch.chdir(tmp_path)
    _, robot = take(Path(file.name), tmp_path)
    assert compute_body(build_body_model(robot), np.zeros(0))[0] == pytest.approx(1.2 + 0.25)


@pytest.mark.parametrize("tag", ["include", "attach"])
def test_files_that_name_others_twice_end_soon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tag: str
) -> None:
    """Of 18 files each reads the next one twice: 2^18 in all."""
    for i in range(18):
        file = f"f{i + 1}.xml"
        use = (f'<include file="{file}"/>' * 2 if tag == "include" else
               f'<asset><model name="a" file="{file}"/><model name="b" file="{file}"/></asset>')  # fmt: skip
        models.write(tmp_path / f"f{i}.xml", f"<mujoco>{use}</mujoco>")
    models.write(tmp_path / "f18.xml", '<mujoco><worldbody><body name="b"/></worldbody></mujoco>')
    monkeypatch.setattr(opening, "read_mjcf", lambda path: pytest.fail("MuJoCo reads the file"))
    with pytest.raises(InputError, match="more than 200 times"):
        open_file(tmp_path / "f0.xml")


BODY = '<body><geom size=".1"/></body>'
COPIES = {
    "flat": (f'<replicate count="30000" offset="1 0 0">{BODY}</replicate>', "30000 copies"),
    "nested": (f'<replicate count="30"><replicate count="30">{BODY}</replicate></replicate>',
               "900 copies"),
    "side by side": (f'<replicate count="300">{BODY}</replicate>' * 2, "600 bodies"),
    "geoms": ('<body><replicate count="501"><geom size=".1"/></replicate></body>', "501 copies"),
    "infinite": (f'<replicate count="inf">{BODY}</replicate>', "count of <replicate>"),
    "composite": ('<body><composite prefix="c" type="cable" count="9999 1 1" curve="s"><geom size=".1"/>'
                  "</composite></body>", "9999 copies"),
    "attached": ('<replicate count="300"><attach model="m" body="b" prefix="p"/></replicate>',
                 "bodies with all copies"),
}  # fmt: skip


@pytest.mark.parametrize("name", COPIES)
def test_copies_are_counted_before_mujoco_makes_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(opening, "read_mjcf", lambda path: pytest.fail("MuJoCo reads the file"))
    text, says = COPIES[name]
    models.write(
        tmp_path / "part.xml",
        f'<mujoco><worldbody><body name="b">{BODY}</body></worldbody></mujoco>',
    )
    asset = '<asset><model name="m" file="part.xml"/></asset>'
    file = models.write(
        tmp_path / "many.xml", f"<mujoco>{asset}<worldbody>{text}</worldbody></mujoco>"
    )
    with pytest.raises(InputError, match=says):
        open_file(file)


def test_a_few_copies_are_read(tmp_path: Path) -> None:
    site = (
        '<replicate count="4" euler="0 0 90"><geom size=".01" pos=".1 0 0" mass=".05"/></replicate>'
    )
    _, robot = take(change(tmp_path, ("<freejoint/>", f"<freejoint/>{site}")), tmp_path)
    assert compute_body(build_body_model(robot), np.zeros(0))[0] == pytest.approx(1.2 + 4 * 0.05)
