"""Finished runs for others: exports, and two runs compared."""

from __future__ import annotations

import csv
import json
import re
import shutil
from collections import Counter
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pyarrow.parquet
import pytest
import yaml
from click.testing import CliRunner
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import skywright
from skywright.analysis.compare_runs.overlay import compare_runs
from skywright.analysis.compare_runs.report import format_setting as text_of
from skywright.cli import main
from skywright.cli.runs import FORMATS as OFFERED
from skywright.errors import SimulationError
from skywright.inspection.history.store import InspectionStore
from skywright.run.export import FORMATS, export_run
from skywright.run.results import flatten, open_run


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two short flights: of seed 1, and of seed 2 with wind."""
    folder = tmp_path_factory.mktemp("runs")
    point = [{"x_m": 0.3, "y_m": 0.0, "z_m": 1.2, "hold_s": 0.5}]
    for name, seed, wind in (("one", 1, 0.0), ("two", 2, 1.5)):
        sets = {"mission.task.points": point, "world.wind.mean_mps": wind}
        d = skywright.load("waypoints", sets=sets, seed=seed)
        skywright.run(d, out=folder / name, report=False)
    return folder / "one", folder / "two"


def call(*args: object, code: int = 0):
    found = CliRunner().invoke(main, [str(a) for a in args])
    assert found.exit_code == code, found.output
    return found


def refuse(*args: object) -> str:
    return " ".join(call(*args, code=2).stderr.split())


# Exports


def test_tables_hold_every_number_bit_for_bit(runs, tmp_path):
    run = open_run(runs[0])
    wanted = flatten(run.recording)
    call("export", runs[0], "--format", "csv", "--out", tmp_path / "r.csv")
    with (tmp_path / "r.csv").open() as text:
        rows = list(csv.reader(text))
    assert rows[0] == list(wanted) and {"t", "p_WB_x", "q_WB_w", "rotor_thrust_5"} <= set(rows[0])
    table = np.array(rows[1:], dtype=float).T
    for name, values in zip(rows[0], table, strict=True):
        np.testing.assert_array_equal(values, wanted[name], name)
    call("export", runs[0], "--format", "parquet", "--out", tmp_path / "r.parquet")
    read = pyarrow.parquet.read_table(tmp_path / "r.parquet")
    assert read.column_names == list(wanted)
    np.testing.assert_array_equal(read["p_WB_z"].to_numpy(), wanted["p_WB_z"])
    call("export", runs[0], "--format", "npz", "--out", tmp_path / "r.npz")
    with np.load(tmp_path / "r.npz") as arrays:
        assert set(arrays) == {c.name for c in run.columns}
        np.testing.assert_array_equal(arrays["q_WB"], run["q_WB"])


def test_a_trajectory_is_one_of_tum(runs, tmp_path):
    run = open_run(runs[0])
    for name, file in (("platform", "p.txt"), ("reference.platform", "r.txt")):
        call("export", runs[0], "--format", "tum", "--trajectory", name, "--out", tmp_path / file)
        rows = np.loadtxt(tmp_path / file)
        np.testing.assert_allclose(rows[:, 1:4], run[f"{name}.p_W"], rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(rows[:, [7, 4, 5, 6]], run[f"{name}.q_W"], 1e-7, 1e-9)
    said = refuse("export", runs[0], "--format", "csv", "--trajectory", "tip")
    assert "--trajectory tip: not valid with --format csv; valid: tum" in said
    said = refuse("export", runs[0], "--format", "tum", "--trajectory", "platfrm")
    assert "platfrm" in said and "platform" in said
    judged = skywright.locate(tmp_path / "p.txt", reference=tmp_path / "r.txt", compare="none")
    assert judged.errors  # a reader of TUM files takes it


def test_a_bag_is_read_by_a_library_for_ros(runs):
    found = json.loads(call("export", runs[0], "--format", "rosbag2", "--json").stdout)
    bag, run = Path(found["file"]), open_run(runs[0])
    assert bag == runs[0].with_name("one-bag") and found["format"] == "rosbag2"
    assert (bag / "metadata.yaml").is_file()
    with AnyReader([bag]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts["/truth/pose"] == len(run["t"]) and counts["/sensors/inertial"] > 1000
        assert reader.message_count == sum(counts.values())
        assert reader.duration / 1e9 == pytest.approx(run["t"][-1], abs=0.1)
        poses = [c for c in reader.connections if c.topic == "/truth/pose"]
        last = list(reader.messages(poses))[-1]
        message = reader.deserialize(last[2], last[0].msgtype)
        assert message.pose.position.z == run["p_WB"][-1, 2]
    assert "already exists" in refuse("export", runs[0], "--format", "rosbag2")


def test_a_bag_gives_every_message_to_a_library_for_ros(runs, tmp_path):
    """Also the latched ones, whose QoS the metadata hold."""
    call("export", runs[0], "--format", "rosbag2", "--out", tmp_path / "bag")
    with (runs[0] / "recording.mcap").open("rb") as stream:
        found = Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())
        stream.seek(0)
        summary = make_reader(stream).get_summary()
    with AnyReader([tmp_path / "bag"]) as reader:
        assert Counter(c.topic for c, _, _ in reader.messages()) == found
    assert found["/robot_description"] and found["/tf_static"]
    told = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    topics = told["rosbag2_bagfile_information"]["topics_with_message_count"]
    told_qos = {
        t["topic_metadata"]["name"]: t["topic_metadata"]["offered_qos_profiles"] for t in topics
    }
    assert "durability: 1" in told_qos["/tf_static"]
    for channel in summary.channels.values():
        assert told_qos[channel.topic] == channel.metadata.get("offered_qos_profiles", "")


def test_a_run_is_exported_from_its_own_folder(runs, tmp_path, monkeypatch):
    shutil.copytree(runs[0], tmp_path / "flown")
    monkeypatch.chdir(tmp_path / "flown")
    call("export", ".", "--format", "csv")
    assert [p.name for p in tmp_path.glob("*.csv")] == ["flown.csv"]


def test_an_export_to_a_folder_that_is_a_file_is_refused(runs, tmp_path):
    (tmp_path / "file").write_text("")
    for out in ("file/x.csv", "file/sub/x.csv"):
        said = refuse("export", runs[0], "--format", "csv", "--out", tmp_path / out)
        assert f"{out}: cannot be written: {tmp_path}/file is a file" in said
        assert "partial" not in said
    said = refuse("export", runs[0], "--format", "csv", "--out", tmp_path / ("x" * 300) / "x.csv")
    assert "cannot be written: File name too long" in said


@pytest.mark.parametrize("form", FORMATS)
def test_an_interrupted_export_leaves_nothing(form, runs, tmp_path, monkeypatch):
    """Not even a folder that it created; and what has a similar name is not touched."""
    (tmp_path / "x.partial").mkdir()
    (tmp_path / "x.partial" / "recording.mcap").write_text("of a killed run")
    kept = sorted(tmp_path.rglob("*"))

    chosen = FORMATS[form]

    def write(*args):
        chosen.write(*args)
        raise KeyboardInterrupt

    monkeypatch.setitem(FORMATS, form, chosen._replace(write=write))
    for out in ("x", "new/folder/x"):
        with pytest.raises(KeyboardInterrupt):
            export_run(open_run(runs[0]), form, tmp_path / out)
        assert sorted(tmp_path.rglob("*")) == kept


# A run in a folder with the name of a built-in mission


def test_a_folder_named_like_a_mission_keeps_its_settings(tmp_path, monkeypatch):
    """The robot, the seed and the requirements are those of the run, not the built-in mission's."""
    point = [{"x_m": 0.3, "y_m": 0.0, "z_m": 1.2, "hold_s": 0.5}]
    sets = {"mission.task.points": point}
    d = skywright.load("waypoints", robot="f550-bridge", seed=7, sets=sets)
    assert d.robot.name != skywright.load("waypoints").robot.name
    monkeypatch.chdir(tmp_path)
    flown = skywright.run(d, out="waypoints", report=False).requirements
    found = skywright.evaluate("waypoints")
    assert found.description.robot == d.robot and found.description.mission.seed == 7
    assert found.requirements == flown
    played = skywright.fly(mission="waypoints", backend="recording")
    assert played.backend.robot.name == "f550-bridge"
    call("report", "waypoints")
    page = Path("waypoints/report.html").read_text(encoding="utf-8")
    assert "skywright run ./waypoints --out waypoints-again" in page
    call("records", "r.sqlite", "--import", "waypoints")
    store = InspectionStore(tmp_path / "r.sqlite")
    assert [flight.robot for flight in store.list_flights()] == ["f550-bridge"]
    store.close()


