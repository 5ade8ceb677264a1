"""The parts of the Python API: scripts of the docs, what importing costs, results by name."""

from __future__ import annotations

import ast
import inspect
import math
import re
import runpy
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import skywright
from skywright.analysis.campaign.campaign import CampaignResult
from skywright.analysis.identify.fit import Fit
from skywright.analysis.identify.identify import Identification
from skywright.analysis.identify.identify import identify as identify_logs
from skywright.analysis.locate.locate import LocateReport
from skywright.analysis.locate.locate import locate as locate_files
from skywright.cli import main
from skywright.core.compiled_code import _list_imports, find_dependents
from skywright.errors import InputError
from skywright.inspection.weld import WeldResult
from skywright.inspection.weld_data import WeldReport, process_file
from skywright.inspection.weld_line import WeldLine
from skywright.models.capability import Capability
from skywright.models.localisation.trajectory import Trajectory
from skywright.run.planning import MissionPlan
from skywright.run.result import RunResult
from skywright.run.results import read_name
from skywright.vehicle.bus import Body

ROOT = Path(__file__).resolve().parent.parent
SCRIPTS = sorted((ROOT / "examples" / "parts").glob("*.py"))
PAGE = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")


# What importing costs


def test_importing_the_package_touches_no_files_and_loads_nothing_heavy():
    code = """
import sys
seen = []
FILES = ("open", "os.scandir", "os.mkdir", "os.remove", "os.rename", "os.utime")
def hook(event, args):
    if event in FILES and not str(args[0]).endswith((".py", ".pyc", ".so")):
        seen.append((event, str(args[0])))
sys.addaudithook(hook)
import skywright
assert not seen, seen
heavy = {"numpy", "numba", "scipy", "mujoco", "pydantic", "importlib.metadata"} & set(sys.modules)
assert not heavy, heavy
ours = sorted(name for name in sys.modules if name.startswith("skywright."))
assert ours == ["skywright.errors"], ours
assert skywright.__version__ and seen  # its metadata are read when asked for
"""
    done = subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_stale_code_is_dropped_wherever_compiled_code_is_loaded():
    """Every module that compiles with a cache imports the one that drops it, directly or not."""
    root = ROOT / "src" / "skywright"
    texts = {}
    for path in root.rglob("*.py"):
        name = ".".join(path.relative_to(root.parent).with_suffix("").parts)
        texts[name.removesuffix(".__init__")] = path.read_text(encoding="utf-8")
    imports = {}
    for name, text in texts.items():
        at_the_top = "\n".join(line for line in text.splitlines() if not line.startswith(" "))
        imports[name] = set(_list_imports(at_the_top, set(texts)))
    safe = find_dependents(["skywright.core.user_code"], imports)
    assert "skywright" not in safe
    unsafe = {n for n, text in texts.items() if re.search(r'cache=True|"cache": True', text)} - safe
    assert not unsafe


# The scripts


@pytest.mark.docs
def test_scripts_run(tmp_path, monkeypatch, capsys):
    """In a folder that they share, as a reader of the page has it."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    for script in SCRIPTS:
        runpy.run_path(str(script), run_name="__main__")
        assert capsys.readouterr().out, script


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_is_what_the_page_shows(script):
    text = script.read_text(encoding="utf-8")
    body = text.partition('"""\n\n')[2]
    assert f"```python\n{body}```" in PAGE
    assert len([line for line in body.splitlines() if line]) <= 10  # imports included


def test_the_page_names_all_that_is_public():
    assert {name for name in skywright.__all__ if f"`{name}" not in PAGE} == set()
    assert set(skywright.__all__) <= set(dir(skywright))


def test_every_public_name_is_typed_and_imported_at_first_use():
    """mypy finds the names below TYPE_CHECKING; `__getattr__` finds them in _PARTS."""
    tree = ast.parse(Path(skywright.__file__).read_text("utf-8"))
    block = next(n for n in tree.body if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n))
    typed = {a.name for n in block.body if isinstance(n, ast.ImportFrom) for a in n.names}
    parts = {name for names in skywright._PARTS.values() for name in names}
    assert parts <= typed and parts <= set(skywright.__all__)
    results = {"Capability", "Description", "MissionPlan", "RunResult"}
    results |= {"CampaignResult", "Identification", "LocateReport", "WeldReport"}
    assert results <= parts
    for name in results:
        assert inspect.isclass(getattr(skywright, name)), name


