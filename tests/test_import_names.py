"""Names in imported files: repeated ones, those that the importer uses, and those in messages."""

# ruff: noqa: E501

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

import imported_models as models
from skywright import cli


def refuse(file: Path, folder: Path, *options: str) -> str:
    """The one line with which the command refuses a file; nothing is written."""
    out = folder / "made"
    result = CliRunner().invoke(
        cli.main, ["import", str(file), "--assume", "--out", str(out), *options]
    )
    assert result.exit_code == 2, result.output
    assert not out.exists()
    line = result.output.strip()
    assert "\n" not in line
    return line


@pytest.mark.parametrize(("old", "new", "says"), [
    ('joint name="rail"', 'joint name="shoulder"', "two joints are named 'shoulder'; valid: a"),
    ('link name="slider"', 'link name="upper"', "two links are named 'upper'; valid: a name of"),
    ('joint name="rail"', 'joint name="rotor1"', "two joints are named 'rotor1'"),
])  # fmt: skip
def test_a_repeated_name_of_a_urdf_file_is_named(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    """MuJoCo's message is without the name, or raised at another place."""
    file = models.write_urdf_quad(tmp_path)
    file.write_text(file.read_text().replace(old, new))
    assert f"flyer.urdf: {says}" in refuse(file, tmp_path)


@pytest.mark.parametrize(
    ("kind", "name"), [("urdf", "free root"), ("urdf", "base"), ("urdf", ""), ("sdf", "free root")]
)
def test_any_name_of_a_joint_is_allowed(tmp_path: Path, kind: str, name: str) -> None:
    if kind == "urdf":
        file = models.write_urdf_quad(tmp_path)
        file.write_text(file.read_text().replace('joint name="shoulder"', f'joint name="{name}"'))
    else:
        file = models.write_hexa(tmp_path)
        base = tmp_path / "hexa_base" / "model.sdf"
        base.write_text(base.read_text().replace("rotor_3_joint", name))
        file.write_text(file.read_text().replace("rotor_3_joint", name))
    args = ["import", str(file), "--assume", "--out", str(tmp_path / "made")]
    result = CliRunner().invoke(cli.main, args)
    assert result.exit_code == 0, result.output


def test_a_message_about_joints_names_the_files(tmp_path: Path) -> None:
    file, arm = models.write_urdf_quad(tmp_path), models.urdf_arm(tmp_path)
    text = file.read_text()
    mimic = '<mimic joint="shoulder"/><limit lower="0" upper="0.12"'
    file.write_text(text.replace('<limit lower="0" upper="0.12"', mimic))
    line = refuse(file, tmp_path)
    assert "flyer.urdf: joints shoulder and rail of the arm are coupled" in line
    file.write_text(text)
    assert "flyer.urdf: --weld 'nix' is no joint; valid: " in refuse(
        file, tmp_path, "--weld", "nix"
    )
    quad = models.write_quad(tmp_path)
    limb = '<body name="{0}" pos="0 0 -.1"><joint name="{0}_joint" range="0 9"/><geom size=".1"/></body>'
    two = limb.format("left") + limb.format("right")
    quad.write_text(quad.read_text().replace("<freejoint/>", f"<freejoint/>{two}"))
    assert "quad.xml: several arms end after 1 joints" in refuse(quad, tmp_path)
    line = refuse(models.write_quad(tmp_path), tmp_path, "--arm", str(arm), "--tip", "arm/link5")
    assert re.search(r"quad.xml with \S+/arm.urdf: the tip \(arm/link5\) is at joint", line)
    models.write_quad(tmp_path)
    ball = '<body name="b"><joint name="wrist" type="ball"/><geom size=".1"/></body>'
    quad.write_text(quad.read_text().replace("<freejoint/>", f"<freejoint/>{ball}"))
    assert "quad.xml: joint 'wrist' is a ball joint; valid: hinge, slide" in refuse(quad, tmp_path)


@pytest.mark.parametrize("tip", ["tool", "table"])
def test_an_unknown_tip_lists_the_links_and_sites_of_the_robot(tmp_path: Path, tip: str) -> None:
    """A link of another robot in the file is not valid either."""
    file = models.write_quad(tmp_path)
    table = '</body><body name="table"><geom size=".1"/></body></worldbody>'
    file.write_text(file.read_text().replace("</body></worldbody>", table))
    line = refuse(file, tmp_path, "--tip", tip)
    says = f"quad.xml: --tip '{tip}' is neither a body (link) nor a site of the robot; valid: "
    assert says + "quad, s0, s1, s2, s3" in line


@pytest.mark.parametrize(("key", "value", "says"), [
    ("lower", "-inf", "flyer.urdf: joint 'shoulder': lower of <limit> is '-inf'; 1 finite number"),
    ("upper", "wide", "flyer.urdf: joint 'shoulder': upper of <limit> is 'wide'; 1 finite number"),
    ("effort", "much", "flyer.urdf: joint 'shoulder': effort of <limit> is 'much'; 1 finite"),
    ("velocity", "-inf", "flyer.urdf: joint 'shoulder': velocity of <limit> is -inf; valid: a n"),
])  # fmt: skip
def test_a_wrong_limit_is_named_with_its_key(
    tmp_path: Path, key: str, value: str, says: str
) -> None:
    file = models.write_urdf_quad(tmp_path)
    head, joint, rest = file.read_text().partition('<joint name="shoulder"')
    file.write_text(head + joint + re.sub(f'{key}="[^"]*"', f'{key}="{value}"', rest, count=1))
    assert says in refuse(file, tmp_path)


def test_the_next_command_can_be_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    file = models.write_quad(tmp_path)
    result = CliRunner().invoke(cli.main, ["import", str(file), "--assume", "--out", "my robot"])
    _, _, told = result.output.partition("next: ")
    check, fly = told.strip().split(", ")
    assert shlex.split(check) == ["skywright", "check", "my robot"]
    assert shlex.split(fly)[-1] == "my robot/robot.toml"
    assert CliRunner().invoke(cli.main, shlex.split(check)[1:]).exit_code == 0
