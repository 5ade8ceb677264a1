"""Kinds of missions: found by name or file, typed, and named nowhere but in their folders."""

from __future__ import annotations

import ast
import pickle
import re
from pathlib import Path

import pytest

import skywright
import skywright.missions
from skywright.core.find import list_kinds
from skywright.description.dump import dump_description
from skywright.description.loader import list_missions, load_description
from skywright.errors import InputError
from skywright.run.backends import build_vehicle
from skywright.run.kind import MissionKind, load_kind
from skywright.run.names import COMMON, list_all_measures
from skywright.vehicle.devices import DEVICES, Devices
from skywright.vehicle.interface import require

KINDS = list_kinds("kind")
OLD = """[mission]
name = "old"
kind = "{kind}"
robot = "{robot}"
world = "{world}"
{more}
"""


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_is_complete(name: str) -> None:
    kind = load_kind(name)
    assert isinstance(kind, MissionKind) and kind.needs
    assert not set(kind.measures) & set(COMMON)
    figures = kind.figures()
    assert callable(figures.describe) and all(c.caption for c in figures.charts.values())


@pytest.mark.parametrize("name", KINDS)
def test_the_functions_of_a_folder_take_and_give_what_its_kind_says(name: str) -> None:
    """They are found by name, where mypy sees no types: task and way are the same in all."""
    folder = Path(skywright.__file__).parent / "missions" / name.replace("-", "_")
    found = {
        node.name: [ast.unparse(a.annotation) for a in node.args.args if a.annotation]
        + [ast.unparse(node.returns) if node.returns else ""]
        for part in ("plan", "fly", "metrics")
        if (folder / f"{part}.py").is_file()
        for node in ast.parse((folder / f"{part}.py").read_text("utf-8")).body
        if isinstance(node, ast.FunctionDef)
    }
    task = load_kind(name).task.__name__
    way = found["plan"][-1].removeprefix("MissionPlan[").removesuffix("]")
    assert found["plan"] == [f"Setup[{task}]", f"MissionPlan[{way}]"]
    assert found["fly"] == [f"Supervisor[{task}]", way, "Flight"]
    judged = found.get("compute_metrics", [f"Flown[{task}, {way}]", "dict[str, float]"])
    assert judged[0] in (f"Flown[{task}, {way}]", f"Flown[Any, {way}]")
    assert judged[1] == "dict[str, float]"


def test_every_metric_of_a_mission_is_one_of_its_kind() -> None:
    for entry in list_missions():
        mission = load_description(entry.name).mission
        assert set(mission.requirements) <= {*COMMON, *load_kind(mission.kind).measures}
    assert len(list_all_measures()) > len(COMMON) + 50


def test_a_description_survives_pickling_and_a_file() -> None:
    for name in ("waypoints", "bar-transport"):
        d = load_description(name)
        again = pickle.loads(pickle.dumps(d))
        assert again == d and type(again.mission.task) is type(d.mission.task)
        assert dump_description(again) == dump_description(d)


