"""The command line's contract: names, exit codes, `--json`, one line for every error."""

from __future__ import annotations

import inspect
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from rich.console import Console

from skywright import cli
from skywright.core.find import GROUPS, list_offers, load_built_in
from skywright.reports.terminal import new_table


def call(*args: str) -> Result:
    return CliRunner().invoke(cli.main, list(args))


def assert_refused(result: Result, *words: str, code: int = 2) -> None:
    """The exit code, nothing on stdout, one clear line on stderr."""
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("skywright: ")
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr


@pytest.fixture(autouse=True)
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_importing_the_command_line_is_cheap() -> None:
    heavy = [
        "numpy",
        "numba",
        "mujoco",
        "scipy",
        "pydantic",
        "matplotlib",
        "rich",
        "starlette",
        "uvicorn",
    ]
    code = f"import sys, skywright, skywright.cli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_module_and_script_are_the_same() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "skywright", "--help"], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[1:] == call("--help").stdout.splitlines()[1:]


def test_no_line_of_the_help_is_cut_off_at_80_columns() -> None:
    cut = [line for line in call("--help").stdout.splitlines()[1:] if line.endswith("...")]
    assert not cut


def test_a_table_breaks_no_name_in_two_at_80_columns() -> None:
    table = new_table("Requirements", "requirement", "value", "limit", "measured in")
    table.add_row("heading.hold_error_deg", "0.0354 deg", "<= 3 deg", "whole run, but not " * 5)
    out = io.StringIO()
    Console(width=80, file=out).print(table)
    assert "heading.hold_error_deg" in out.getvalue()


def test_help_names_the_contract() -> None:
    text = call("--help").stdout
    for name in ("run", "plan", "capability", "list", "show", "weld", "replay", "new", "check"):
        assert f"\n  {name} " in text
    for flag in ("--robot", "--world", "--set", "--seed", "--out", "--json", "--view"):
        assert flag in call("run", "--help").stdout
    assert call().exit_code == 0
    assert call("--version").stdout.startswith("skywright ")


def test_public_names_exist() -> None:
    import skywright

    for name in skywright.__all__:
        assert getattr(skywright, name)
    assert skywright.load("waypoints", sets={"mission.seed": 4}).mission.seed == 4


# Wrong input: exit code 2, one line


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["fly"], ["unknown command 'fly'", "run", "show"]),
        (["run"], ["MISSION"]),
        (["run", "waypoints", "--frobnicate"], ["--frobnicate"]),
        (["run", "waypoints", "--seed", "x"], ["--seed"]),
        (["run", "waypoints", "--seed", "-1"], ["--seed"]),
        (["run", "no-such"], ["unknown mission 'no-such'", "pipe-weld-scan"]),
        (["run", "waypoints", "--robot", "othx"], ["unknown robot 'othx'", "othex"]),
        (["run", "waypoints", "--world", "mars"], ["unknown world 'mars'", "open"]),
        (["run", "waypoints", "--set", "x"], ["KEY=VALUE"]),
        (["run", "waypoints", "--set", "world.wind.speed_mps=3"], ["speed_mps", "mean_mps"]),
        (["plan", "waypoints", "--set", "world.mocap.rate_hz=0"], ["world.mocap.rate_hz"]),
        (["plan", "waypoints", "--set", "robot.platform.mass_kg=50"], ["50"]),
        (["run", "waypoints", "--set", "robot.rotors.thrust_max_n=2"], ["N"]),
        (["capability", "othx"], ["othx", "othex"]),
        (["capability", "othex", "--set", "robot.platform.mass_kg=9"], ["9"]),
        (["capability", "othex", "--out", "x.docx"], ["x.docx", ".png"]),
        (["capability", "othex", "--out", "/proc/nope/x.png"], ["/proc/nope/x.png"]),
        (["list", "planets"], ["planets", "robots"]),
        (["show", "othx"], ["othx", "othex"]),
        (["weld", "no-such.csv"], ["no-such.csv"]),
        (["replay", "no-such-run"], ["no-such-run"]),
        (["replay", "."], ["replay.html"]),
        (["new", "robot", "a b"], ["'a b'"]),
        (["check", "no-such.toml"], ["no-such.toml"]),
    ],
)  # fmt: skip
def test_wrong_input(args: list[str], words: list[str]) -> None:
    assert_refused(call(*args), *words)


def test_wrong_input_as_json() -> None:
    result = call("plan", "no-such", "--json")
    assert result.exit_code == 2
    found = json.loads(result.stdout)
    assert found["exit_code"] == 2
    assert "no-such" in found["error"]


