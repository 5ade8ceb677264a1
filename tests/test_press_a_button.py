"""A user's kind of mission, flown from its file and as an installed package."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from skywright.core import find
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.reports.report import list_figures, render_report
from skywright.run.check import check_file
from skywright.run.names import list_measures
from skywright.run.planning import plan_mission
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate, run_mission

EXAMPLE = Path(__file__).parents[1] / "examples" / "press_a_button"
MISSION = EXAMPLE / "mission.toml"
SHORT = ["mission.task.times=1", "mission.requirements.button.presses.limit=1"]


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package on the path, with the metadata that an installation leaves."""
    site = tmp_path / "site"
    info = site / "press_a_button-0.1.0.dist-info"
    info.mkdir(parents=True)
    shutil.copy(EXAMPLE / "press_a_button.py", site)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: press-a-button\nVersion: 0.1.0\n")
    (info / "entry_points.txt").write_text(
        "[skywright.missions]\npress-a-button = press_a_button:PressAButton\n"
    )
    monkeypatch.syspath_prepend(str(site))
    find.list_offers.cache_clear()
    yield
    find.list_offers.cache_clear()
    sys.modules.pop("press_a_button", None)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return run_mission(
        load_description(MISSION, sets=SHORT), out=tmp_path_factory.mktemp("b") / "r"
    )


def test_it_flies_from_its_file_and_says_what_it_did(flown: RunResult) -> None:
    assert flown.outcome == "succeeded", (flown.reason, flown.metrics)
    assert flown.metrics["button.presses"] == 1.0
    assert 1.5 < flown.metrics["button.force_max_n"] < 4.0
    page = render_report(flown)
    assert "pressed a button 1 times" in page and "The button" in page
    figure = list_figures(flown.description.mission.kind)["button"](flown)
    assert figure is not None and figure.axes


def test_the_run_repeats_from_its_directory_alone(flown: RunResult) -> None:
    again = load_description(flown.directory)
    assert again.mission.kind == f"{flown.directory / 'press_a_button.py'}:PressAButton"
    repeated = fly_and_evaluate(again)
    assert repeated.samples.tobytes() == flown.samples.tobytes()


def test_it_flies_as_an_installed_package(flown: RunResult, installed: None) -> None:
    d = load_description(MISSION, sets=[*SHORT, "mission.kind=press-a-button"])
    assert d.mission.kind == "press-a-button" and "press-a-button" in find.list_kinds("kind")
    assert fly_and_evaluate(d).samples.tobytes() == flown.samples.tobytes()


def test_its_task_is_a_table_like_any_other() -> None:
    report = check_file(str(MISSION))
    assert report.valid
    assert any(note.startswith("assumed mission.task.actuation_n = 1.5") for note in report.notes)
    with pytest.raises(InputError, match=r"mission\.task\.actuation; the key is actuation_n"):
        load_description(MISSION, sets=["mission.task.actuation=2"])
    with pytest.raises(InputError, match="at most 20"):
        load_description(MISSION, sets=["mission.task.times=21"])
    kind = load_description(MISSION).mission.kind
    assert list_measures(kind)["button.presses"][0] == ""


def test_what_it_cannot_press_is_refused_with_the_number() -> None:
    plan = plan_mission(load_description(MISSION, sets=["mission.task.actuation_n=7"]))
    assert not plan.feasible and "9.10 N" in str(plan.blocked_by)
    with pytest.raises(InputError, match="has no wall for a button"):
        plan_mission(load_description(MISSION, world="open"))