def test_old_keys_load_and_say_what_is_new(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan = tmp_path / "scan.toml"
    more = (
        "waypoints = []\n[mission.scan]\npasses = 3\nspeed_mps = { value = 0.02, source = 'paper' }"
    )
    scan.write_text(OLD.format(kind="scan", robot="othex", world="pipe", more=more))
    d = load_description(scan, sets=["mission.scan.arc_deg=30"])
    assert (d.mission.task.passes, d.mission.task.arc_deg) == (3, 30.0)
    assert d.sources["mission.task.speed_mps"].kind == "paper"
    said = capsys.readouterr().err.splitlines()
    assert f"skywright: {scan}: mission.scan is now called mission.task" in said
    assert "skywright: --set: mission.scan is now called mission.task" in said
    assert len(said) == 2  # an empty list says nothing

    way = tmp_path / "way.toml"
    more = "[[mission.waypoints]]\nx_m = 1.0\ny_m = 0.0\nz_m = 1.5"
    way.write_text(OLD.format(kind="waypoints", robot="hexarotor", world="open", more=more))
    d = load_description(way, sets={"mission.waypoints.0.x_m": 0.5})
    assert [p.x_m for p in d.mission.task.points] == [0.5]


def test_old_and_new_key_together_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "both.toml"
    more = "[mission.task]\npasses = 3\n[mission.scan]\npasses = 2"
    file.write_text(OLD.format(kind="scan", robot="othex", world="pipe", more=more))
    with pytest.raises(InputError, match=r"both\.toml: mission\.scan\.passes is now .*both are"):
        load_description(file)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no class 'Mine'"),
        ("1 / 0", "importing .* failed: ZeroDivisionError"),
        ("class Mine: pass", "a mission kind is needed"),
        (
            "from skywright.run.kind import MissionKind\nclass Mine(MissionKind): pass",
            "does not define",
        ),
    ],
)
def test_a_kind_that_is_none_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "mine.py").write_text(text)
    file = tmp_path / "mission.toml"
    file.write_text(OLD.format(kind="mine.py:Mine", robot="hexarotor", world="open", more=""))
    with pytest.raises(InputError, match=words):
        load_description(file)


def test_a_kind_that_does_not_exist_is_told_with_its_neighbours() -> None:
    with pytest.raises(InputError, match=r"mission\.kind: mission kind 'skan' is unknown.*scan"):
        load_description("waypoints", sets=["mission.kind=skan"])


def test_unknown_keys_of_a_task_are_refused() -> None:
    with pytest.raises(InputError, match=r"unknown key mission\.task\.pases; valid: passes"):
        load_description("pipe-weld-scan", sets=["mission.task.pases=2"])


def test_nothing_below_the_missions_names_a_kind() -> None:
    """What CONTRIBUTING says of adding a kind: it touches its own folder, and tests and docs."""
    source = Path(skywright.__file__).parent
    folders = [kind.replace("-", "_") for kind in KINDS]
    names = [kind for kind in KINDS if "-" in kind]  # the others are words of their own
    marks = [f"skywright.missions.{folder}" for folder in folders] + names
    named = re.compile(rf"(?<![\w-])(?:{'|'.join(marks)})(?![\w-])")
    above = {"missions", "analysis", "evidence"}  # kinds, and studies that are about one
    for file in source.rglob("*.py"):
        if file.relative_to(source).parts[0] not in above:
            found = named.findall(file.read_text(encoding="utf-8"))
            assert not found, f"{file} names {found}"


def test_missions_use_the_devices_that_they_declare_and_nothing_else_of_the_world() -> None:
    """What is beside the robot is reached through `s.devices` alone."""
    folder = Path(skywright.missions.__file__).parent
    used: dict[str, set[str]] = {}
    for file in folder.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        assert not re.search(r"vehicle\.(push|survey|move_bench|zero_gauges|devices)\b", text), file
        used.setdefault(file.parent.name, set()).update(re.findall(r"s\.devices\.(\w+)", text))
    declared = {p: load_kind(p.replace("_", "-")).devices for p, names in used.items() if names}
    assert declared == {p: frozenset(names) for p, names in used.items() if names}
    assert set().union(*declared.values()) == set(DEVICES)


def test_a_device_that_is_lacking_or_not_declared_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    description = skywright.load("bimanual-bench")
    vehicle = build_vehicle(description)
    with pytest.raises(InputError, match="'bench': mission kind 'scan' does not declare it; there"):
        _ = vehicle.devices.grant("scan", frozenset({"helper"})).bench
    lacks = frozenset({"surveyor"})
    monkeypatch.setattr(type(vehicle), "devices", property(lambda v: Devices(v, lacks)))
    with pytest.raises(InputError, match="requires the device bench; the vehicle has surveyor"):
        require(vehicle, frozenset({"hands"}), "bimanual-bench", frozenset({"bench"}))
