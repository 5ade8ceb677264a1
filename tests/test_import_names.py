"""Names in imported files: repeated ones, those that the importer uses, and those in messages."""

from __future__ import annotations

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
