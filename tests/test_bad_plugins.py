"""What is wrong with a user's part is told in one line, by the command line, before a flight.

Further cases: names that exist twice and packages (test_packages.py), files that end Python
(test_user_files.py), a step that never returns (test_parts.py).
"""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from skywright import cli
from skywright.run.directory import load_run

LAW = """
from skywright.core.record import Record
from skywright.core.spec import Positive, Spec
from skywright.vehicle.bus import Estimate, Reference, Truth, WrenchCommand
from skywright.vehicle.component import Law, Out, Output


class Nobody(Output):
    x: float


class Mine(Law):
    class Table(Spec):
        gain: Positive = 1.0

{step}
"""

SENSOR = """
from skywright.vehicle.bus import Clock
from skywright.vehicle.component import Out, Output, Sensor


class Mine(Sensor):
    class Reading(Output):
        x: float

    @staticmethod
    def step(clock: Clock, out: Out[Reading]) -> None:
        out.x = clock.t
"""


def write_step(ports: str, *lines: str) -> str:
    body = "".join(f"        {line}\n" for line in lines)
    step = f"    @staticmethod\n    def step({ports}cmd: Out[WrenchCommand]) -> None:\n{body}"
    return LAW.format(step=step)


GOOD = write_step("est: Estimate, ", "cmd.f_B[2] = est.t")
UNKNOWN_NAME = write_step("est: Estimate, ", "cmd.f_B[2] = nowhere(est.t)")
LATE = write_step("est: Estimate, ", "if est.t > 0.1:", "    raise ValueError('too late')",
                  "cmd.f_B[2] = 1.0")  # fmt: skip

CASES = {
    "no step": (LAW.format(step="    pass"), [], ["Mine", "has no static method 'step'"]),
    "a port nobody fills": (
        write_step("x: Nobody, ", "cmd.f_B[2] = x.x"), [],
        ["law", "asks for Nobody, which nothing in this vehicle fills"],
    ),
    "the truth": (
        write_step("truth: Truth, ", "cmd.f_B[2] = truth.p_WB[2]"), [],
        ["law", "cannot see Truth"],
    ),
    "no annotation": (
        write_step("x, ", "cmd.f_B[2] = 1.0"), [], ["parameter 'x' has no annotation"],
    ),
    "an unknown key": (GOOD, ["mission.law.gian=2"], ["mission.law.gian", "gain"]),
    "a value out of range": (GOOD, ["mission.law.gain=-2"], ["mission.law.gain", "-2"]),
    "an exception": ("x = 1\n1 / 0\n", [], ["ZeroDivisionError", "line 2 of mine.py"]),
    "a syntax error": ("x = 1 +\n", [], ["SyntaxError", "line 1 of mine.py"]),
    "a SystemExit": ("raise SystemExit(7)\n", [], ["SystemExit: 7", "line 1 of mine.py"]),
    "no class": ("x = 1\n", [], ["has no class 'Mine'"]),
    "another group": (SENSOR, [], ["a control law is needed", "Mine", "is a sensor"]),
    "no compiled code": (UNKNOWN_NAME, [], ["does not compile", "nowhere", "mine.py:"]),
}  # fmt: skip


def run(tmp_path: Path, *sets: str, kind: str = "mission.law") -> tuple[int, str]:
    """Run a mission with the part in mine.py; return exit code and what was told."""
    args = ["run", "waypoints", "--robot", "othex", "--out", str(tmp_path / "out")]
    for one in (f"{kind}={tmp_path / 'mine.py'}:Mine", *sets):
        args += ["--set", one]
    result = CliRunner().invoke(cli.main, args)
    assert "Traceback" not in result.output
    return result.exit_code, " ".join(result.stderr.split())


@pytest.mark.parametrize("name", CASES)
def test_a_law_that_is_wrong_is_refused(tmp_path: Path, name: str) -> None:
    text, sets, words = CASES[name]
    (tmp_path / "mine.py").write_text(text)
    code, told = run(tmp_path, *sets)
    assert code == 2, told
    assert told.count("skywright:") == 1 and all(word in told for word in words), told
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith("out")] == []


def test_two_components_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(SENSOR)
    code, told = run(tmp_path, kind="robot.sensors.truth.kind")
    assert code == 2 and "two components are called 'truth'" in told, told
    assert not (tmp_path / "out.partial").exists()


def test_a_file_with_one_sensor_twice_is_refused(tmp_path: Path) -> None:
    table = "[robot.sensors.a]\nkind = 'airspeed'\n"
    mission = tmp_path / "mission.toml"
    mission.write_text(
        "[mission]\nname = 'm'\nkind = 'waypoints'\nrobot = 'othex'\nworld = 'open'\n" + 2 * table
    )
    result = CliRunner().invoke(cli.main, ["run", str(mission)])
    assert result.exit_code == 2 and "mission.toml" in result.stderr and "line 8" in result.stderr
    assert "Traceback" not in result.output


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["fast", "interactive"])
def test_a_step_that_raises_ends_the_run_and_leaves_its_recording(
    tmp_path: Path, mode: str
) -> None:
    (tmp_path / "mine.py").write_text(LATE)
    code, told = run(tmp_path, f"mission.mode={mode}")
    assert code == 3, told
    stored = load_run(tmp_path / "out.partial")
    assert stored.outcome == "diverged"
    assert all(w in stored.reason for w in ("law", "too late", "mine.py")), stored.reason
    assert not (tmp_path / "out").exists() and len(stored.samples)