def test_what_cannot_be_exported_is_refused(runs, tmp_path):
    cut = tmp_path / "cut.partial"
    cut.mkdir()
    for name in ("mission.toml", "metrics.json"):
        (cut / name).write_bytes((runs[0] / name).read_bytes())
    data = (runs[0] / "recording.mcap").read_bytes()
    (cut / "recording.mcap").write_bytes(data[: len(data) // 2])
    assert "was not finished" in refuse("export", cut, "--format", "rosbag2")
    assert not list(tmp_path.glob("*-bag"))
    call("export", cut, "--format", "csv")
    assert "'xls' is not one of 'csv', 'parquet'" in refuse("export", runs[0], "--format", "xls")
    assert "is not a run directory" in refuse("export", tmp_path, "--format", "csv")
    assert tuple(FORMATS) == OFFERED
    assert not list(tmp_path.glob("*.*.partial"))


# Two runs compared


def test_two_runs_are_compared(runs, tmp_path):
    a, b = map(open_run, runs)
    found = compare_runs(a, b)
    settings = {key: (one, other) for key, one, other in found.settings}
    assert settings["mission.seed"] == (1, 2) and settings["world.wind.mean_mps"] == (0.0, 1.5)
    assert not any("robot." in key for key in settings)
    first = found.metrics[0]
    assert first.requirement and first.passed[0] is not None
    rms = next(m for m in found.metrics if m.name == "position.rms_m")
    assert rms.difference == b.metrics["position.rms_m"] - a.metrics["position.rms_m"]
    titles = {s.title: s for s in found.series}
    error = titles["Platform from its reference"]
    wanted = np.linalg.norm(b["p_WB"] - b["ref_p_WB"], axis=1)
    flies = b["rotor_thrust"].sum(axis=1) > 0.5
    np.testing.assert_allclose(error.b[1][flies], 1e3 * wanted[flies])
    for title in ("Platform from its reference", "Error of the estimated position"):
        assert np.all(np.isnan(titles[title].b[1]) == ~flies)  # no estimate before the motors turn
    assert "Tip from its reference" not in titles  # it has no arm
    page = tmp_path / "c.html"
    said = call("compare", "runs", *runs, "--out", page).stdout
    assert "position.rms_m" in said and "world.wind.mean_mps: 0.0 | 1.5" in said
    assert text_of(None) == "not set"
    assert text_of([{"x_m": 1.5, "hold": True, "name": "a"}]) == (
        '[{x_m = 1.5, hold = true, name = "a"}]'
    )
    text = page.read_text(encoding="utf-8").replace("<wbr>", "")
    assert "position.rms_m" in text and "image/svg+xml" in text
    assert text.index("Over time</h2>") < text.index("Settings that differ</h2>")
    assert "default-src 'none'" in text and not re.search(r"(src|href)=.http", text)
    printed = json.loads(call("compare", "runs", *runs, "--out", page, "--json").stdout)
    assert printed["metrics"]["position.rms_m"]["difference"] == rms.difference
    assert printed["settings"]["mission.seed"] == [1, 2]


def test_a_comparison_links_to_the_reports_that_exist(runs, tmp_path):
    shutil.copytree(runs[0], tmp_path / "run #1")
    (tmp_path / "run #1" / "report.html").write_text("of the first run")
    assert not (runs[1] / "report.html").exists()
    page = tmp_path / "pages" / "c.html"
    page.parent.mkdir()
    call("compare", "runs", tmp_path / "run #1", runs[1], "--out", page)
    links = re.findall(r'<a href="([^#"][^"]*)"', page.read_text(encoding="utf-8"))
    assert links == ["../run%20%231/report.html"]
    assert (page.parent / unquote(links[0])).read_text() == "of the first run"


def test_a_run_compared_with_itself_differs_in_nothing(runs):
    found = compare_runs(*map(open_run, (runs[0], runs[0])))
    assert found.settings == [] and all(m.difference in (0.0,) or m.a != m.a for m in found.metrics)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["runs", "one"], "Missing argument 'B'"),
        (["othex"], "Missing argument 'B'"),
        (["runs", "one", "two", "--no-fly"], "No such option '--no-fly'"),
        (["runs", "nope", "nope"], "is not a run directory"),
    ],
)
def test_what_cannot_be_compared_is_refused(args, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert words in refuse("compare", *args)
    assert not list(tmp_path.iterdir())


# Words of the command line around them


def test_list_alone_is_short():
    said = call("list").stdout
    assert len(said.splitlines()) < 25 and "othex" in said and "pipe-weld-scan" in said
    assert "of suarez-2020" in said and "sensors" in said
    assert len(json.loads(call("list", "--json").stdout)["claims"]) > 50


def test_check_looks_at_all_of_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call("new", "robot", "mine")
    call("new", "world", "place")
    Path("mine/world.toml").write_text(Path("place/world.toml").read_text())
    said = call("check", "mine").stdout
    assert (
        "can lift its weight: hover takes" in said and "a valid robot and world and mission" in said
    )
    text = Path("mine/world.toml").read_text().replace("[world.wind]", "[world.wnd]")
    Path("mine/world.toml").write_text(text)
    heavy = Path("mine/robot.toml").read_text()
    Path("mine/robot.toml").write_text(heavy + "\n[robot.nonsense]\nx = 1\n")
    problems = json.loads(call("check", "mine", "--json", code=2).stdout)["problems"]
    assert any("world.toml" in p and "wnd" in p for p in problems)
    assert any("robot.toml" in p and "nonsense" in p for p in problems)


@pytest.mark.parametrize("compiled", [True, False])
def test_an_error_in_a_users_step_has_its_file_and_line(compiled, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call("new", "law", "mine")
    law = next(Path("mine").glob("*.py"))
    text, static = law.read_text(), "    @staticmethod\n    def step("
    text = text.replace(static, f"    compiled = {compiled}\n\n{static}")
    first = "        arm_velocity("
    assert text.count(static) == text.count(first) == 1
    line = text[: text.index(first)].count("\n") + 1
    law.write_text(text.replace(first, f"        raise ValueError('mine')\n{first}"))
    vehicle = skywright.build_vehicle("mine")
    with pytest.raises(SimulationError, match=rf"ValueError.*{law.name}:{line}\)"):
        vehicle.tick()


def test_completion_is_offered(monkeypatch):
    monkeypatch.setenv("_SKYWRIGHT_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", "skywright ex")
    monkeypatch.setenv("COMP_CWORD", "1")
    found = CliRunner().invoke(main, prog_name="skywright")
    assert "export" in found.output
