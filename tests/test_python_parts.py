"""The parts of the Python API: scripts of the docs, what importing costs, results by name."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import skywright
from skywright.core.compiled_code import _list_imports, find_dependents
from skywright.errors import InputError
from skywright.run.results import read_name

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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder that the scripts share, as a reader of the page has it."""
    return tmp_path_factory.mktemp("parts")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_runs_and_is_what_the_page_shows(script, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out
    text = script.read_text(encoding="utf-8")
    body = text.partition('"""\n\n')[2]
    assert f"```python\n{body}```" in PAGE
    lines = [line for line in body.splitlines() if line and not line.startswith("import")]
    assert len(lines) <= 10


def test_the_page_names_all_that_is_public():
    assert {name for name in skywright.__all__ if f"`{name}" not in PAGE} == set()
    assert set(skywright.__all__) <= set(dir(skywright))


# Results by name


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory):
    sets = {"mission.task.points": [{"x_m": 0.3, "y_m": 0.0, "z_m": 1.2, "hold_s": 0.5}]}
    out = tmp_path_factory.mktemp("results") / "run"
    return skywright.run(skywright.load("waypoints", sets=sets), out=out, report=False)


@pytest.fixture(scope="module")
def directory(result) -> Path:
    return result.directory


def test_a_run_is_read_back_by_name(result):
    run, samples = skywright.open_run(result.directory), result.samples
    assert run.outcome == result.outcome and run.phases == result.phases
    assert run.metrics == result.metrics
    for name in run.names:
        assert len(run[name])
    np.testing.assert_array_equal(run["platform.p_W"], samples["p_WB"])
    np.testing.assert_array_equal(run["p_WB"], samples["p_WB"])
    assert run["/sensors/inertial"]["gyro"].shape[1] == 3
    assert [r["passed"] for r in run.requirements] == [r.passed for r in result.requirements]
    assert [e.text for e in run.events]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("platform.p_w", ["no 'platform.p_w'", "platform.p_W"]),
        ("gapp", ["no 'gapp'", "gap"]),
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
