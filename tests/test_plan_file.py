"""Plan files: their names, what they replace, what their head holds, and inconsistent rows."""

from __future__ import annotations

import errno
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from click.testing import CliRunner

from skywright.cli import main
from skywright.errors import InputError
from skywright.planning.motion import plan_file
from skywright.planning.motion.plan_file import (
    PlanFile,
    check_replaceable,
    load_plan_file,
    name_files,
    write_plan_file,
)
from skywright.vehicle.rest_to_rest import quintic


def build_plan(height: float = 2.0, **more: Any) -> PlanFile:
    """A platform without joints that flies 1 m forward in 4 s, in rows of 20 ms."""
    t = np.linspace(0.0, 4.0, 201)
    s, ds, dds = quintic(t / 4.0)
    pose, rate, acceleration = (np.zeros((len(t), 4)) for _ in range(3))
    pose[:, 0], pose[:, 2] = s, height
    rate[:, 0], acceleration[:, 0] = ds / 4.0, dds / 16.0
    none = np.zeros((len(t), 0))
    plan = PlanFile("hexarotor", "open", 1, (), t, pose, rate, acceleration, none, none, {})
    return plan._replace(**more)


def test_only_the_suffixes_of_a_plan_file_are_removed(tmp_path: Path) -> None:
    """`wind3.5` and `wind3.6` are two plans."""
    assert [f.name for f in name_files("a/wind3.5.csv")] == ["wind3.5.csv", "wind3.5.toml"]
    assert [f.name for f in name_files("a/wind3.5")] == ["wind3.5.csv", "wind3.5.toml"]
    for name, height in (("wind3.5.csv", 2.0), ("wind3.6.toml", 3.0), ("wind3", 4.0)):
        write_plan_file(tmp_path / name, build_plan(height))
    for name, height in (("wind3.5", 2.0), ("wind3.6.csv", 3.0), ("wind3.csv", 4.0)):
        assert load_plan_file(tmp_path / name).pose[0, 2] == height


def test_files_that_are_no_plan_are_not_replaced(tmp_path: Path) -> None:
    robot, table = tmp_path / "mine.toml", tmp_path / "flown.csv"
    robot.write_text('[robot]\nname = "mine"\nextends = "hexarotor"\n')
    table.write_text("t,x\n0,1\n")
    (tmp_path / "broken.toml").write_text("[plan")
    (tmp_path / "folder.csv").mkdir()
    for name in ("mine.csv", "mine.toml", "flown.toml", "broken", "folder"):
        with pytest.raises(InputError, match=r"already exists and is not|is a folder"):
            write_plan_file(tmp_path / name, build_plan())
    assert robot.read_text().startswith("[robot]") and table.read_text() == "t,x\n0,1\n"
    write_plan_file(tmp_path / "again", build_plan(2.0))
    check_replaceable(tmp_path / "again.csv")
    write_plan_file(tmp_path / "again", build_plan(3.0))
    assert load_plan_file(tmp_path / "again").pose[0, 2] == 3.0


@pytest.mark.parametrize("name", [".", "", "..", "/"])
def test_a_path_without_a_name_is_refused(name: str) -> None:
    for use in (name_files, check_replaceable, load_plan_file):
        with pytest.raises(InputError, match=rf"'{re.escape(name)}' names no plan file; valid: NA"):
            use(name)


def test_files_that_cannot_be_read_are_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = write_plan_file(tmp_path / "p", build_plan())

    def fail(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", fail)
        with pytest.raises(InputError, match=r"p\.csv: already exists and cannot be read \(Perm"):
            check_replaceable(tmp_path / "p")
    check_replaceable(tmp_path / "p")
    files[1].unlink()
    os.mkfifo(files[1])  # opening it would block
    with pytest.raises(InputError, match=r"p\.toml: is a device or pipe"):
        check_replaceable(tmp_path / "p")


def test_the_command_refuses_a_file_of_its_user_before_it_plans(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = tmp_path / "bar.toml"
    mission.write_text('[mission]\nextends = "bar-transport"\n')
    before = mission.read_bytes()
    monkeypatch.setattr("skywright.plan", lambda *_: pytest.fail("planned"))
    found = CliRunner().invoke(main, ["plan", "bar-transport", "--out", str(mission)])
    assert found.exit_code == 2, found.output
    assert "bar.toml: already exists and is not part of a plan" in found.output + found.stderr
    inside = tmp_path / "bar.toml" / "plan.csv"
    found = CliRunner().invoke(main, ["plan", "bar-transport", "--out", str(inside)])
    assert found.exit_code == 2 and "is a file" in found.output + found.stderr
    assert mission.read_bytes() == before and list(tmp_path.iterdir()) == [mission]


def test_a_full_disk_leaves_no_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "no space left on device")

    monkeypatch.setattr(plan_file.tomli_w, "dumps", fail)
    with pytest.raises(OSError, match="no space"):
        write_plan_file(tmp_path / "p", build_plan())
    assert not list(tmp_path.iterdir())


def test_random_structures_are_part_of_the_head(tmp_path: Path) -> None:
    write_plan_file(tmp_path / "own", build_plan())
    assert "scenario" not in (tmp_path / "own.toml").read_text()
    assert load_plan_file(tmp_path / "own").scenario_seed is None
    write_plan_file(tmp_path / "drawn", build_plan(scenario_seed=7, difficulty=0.75))
    drawn = load_plan_file(tmp_path / "drawn")
    assert (drawn.scenario_seed, drawn.difficulty) == (7, 0.75)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("scenario_seed", "seven", "plan.scenario_seed is 'seven'; a whole number is needed"),
        ("scenario_seed", -1, "plan.scenario_seed is -1; valid: 0 to 18446744073709551615"),
        ("difficulty", 7.0, "plan.difficulty is 7.0; valid: 0 to 1"),
        ("difficulty", math.nan, "plan.difficulty is nan; valid: 0 to 1"),
        ("metrics", {"big": 10**400}, "plan.metrics.big is an integer above 1e308"),
        ("speed", 1.0, "unknown key plan.speed; valid: .*scenario_seed, difficulty"),
    ],
)
def test_wrong_heads_are_refused(tmp_path: Path, key: str, value: Any, message: str) -> None:
    _, head = write_plan_file(tmp_path / "p", build_plan())
    tree = plan_file.parse_toml(head.read_text(), "p")
    tree["plan"][key] = value
    head.write_text(tomli_w.dumps(tree))
    with pytest.raises(InputError, match=message):
        load_plan_file(head)


def test_accelerations_agree_with_the_steps_of_the_velocity(tmp_path: Path) -> None:
    plan = build_plan()
    plan.acceleration[:, 0] = 60.0
    write_plan_file(tmp_path / "p", plan)
    with pytest.raises(InputError, match=r"line 3, vx_mps changes by .*accelerations give 1.2"):
        load_plan_file(tmp_path / "p")
    # a tool that plans slow motions in few rows, without accelerations
    t = np.array([0.0, 3.0, 6.0, 9.0])
    pose, rate, none = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((4, 0))
    pose[:, 0], pose[:, 2], rate[:, 0] = (0.0, 1.35, 4.05, 5.4), 2.0, (0.0, 0.9, 0.9, 0.0)
    coarse = PlanFile("hexarotor", "open", 1, (), t, pose, rate, np.zeros((4, 4)), none, none, {})
    write_plan_file(tmp_path / "coarse", coarse)
    assert len(load_plan_file(tmp_path / "coarse").t) == 4