def test_internal_error_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import skywright.description.robot.loader as loader

    def explode() -> None:
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr(loader, "list_robots", explode)
    monkeypatch.delenv("SKYWRIGHT_DEBUG", raising=False)
    assert_refused(call("list", "robots"), "internal error", "ZeroDivisionError", code=3)
    monkeypatch.setenv("SKYWRIGHT_DEBUG", "1")
    assert "Traceback" in call("list", "robots").stderr


def test_interrupt_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import skywright.description.robot.loader as loader

    def interrupt() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(loader, "list_robots", interrupt)
    result = call("list", "robots")
    assert result.exit_code == 1
    assert result.stderr.strip() == "skywright: interrupted"


def test_closed_pipe_is_silent() -> None:
    command = f"{sys.executable} -m skywright show othex --json | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert done.stderr == ""


# Commands


def test_list() -> None:
    found = json.loads(call("list", "--json").stdout)
    assert {"othex", "f550-bridge", "hexarotor"} <= {e["name"] for e in found["robots"]}
    assert {"pipe", "open"} <= {e["name"] for e in found["worlds"]}
    assert {"pipe-weld-scan", "waypoints"} <= {e["name"] for e in found["missions"]}
    assert "othex" in call("list", "robots").stdout


def test_capability_json_has_the_keys_of_the_contract(tmp_path: Path) -> None:
    result = call("capability", "othex", "--json")
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    keys = "robot mass_kg thrust_fraction directions_deg lateral_force_n wind_limit_mps"
    for key in [*keys.split(), "hover_tilt_deg", "hover_power_w", "endurance_s", "rotors"]:
        assert key in found
    assert len(found["directions_deg"]) == len(found["lateral_force_n"])
    assert {
        "position_m", "axis", "thrust_min_n", "thrust_max_n", "torque_per_thrust_m"
    } <= set(found["rotors"][0])  # fmt: skip
    assert list(tmp_path.iterdir()) == []  # no picture unless asked
    heavy = json.loads(
        call("capability", "othex", "--json", "--set", "robot.platform.mass_kg=1.8").stdout
    )
    assert heavy["mass_kg"] == pytest.approx(found["mass_kg"] + 0.2)


def test_capability_writes_a_picture(tmp_path: Path) -> None:
    result = call("capability", "hexarotor", "--out", "sub/k.png")
    assert result.exit_code == 0
    assert (tmp_path / "sub/k.png").read_bytes().startswith(b"\x89PNG")
    assert "hover power" in result.stdout and "sub/k.png" in result.stdout


@pytest.mark.parametrize(
    ("word", "name", "says"),
    [
        ("laws", "push_and_slide", "dislocated PID"),
        ("arms-laws", "compliant", "arms"),
        ("rules", "battery_low", "battery"),
        ("effects", "drag", "Drag of body and rotors"),
        ("sensors", "airspeed", "Pitot"),
        ("kinds", "waypoints", "Fly through waypoints."),
    ],
)
def test_a_list_of_parts_describes_each(word: str, name: str, says: str) -> None:
    entries = json.loads(call("list", word, "--json").stdout)[word]
    found = {entry["name"]: entry["description"] for entry in entries}
    assert says in found[name]
    assert all(len(text) > 10 and text != "built in" for text in found.values()), found


def test_every_part_that_is_listed_has_a_class() -> None:
    """A file that only helps others has a name with an underscore."""
    for group in GROUPS:
        for name, offers in list_offers(group).items():
            if any(offer.point is None for offer in offers):
                assert inspect.isclass(load_built_in(group, name))


@pytest.mark.parametrize("name", ["othex", "pipe", "pipe-weld-scan", "waypoints"])
def test_show(name: str, tmp_path: Path) -> None:
    result = call("show", name)
    assert result.exit_code == 0, result.output
    assert not list(tmp_path.iterdir())  # a picture is drawn when it is asked for
    if name == "othex":
        for word in (
            "2.25 kg",
            "hinge about y",
            "hover power",
            "endurance",
            "gyroscope",
            "Assumed values (",
        ):
            assert word in result.stdout


def test_show_json_and_svg(tmp_path: Path) -> None:
    found = json.loads(call("show", "waypoints", "--json", "--out", "w.svg").stdout)
    assert (found["kind"], found["name"], found["picture"]) == ("mission", "waypoints", "w.svg")
    assert "<svg" in (tmp_path / "w.svg").read_text()


def test_plan_json_has_the_keys_of_the_contract() -> None:
    result = call("plan", "waypoints", "--robot", "f550-bridge", "--json")
    assert result.exit_code == 0
    found = json.loads(result.stdout)
    keys = "feasible blocked_by plan_s duration_s flight_s min_clearance_m min_rotor_margin metrics"
    assert set(keys.split()) <= set(found)
    assert (found["feasible"], found["blocked_by"]) == (True, None)
    assert "whole flight" in call("plan", "waypoints").stdout


