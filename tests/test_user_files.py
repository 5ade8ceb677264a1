"""Users' files: imported with what lies beside them, kept in run directories, compiled once."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from command_server import CommandServer
from skywright.analysis.campaign.campaign import run_campaign
from skywright.analysis.campaign.spec import build_campaign, build_identity
from skywright.core.user_files import PythonEndedError, load_file, read_sources, tried_first
from skywright.description.loader import load_description
from skywright.evidence.reproduce.flights import describe_content
from skywright.evidence.reproduce.spec import Case
from skywright.recordings.recording import read_recording
from skywright.run.directory import write_sources
from user_parts import OWN_LAW, write_parts

EXAMPLES = Path(__file__).parents[1] / "examples"


# --- imports of files beside a file --------------------------------------------------------------


def test_files_of_one_name_in_two_folders_do_not_meet(tmp_path: Path) -> None:
    found = []
    for name, value in (("a", 1), ("b", 2)):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "gains.py").write_text(f"K = {value}\n")
        (folder / "law.py").write_text(
            "import gains as g\nfrom . import gains\nfrom .gains import K\n\n"
            "def late():\n    import gains\n    return gains.K\n"
        )
        found.append(load_file(folder / "law.py"))
    assert [(m.g.K, m.gains.K, m.K, m.late()) for m in found] == [(1, 1, 1, 1), (2, 2, 2, 2)]
    assert "gains" not in sys.modules


def test_a_file_is_the_same_module_wherever_it_is_imported_from(tmp_path: Path) -> None:
    """A law may ask for the reading of a sensor of another file."""
    (tmp_path / "one.py").write_text("class Reading: ...\n")
    (tmp_path / "two.py").write_text("from one import Reading\n")
    two = load_file(tmp_path / "two.py")
    assert two.Reading is load_file(tmp_path / "one.py").Reading
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("one.py", "two.py"):
        shutil.copy(tmp_path / name, copy)
    assert load_file(copy / "two.py") is two


def test_an_edited_import_is_another_module_and_circles_end(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("import b\nX = 1\n")
    (tmp_path / "b.py").write_text("import a\nY = 1\n")
    first = load_file(tmp_path / "a.py")
    assert set(read_sources(tmp_path / "a.py")) == {tmp_path / "a.py", tmp_path / "b.py"}
    (tmp_path / "b.py").write_text("import a\nY = 2\n")
    second = load_file(tmp_path / "a.py")
    assert second is not first and (first.b.Y, second.b.Y) == (1, 2)


def test_modules_of_python_and_of_skywright_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "random.py").write_text("X = 1\n")
    (tmp_path / "law.py").write_text("import random\nfrom skywright.errors import InputError\n")
    assert hasattr(load_file(tmp_path / "law.py").random, "Random")


def test_sources_of_two_folders_stay_together(tmp_path: Path) -> None:
    for name, value in (("a", 1), ("b", 2)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "gains.py").write_text(f"K = {value}\n")
        (tmp_path / name / f"{name}_law.py").write_text("from gains import K\n")
    out = tmp_path / "out"
    out.mkdir()
    files = [tmp_path / "a" / "a_law.py", tmp_path / "b" / "b_law.py"]
    names = write_sources(out, files)
    assert list(names.values()) == ["a_law.py", "sources_2/b_law.py"]
    assert [load_file(out / names[file]).K for file in files] == [1, 2]


# --- a run directory repeats the run ----------------------------------------------------------


def test_a_run_directory_repeats_the_run_without_the_files(
    tmp_path: Path, commands: CommandServer
) -> None:
    """Kind, law, sensor, estimator, effect and thing are users', and import other files."""
    mission = write_parts(tmp_path / "mine", "complementary.py:Complementary")
    shutil.copy(EXAMPLES / "estimators" / "complementary.py", mission.parent)
    runs = [tmp_path / "first", tmp_path / "second"]
    done = commands.run(["run", str(mission), "--out", str(runs[0])], tmp_path)
    assert done.returncode == 0, done.stderr
    shutil.rmtree(mission.parent)
    done = commands.run(["run", str(runs[0]), "--out", str(runs[1])], tmp_path)
    assert done.returncode == 0, done.stderr
    first, second = (read_recording(run / "recording.mcap").samples for run in runs)
    assert first.tobytes() == second.tobytes() and first["f_tug"].max() == 0.5
    assert abs(first["height_meas"] - first["p_WB"][:, 2]).max() < 0.05
    toml = (runs[1] / "mission.toml").read_text()
    assert str(tmp_path) not in toml and (runs[1] / "gains.py").is_file()


