"""Which commands execute a user's file, and that a run from elsewhere needs --trust."""

import os
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from command_server import CommandServer
from skywright.cli import main
from skywright.core import trust

LAW = """
from pathlib import Path
from skywright.vehicle.laws.push_and_slide import PushAndSlide

{mark}

class Mine(PushAndSlide):
    pass
"""


@pytest.fixture
def mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mission whose law leaves a mark when it is imported; nothing is trusted yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(trust, "_here", set())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SKYWRIGHT_TRUST", "0")  # restored, whatever --trust made of it
    folder = tmp_path / "run"
    folder.mkdir()
    mark = f"(Path({str(tmp_path)!r}) / 'mark').touch()"
    (folder / "law.py").write_text(LAW.format(mark=mark))
    file = folder / "mission.toml"
    file.write_text(
        '[mission]\nname = "w"\nkind = "waypoints"\nrobot = "othex"\nworld = "open"\n'
        '[mission.law]\nkind = "law.py:Mine"\n'
        "[[mission.task.points]]\nx_m = 0.5\ny_m = 0.0\nz_m = 1.5\n"
    )
    return file


def call(*args: str) -> tuple[int, str]:
    done = CliRunner().invoke(main, list(args))
    return done.exit_code, done.output + (done.stderr or "")


@pytest.mark.parametrize("command", [["check"], ["show"], ["plan"]])
def test_what_the_user_names_is_executed(command: list[str], mission: Path) -> None:
    """SECURITY.md says so: the class declares its keys."""
    call(*command, str(mission))
    assert (mission.parents[1] / "mark").exists()


@pytest.mark.parametrize("command", ["check", "show", "plan", "run", "replay", "campaign"])
@pytest.mark.parametrize("sign", ["metrics.json", "recording.mcap", "resolved"])
def test_a_run_from_elsewhere(command: str, sign: str, mission: Path) -> None:
    mark, target = mission.parents[1] / "mark", mission.parent
    if sign == "resolved":
        mission.write_text(
            mission.read_text().replace("[mission]", "[mission]\nresolved = true", 1)
        )
    else:
        (target / sign).write_text("{}")
    _, said = call(command, str(target))
    assert not mark.exists(), said
    if command in ("plan", "run") or (command == "check" and sign != "resolved"):
        assert (
            "contains code that has not been executed on this computer" in said
            and "--trust" in said
        )


def test_trust_is_kept_for_the_content(mission: Path, commands: CommandServer) -> None:
    mark, target = mission.parents[1] / "mark", mission.parent
    (target / "metrics.json").write_text("{}")
    code, said = call("check", str(target), "--trust")
    assert code == 0 and mark.exists(), said
    elsewhere = mission.parents[1] / "copy"
    shutil.copytree(target, elsewhere)
    assert call_fresh(commands, "check", str(elsewhere)) == 0  # the same content, another folder
    with (elsewhere / "law.py").open("a") as file:
        file.write("# changed\n")
    assert call_fresh(commands, "check", str(elsewhere)) != 0


def call_fresh(commands: CommandServer, *args: str) -> int:
    """Call in another process, as memory and environment of this one trust already."""
    environment = {**os.environ, "SKYWRIGHT_TRUST": "0"}
    return commands.run(list(args), Path.cwd(), **environment).returncode