def test_run_is_documented_and_typed_after_its_package_is_imported():
    code = """
import inspect, pydoc, typing, skywright
before = inspect.signature(skywright.run), inspect.getdoc(skywright.run)
import skywright.run.results
assert inspect.ismodule(skywright.run)
assert (inspect.signature(skywright.run), inspect.getdoc(skywright.run)) == before
assert "`backend` is" in pydoc.render_doc(skywright.run, renderer=pydoc.plaintext)
hints = typing.get_type_hints(skywright.run)
assert set(hints) == {*inspect.signature(skywright.run).parameters, "return"}
assert hints["return"] is skywright.RunResult and hints["view"] is bool
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_page_lists_the_keywords_of_the_commands():
    listed: dict[str, list[str]] = {"weld": [], "locate": [], "identify": []}
    table = PAGE.partition("| function | keyword |")[2].partition("\n\n")[0].splitlines()[2:]
    for row in table:
        function, keywords = row.split("|")[1:3]
        listed[function.strip(" `")] += re.findall(r"`(\w+)`", keywords)
    functions = {"weld": process_file, "locate": locate_files, "identify": identify_logs}
    for name, function in functions.items():
        first, *keywords = inspect.signature(getattr(skywright, name)).parameters
        assert first in ("data", "logs") and sorted(listed[name]) == sorted(keywords)
        inner = inspect.signature(function).parameters
        assert set(keywords) <= {"mass", *inner}
        for key in keywords:  # the same defaults
            mine = inspect.signature(getattr(skywright, name)).parameters[key].default
            assert key not in inner or inner[key].default in (mine, inspect.Parameter.empty)


def test_the_page_lists_attributes_that_results_have():
    heads = {f" `{c.__name__}` |": c for c in (
        MissionPlan, RunResult, Capability, CampaignResult, WeldReport, WeldLine, LocateReport,
        Identification,
    )}  # fmt: skip
    for head, cls in heads.items():
        table = PAGE.partition(head)[2]
        rows = table.partition("\n\n")[0].splitlines()[2:]
        names = [n for row in rows for n in re.findall(r"`([\w.]+)(?:\(\))?`", row.split("|")[1])]
        assert names
        for name in names:
            owner, _, inner = name.partition(".")
            assert hasattr(cls, owner), f"{cls.__name__}.{name}"
            part = {"result": WeldResult, "trajectory": Trajectory, "fit": Fit}.get(owner)
            assert not inner or hasattr(part, inner), f"{cls.__name__}.{name}"


# Results by name


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory):
    sets = {"mission.task.points": [{"x_m": 0.3, "y_m": 0.0, "z_m": 1.2, "hold_s": 0.5}]}
    out = tmp_path_factory.mktemp("results") / "run"
    return skywright.run(skywright.load("waypoints", sets=sets), out=out, report=False)


@pytest.fixture(scope="module")
def directory(result) -> Path:
    return result.directory


def test_the_estimate_of_a_run_is_judged_from_its_start_on(directory):
    bag = directory / "recording.mcap"
    found = skywright.locate(
        f"{bag}:/estimate/pose", reference=f"{bag}:/truth/pose", compare="none"
    )
    assert found.to_json()["errors"]["trajectory"]["absolute_m"]["max"] < 0.01


def test_a_run_is_read_back_by_name(result):
    run, samples = skywright.open_run(result.directory), result.samples
    assert run.outcome == result.outcome and run.phases == result.phases
    assert run.metrics == result.metrics
    for name in run.names:
        assert len(run[name]) and name in run
    assert list(run) == run.names and "tip.q" not in run and 0 not in run
    np.testing.assert_array_equal(run["platform.p_W"], samples["p_WB"])
    np.testing.assert_array_equal(run["p_WB"], samples["p_WB"])
    assert run["/sensors/inertial"]["gyro"].shape[1] == 3
    assert [r["passed"] for r in run.requirements] == [r.passed for r in result.requirements]
    assert [e.text for e in run.events]
    for shown in (result, run):  # without the samples
        assert repr(shown).endswith(f"{result.directory}: {result.outcome}>")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("platform.p_w", ["no 'platform.p_w'", "platform.p_W"]),
        ("gapp", ["no 'gapp'", "gap"]),
        (0, ["no 0", "valid: "]),
        ("/sensors/imu", ["no stream '/sensors/imu'", "/sensors/inertial"]),
    ],
)
def test_a_wrong_name_suggests_near_ones(directory, name, words):
    with pytest.raises(InputError) as caught:
        skywright.open_run(directory)[name]
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize(
    ("column", "name"),
    [
        ("p_WT", "tip.p_W"),
        ("w_WB_B", "platform.w_B"),
        ("est_p_WT", "estimate.tip.p_W"),
        ("ref_q_WB", "reference.platform.q_W"),
        ("meas_p_WT", "measured.tip.p_W"),
        ("left_p_WH", "left.hand.p_W"),
        ("object0_q_WO", "object0.q_W"),
        ("f_normal", "f_normal"),
        ("left_est_p_WH", "left_est_p_WH"),
    ],
)
def test_names_say_whose_and_what(column, name):
    assert read_name(column) == name


def test_names_of_columns_are_unique(directory):
    run = skywright.open_run(directory)
    assert len({read_name(c.name) for c in run.columns}) == len(run.columns)


def test_a_data_frame_has_a_column_a_number(directory):
    run = skywright.open_run(directory)
    if find_spec("pandas") is None:
        with pytest.raises(InputError, match=r"skywright\[pandas\]"):
            run.to_dataframe()
        return
    frame = run.to_dataframe()
    assert frame.index.name == "t" and len(frame) == len(run["t"])
    np.testing.assert_array_equal(frame["p_WB_z"], run["p_WB"][:, 2])
    np.testing.assert_array_equal(frame["q_WB_w"], run["q_WB"][:, 0])
    np.testing.assert_array_equal(frame["rotor_thrust_1"], run["rotor_thrust"][:, 1])


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"is not a run directory, mission\.toml is missing"):
        skywright.open_run(tmp_path)


# A law alone


def test_a_law_alone_carries_the_robot_and_steers_back():
    law = skywright.build_law("waypoints")
    weight = law.vehicle.assembly.get(Body)["mass"] * 9.81
    np.testing.assert_allclose(law.step().f_B, [0.0, 0.0, weight], atol=1e-6)
    law.estimate.p_WB = law.reference.p_WB + [0.0, 0.0, 0.2]  # too high
    first = law.step().f_B[2]
    assert first < weight and law.step().f_B[2] != first  # the integral goes on
    assert law.dt == pytest.approx(0.002) and {"ref", "est"} <= set(law.ports)


def test_the_records_of_a_law_show_their_values_and_name_wrong_ones():
    law = skywright.build_law("waypoints")
    law.reference.v_WB = [0.5, 0.0, 0.25]
    lines = repr(law.reference).splitlines()
    assert "v_WB = [0.5 0. 0.25]" in lines and "track_tip = 0.0" in lines
    assert [line.partition(" = ")[0] for line in lines] == list(law.reference.dtype.names)
    wanted = r"; valid: an array of numbers of the shape \(3,\)$"
    with pytest.raises(InputError, match=r"^estimate\.p_WB: got \[1, 2\]" + wanted):
        law.estimate.p_WB = [1, 2]
    with pytest.raises(InputError, match=r"^reference\.p_WB: got 'abc'" + wanted):
        law.reference["p_WB"] = "abc"
    with pytest.raises(InputError, match=r"^reference\.active: got 'on'; valid: a number$"):
        law.reference.active = "on"
    with pytest.raises(AttributeError, match=r"no field 'p_W'; valid: .*p_WB"):
        law.estimate.p_W = [1, 2, 3]


@pytest.mark.parametrize(
    ("record", "field", "value", "words"),
    [
        (
            "estimate",
            "p_WB",
            [0.0, math.nan, 1.0],
            r"^estimate\.p_WB: \[0.0, nan, 1.0\]; valid: fin",
        ),
        (
            "reference",
            "R_WB",
            2.0 * np.eye(3),
            r"^reference\.R_WB: .* is not a rotation; valid: an",
        ),
        ("estimate", "R_WB", np.diag([1.0, 1.0, -1.0]), r"^estimate\.R_WB: .* is not a rotation"),
    ],
)
def test_a_law_refuses_what_is_no_number_and_no_rotation(record, field, value, words):
    law = skywright.build_law("waypoints")
    setattr(getattr(law, record), field, value)
    with pytest.raises(InputError, match=words):
        law.step()


def test_a_law_that_tracks_the_tip_reads_the_tip_as_it_is_set():
    law = skywright.build_law(skywright.load("waypoints", robot="othex"))
    rest = law.step().f_B
    law.estimate.p_WT = law.reference.p_WT + [0.1, 0.0, 0.0]  # the tip alone is too far ahead
    np.testing.assert_allclose(law.step().f_B, rest, atol=1e-9)
    law.reference.track_tip = 1.0
    assert law.step().f_B[0] < -1.0


@pytest.mark.parametrize("state", [b"x", None, {}])
def test_what_is_no_state_is_not_restored(state):
    vehicle = skywright.build_vehicle("waypoints")
    vehicle.tick()
    with pytest.raises(InputError, match=r"restore: .*; valid: a state that save\(\) returned"):
        vehicle.restore(state)


# Data of instruments and flights

SCAN = ROOT / "examples" / "weld_data" / "pipe_scan.csv"


def test_a_calibration_span_is_a_text_or_two_numbers():
    texts = skywright.weld(SCAN, calibrate="0:7")
    assert skywright.weld(SCAN, calibrate=(0, np.float32(7.0))).to_json() == texts.to_json()
    for wrong in ((0,), 7, ("a", 1), (0, 1, 2)):
        with pytest.raises(InputError, match=r"calibrate: .*; valid: 2 numbers, or a text T0:T1"):
            skywright.weld(SCAN, calibrate=wrong)


def test_a_threshold_above_the_signal_in_air_has_a_note():
    usual = skywright.weld(SCAN, calibrate="0:7")
    assert 0.9 < usual.result.contact_fraction < 1.0
    assert not any("air counts as contact" in note for note in usual.notes)
    above = 1.1 * usual.result.calibration.excursion
    found = skywright.weld(SCAN, calibrate="0:7", lift_off_threshold=above)
    assert found.result.contact_fraction == 1.0
    assert any("air counts as contact" in note for note in found.notes)


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """A trajectory, and the same one by a clock that is 0.35 s ahead."""
    t = 0.02 * np.arange(1000)
    p = np.stack([np.sin(t), np.cos(0.7 * t), 0.1 * t], axis=1)
    files = tmp_path / "track.txt", tmp_path / "reference.txt"
    for file, clock in zip(files, (t, t + 0.35), strict=True):
        np.savetxt(file, np.column_stack([clock, p, 0.0 * p, np.ones(len(t))]), fmt="%.6f")
    return files


def test_a_reference_offset_is_the_clock_of_the_reference_minus_that_of_the_trajectory(pair):
    track, reference = pair
    for offset in (0.35, np.float32(0.35), None):  # None: it is estimated
        found = skywright.locate(
            track, reference=reference, compare="none", reference_offset=offset
        ).errors["trajectory"]
        assert found.absolute.max < 1e-3 and found.time_offset == pytest.approx(0.35, abs=1e-3)
        assert isinstance(found.time_offset, float)
    for wrong in (-0.35, 0.0):
        found = skywright.locate(
            track, reference=reference, compare="none", reference_offset=wrong
        ).errors["trajectory"]
        assert found.absolute.rms > 0.2


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"time_offset": 0.35}, "time_offset needs a station.*; valid here: reference_offset"),
        ({"span": (0, 10)}, "span needs a station"),
        ({"prism": (0.0, 0.0, 1.0)}, "prism needs a station"),
        ({"span": 3}, "span: 3; valid: 2 numbers, or a text T0:T1"),
        ({"prism": (0, 0)}, r"prism: \(0, 0\); valid: 3 numbers, or a text X,Y,Z"),
        ({"reference_offset": "0"}, "reference_offset '0'; valid: a number of seconds"),
        ({"frame": ("a.csv",)}, r"frame: \('a.csv',\); valid: two files"),
        ({"frame": "points.csv"}, "frame: 'points.csv'; valid: two files"),
        ({"frame": ("a.csv", "b.csv", "c.csv")}, r"frame: \('a.csv', .*\); valid: two files"),
        ({"frame": ("a.csv", 3)}, r"frame: \('a.csv', 3\); valid: two files"),
        ({"reference_offset": [0, 1]}, r"^reference_offset \[0, 1\]; valid: a number"),
    ],
)
def test_arguments_of_locate_that_do_not_fit_are_refused(pair, given, words):
    with pytest.raises(InputError, match=words):
        skywright.locate(pair[0], reference=pair[1], **given)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: skywright.weld(SCAN, columns="x=a,x=b"), "columns: x is given twice"),
        (lambda: skywright.weld(SCAN, calibrate="7:0"), "calibrate: '7:0'"),
        (lambda: skywright.weld("scan--data.csv"), "^scan--data.csv: "),
        (lambda: skywright.identify("a/--mass.csv"), "^a/--mass.csv: "),
        (
            lambda: skywright.campaign("waypoints", 1, {"world.wind.mean_mps": "none(1)"}),
            "vary world.wind.mean_mps: unknown distribution 'none'",
        ),
        (lambda: skywright.campaign("waypoints", 1, {}, sets={"a": 1}), "sets a: unknown root 'a'"),
        (lambda: skywright.campaign("waypoints", 1, None), "^vary: got NoneType; valid: a dict"),
        (lambda: skywright.campaign("waypoints", 2.5, {}), "^runs: got 2.5; valid: an integer"),
        (lambda: skywright.load("waypoints", sets=["a:b"]), "^sets 'a:b': expected KEY=VALUE"),
        (lambda: skywright.load_robot("othex", sets=["a:b"]), "^sets 'a:b': expected KEY=VALUE"),
        (lambda: skywright.load("waypoints", seed=-1), "^seed: mission.seed is -1"),
        (lambda: skywright.run("waypoints", out="."), "already exists; give another out"),
        (lambda: skywright.load_robot(3), "^robot: got int '3'; valid: a name or a path$"),
        (lambda: skywright.load_world(None), "^world: got NoneType 'None'; valid: a name"),
        (
            lambda: skywright.compute_capability(skywright.load("waypoints")),
            "^robot: got Description .*valid: a name or a path, or what load_robot returns",
        ),
        (lambda: skywright.build_model("othex", 3), "^world: got int .* what load_world returns"),
        (lambda: skywright.plan(3), "^description: got int '3'; valid: .* or what load returns"),
        (lambda: skywright.open_run(None), "^directory: got NoneType"),
        (lambda: skywright.weld(np.zeros(3)), "^data: got ndarray"),
        (lambda: skywright.locate(np.zeros(3)), "^data: got ndarray"),
        (lambda: skywright.identify(np.zeros(3)), "^logs: got ndarray"),
        (skywright.locate, "^no data; valid: a station's and a camera's file$"),
        (lambda: skywright.Live(foxglove="a").check(), "^foxglove 'a'; valid: a port, 0 to 65535$"),
        (
            lambda: skywright.fly("hexarotor", live=skywright.Live(wait_s=1.0)),
            "^wait_s requires ros2 or foxglove$",
        ),
        (
            lambda: skywright.campaign(
                "waypoints", 1, {"world.wind.mean_mps": "uniform(0, 1)"},
                sets=["world.wind.mean_mps=1"],
            ),
            "is fixed by sets and varied by vary; choose one",
        ),
    ],
)  # fmt: skip
def test_errors_name_the_arguments_and_not_the_options(call, words):
    with pytest.raises(InputError, match=words) as error:
        call()
    assert not re.search(r"(?<![\w/])--", str(error.value))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--out", "."], ". already exists; give another --out or remove it"),
        (["--set", "a:b"], "--set 'a:b': expected KEY=VALUE"),
        (["--gateway-key", "x"], "--gateway-key requires --gateway or --operator"),
    ],
)
def test_the_command_line_names_its_options(words, told):
    done = CliRunner().invoke(main, ["run", "waypoints", *words])
    assert done.exit_code == 2 and told in " ".join(done.stderr.split())


@pytest.mark.parametrize("mass", ["5.85", [1.0], -1.0, float("nan")])
def test_a_mass_that_is_none_is_refused(directory, mass):
    with pytest.raises(InputError, match=r"^mass .*: give the mass of the robot in kg, above 0"):
        skywright.identify(directory, mass=mass)