def test_identities_follow_what_a_file_imports(tmp_path: Path) -> None:
    law = OWN_LAW.format(compiled=True, body="        cmd.f_B[0] = 0.0")
    (tmp_path / "mine.py").write_text(f"import gains\n{law}")
    sets = {"mission.law": f"{tmp_path / 'mine.py'}:Mine"}
    seen = []
    for text in ("STIFFNESS = 60.0\n", "STIFFNESS = 61.0\n"):
        (tmp_path / "gains.py").write_text(text)
        campaign = build_campaign("waypoints", ["plant.mass_error=uniform(0,0.1)"], sets=sets)
        case = Case(mission="waypoints", sets=sets, seeds=[1])
        described = describe_content(case, load_description("waypoints", sets=sets))
        seen.append((build_identity(campaign)["law"], described))
    assert seen[0][0] != seen[1][0] and seen[0][1] != seen[1][1]


# --- compiled code -------------------------------------------------------------------------------

CALL = """
import sys
from pathlib import Path
from numba import njit
import skywright.core.compiled
from skywright.core.user_files import load_file
law = load_file(Path(sys.argv[1])).law
print(law(2.0), sum(law.stats.cache_hits.values()))
"""


def test_compiled_code_is_found_by_a_copy_and_never_stale(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "law.py").write_text(
        "from numba import njit\nfrom gains import gain\n\n"
        "@njit(cache=True)\ndef law(x):\n    return gain() * x\n"
    )
    text = "from numba import njit\n\n@njit(cache=True)\ndef gain():\n    return {}\n"
    (folder / "gains.py").write_text(text.format(3.0))

    def call() -> str:
        env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
        command = [sys.executable, "-c", CALL, str(folder / "law.py")]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=env).stdout

    assert [call(), call()] == ["6.0 0\n", "6.0 1\n"]
    folder = Path(shutil.copytree(folder, tmp_path / "copy"))
    assert call() == "6.0 1\n"
    (folder / "gains.py").write_text(text.format(50.0))
    assert call() == "100.0 0\n"
    assert not list(tmp_path.rglob("__pycache__/*.nbi"))


# --- files that end Python -----------------------------------------------------------------------

ENDINGS = {
    "import os\nos._exit(0)\n": "exit code 0",
    "import ctypes\nctypes.string_at(0)\n": "SIGSEGV",
}


@pytest.mark.parametrize("text", ENDINGS)
def test_a_file_that_ends_python_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "mine.py").write_text(text)
    with tried_first(), pytest.raises(PythonEndedError, match=ENDINGS[text]):
        load_file(tmp_path / "mine.py")


def test_a_file_that_is_only_wrong_is_imported_here(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("print('imported')\nraise SystemExit(3)\n")
    with tried_first(), pytest.raises(SystemExit):
        load_file(tmp_path / "mine.py")


def test_a_campaign_survives_a_file_that_ends_python(tmp_path: Path) -> None:
    mission = write_parts(tmp_path / "mine")
    bad = tmp_path / "bad.py"
    bad.write_text("import ctypes\nctypes.string_at(0)\n")
    vary = f"mission.law=choice({mission.parent / 'springs.py'}:Springs,{bad}:Bad)"
    campaign = build_campaign(str(mission), [vary])
    result = run_campaign(campaign, 4, out=tmp_path / "c")
    told = {(row.outcome, str(row.varied["mission.law"]).endswith(":Bad")) for row in result.rows}
    assert told == {("succeeded", False), ("refused", True)}
    assert all(
        "the file ends the Python process (SIGSEGV)" in r.reason
        for r in result.rows
        if r.outcome == "refused"
    )


def test_a_campaign_whose_own_law_ends_python_is_refused(
    tmp_path: Path, commands: CommandServer
) -> None:
    (tmp_path / "bad.py").write_text("import os\nos._exit(0)\n")
    law = f"mission.law={tmp_path / 'bad.py'}:Bad"
    words = ["campaign", "waypoints", "--runs", "2", "--set", law, "--vary",
             "plant.mass_error=uniform(0,0.1)", "--out", "c"]  # fmt: skip
    done = commands.run(words, tmp_path)
    assert done.returncode == 2 and "the file ends the Python process (exit code 0)" in " ".join(
        done.stderr.split()
    )
    assert "Traceback" not in done.stderr and not (tmp_path / "c").exists()