def test_plan_that_does_not_exist_is_exit_code_1() -> None:
    """A pipe too thin for the raster: the reason is told."""
    thin = ("plan", "pipe-weld-scan", "--set", "world.pipe.diameter_m=0.01")
    result = call(*thin, "--json")
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert found["feasible"] is False and "apart" in found["blocked_by"]
    result = call(*thin)
    assert result.exit_code == 1 and "apart" in result.stdout


def test_scan_needs_probe_and_pipe() -> None:
    assert_refused(call("plan", "pipe-weld-scan", "--robot", "hexarotor"), "hexarotor", "probe")
    assert_refused(call("plan", "pipe-weld-scan", "--world", "open"), "open", "pipe")


def test_weld(tmp_path: Path) -> None:
    data = str(Path(__file__).parents[1] / "examples/weld_data/pipe_scan.csv")
    result = call("weld", data)
    assert result.exit_code == 0, result.output
    assert "angle from the circumference" in result.stdout
    assert (tmp_path / "pipe_scan-weld.png").stat().st_size > 10_000
    found = json.loads(call("weld", data, "--json").stdout)
    assert set(["contact_fraction", "crossings", "line", "surface", "thresholds"]) <= set(found)
    assert_refused(call("weld", data, "--calibrate", "5:x"), "5:x", "T0:T1")
    assert_refused(call("weld", data, "--lift-off", "nan"), "nan")
    assert_refused(call("weld", data, "--surface", "nope.toml"), "nope.toml")


def test_new_robot_is_valid_and_not_overwritten(tmp_path: Path) -> None:
    assert call("new", "robot", "mine").exit_code == 0
    for target in ("mine", "mine/robot.toml", "mine/mission.toml"):
        result = call("check", target)
        assert result.exit_code == 0, result.output
    assert call("show", "mine").exit_code == 0
    (tmp_path / "mine/robot.toml").write_text("changed")
    assert_refused(call("new", "robot", "mine"), "mine/mission.toml", "not overwritten")
    assert (tmp_path / "mine/robot.toml").read_text() == "changed"


def test_new_robot_flies_and_its_run_can_be_repeated(tmp_path: Path) -> None:
    """The template meets its mission's requirements; the run's directory repeats the run."""
    call("new", "robot", "mine")
    result = call("run", "mine", "--out", "first", "--json")
    assert result.exit_code == 0, result.output
    first = json.loads(result.stdout)  # one object, nothing else
    assert (first["robot"], first["outcome"], first["directory"]) == ("mine", "succeeded", "first")
    assert all(r["passed"] for r in first["requirements"])
    for name in ("mission.toml", "metrics.json", "recording.mcap", "report.html", "replay.html"):
        assert (tmp_path / "first" / name).is_file()
    again = json.loads(call("run", "first", "--out", "second", "--json").stdout)
    same = {k: v for k, v in first["metrics"].items() if not k.startswith("plan.")}
    assert {k: v for k, v in again["metrics"].items() if not k.startswith("plan.")} == same
    assert call("replay", "first", "--no-open").stdout.strip() == "first/replay.html"
    assert_refused(call("run", "mine", "--out", "first"), "first already exists")


def test_template_comments_the_arm_that_works(tmp_path: Path) -> None:
    """Taking the # away from the arm in the template gives a valid robot."""
    call("new", "robot", "mine")
    path = tmp_path / "mine/robot.toml"
    head, mark, arm = path.read_text().partition("# [robot.arm]")
    path.write_text(head + "\n".join(line[2:] for line in (mark + arm).splitlines()))
    result = call("check", "mine")
    assert result.exit_code == 0, result.output
    assert "link1" in call("show", "mine").stdout


def test_check_lists_every_problem_at_once(tmp_path: Path) -> None:
    call("new", "robot", "mine")
    path = tmp_path / "mine/robot.toml"
    text = path.read_text().replace("mass_kg = 1.5 ", "mass_g = 1500 ")
    text = text.replace("energy_wh = 55.0", "energy_wh = nan").replace('"ccw"]', '"left"]')
    path.write_text(text + "\n[engine]\npower = 3\n")
    result = call("check", str(path))
    assert result.exit_code == 2
    for word in ("mass_kg (in kilograms)", "energy_wh is nan", "'left'", "[engine]"):
        assert word in result.stderr
    assert "Traceback" not in result.output
    found = json.loads(call("check", str(path), "--json").stdout)
    assert found["valid"] is False and len(found["problems"]) >= 4


def test_check_refuses_a_robot_that_cannot_lift_itself(tmp_path: Path) -> None:
    call("new", "robot", "mine")
    path = tmp_path / "mine/robot.toml"
    path.write_text(path.read_text().replace("mass_kg = 1.5 ", "mass_kg = 15.0 "))
    result = call("check", "mine")
    assert result.exit_code == 2
    assert "N" in result.stderr  # with the numbers
    assert call("run", "mine/mission.toml").exit_code == 2


def test_check_reads_what_a_robot_extends(tmp_path: Path) -> None:
    """A file of differences is valid with its base, and its own mistakes are told as its own."""
    done = call("check", "bimanual-longreach")
    assert done.exit_code == 0 and "a valid robot" in done.stdout
    text = "[robot]\nname = 'mine'\nextends = 'bimanual'\n[robot.platform]\nmass_kg = -1.0\n"
    (tmp_path / "robot.toml").write_text(text)
    done = call("check", "robot.toml")
    assert done.exit_code == 2
    assert "robot.toml: robot.platform.mass_kg" in done.stderr
    assert done.stderr.splitlines()[-1] == "robot.toml: 1 problem"


def test_check_compiles_a_law_of_a_user(tmp_path: Path) -> None:
    call("new", "law", "mine")
    path = tmp_path / "mine/mine.py"
    assert "body.mass" in path.read_text()
    path.write_text(path.read_text().replace("body.mass", "body.mas", 1))
    done = call("check", "mine")
    assert done.exit_code == 2
    assert "mine.py" in done.stderr and "does not compile" in done.stderr


def test_check_tells_of_things_that_overlap(tmp_path: Path) -> None:
    """A tool inside its bench is thrown out at the first step; one on top of it is well."""
    box = "size_x_m = 0.4\nsize_y_m = 0.6\nsize_z_m = 0.9\nx_m = 2.0\ny_m = 0.0\nz_m = 0.45\n"
    text = f"[world]\nname = 'w'\n[world.things.stand]\nkind = 'box'\n{box}"
    text += "[world.things.tool]\nkind = 'tool'\n"
    for place, code in (("on = 'stand'", 0), ("x_m = 2.0\ny_m = 0.0\nz_m = 0.8", 2)):
        (tmp_path / "world.toml").write_text(text + place + "\n")
        done = call("check", "world.toml")
        assert done.exit_code == code, done.output
    assert "'stand' and 'tool' overlap by" in done.stderr


def test_check_states_the_verdict_and_then_the_assumed_values() -> None:
    """No number of a built-in robot lacks a source; keys that do not apply to it need none."""
    result = call("check", "othex")
    assert result.exit_code == 0
    assert result.stdout.startswith("othex: a valid robot\n")
    assert "assumed robot.probe.spring_n_per_m = 200 (range 100 to 500)" in result.stdout
    assert "no source" not in result.stdout + call("show", "othex").stdout


def test_check_counts_the_assumed_values_of_files_that_it_does_not_check(tmp_path: Path) -> None:
    call("new", "mission", "mine")
    path = tmp_path / "mine/mission.toml"
    drift = '{ value = 0.02, source = "assumed", range = [0.0, 0.05] }'
    path.write_text(path.read_text() + f"map_error_m = {drift}\n")
    lines = call("check", "mine").stdout.splitlines()
    assert lines[0] == "mine: a valid mission"
    assert [x for x in lines if x.startswith("assumed")] == [
        "assumed plant.map_error_m = 0.02 (range 0 to 0.05)"
    ]
    assert re.fullmatch(r"\d\d assumed values of other files \(.*\)", lines[-1])


def test_check_of_a_folder_states_a_problem_of_its_robot_once(tmp_path: Path) -> None:
    call("new", "robot", "mine")
    path = tmp_path / "mine/robot.toml"
    path.write_text(path.read_text().replace("mass_kg = 1.5 ", "mass_kg = 9.0 "))
    lines = call("check", "mine").stderr.splitlines()
    assert len(lines) == 2 and lines[1] == "mine: 1 problem"
    assert lines[0].startswith("mine/robot.toml: robot 'mine' cannot lift its weight")


def test_user_files_work_where_names_do(tmp_path: Path) -> None:
    (tmp_path / "yard.toml").write_text('[world]\nname = "yard"\n')
    call("new", "robot", "mine")
    assert call("show", "yard.toml").exit_code == 0
    found = json.loads(call("capability", "mine", "--json").stdout)
    assert found["robot"] == "mine"
    assert call("capability", "mine/robot.toml", "--json").exit_code == 0


def test_show_writes_nothing_if_an_output_is_refused(tmp_path: Path) -> None:
    done = call("show", "othex", "--urdf", "a.urdf", "--out", "b.gif")
    assert done.exit_code == 2 and not (tmp_path / "a.urdf").exists()
    (tmp_path / "full.urdf").symlink_to("/dev/full")
    done = call("show", "othex", "--urdf", "full.urdf")
    assert done.exit_code == 2 and "No space left on device" in done.stderr
