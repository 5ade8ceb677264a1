"""`skywright new`: every template is valid, flies as it is, and its part really takes part."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skywright import cli
from skywright.core.find import GROUPS
from skywright.description.loader import load_description
from skywright.description.template import list_templates, write_template
from skywright.errors import InputError
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate

TEMPLATES = list_templates()
CHECKED = {"robot.toml": "robot", "world.toml": "world", "mission.toml": "mission"}


def differ(result: RunResult, column: str, other: str) -> bool:
    samples = result.samples
    return bool(np.max(np.abs(samples[column] - samples[other])) > 1e-6)


def lifts(result: RunResult) -> bool:
    """Whether the line, once it is as short as it shall be, carries the parcel's 0.1 kg."""
    samples = result.samples
    short = samples["mine_length"] < 1.0 + 1e-6
    carried = samples["mine_tension"][short & (samples["mine_goal"] == 1.0)]
    return bool(abs(np.mean(carried) - 0.981) < 0.01 and samples["mine_tension"][-1] == 0.0)


# what only a flight with the template's own part shows, by template; the name is "mine"
USED: dict[str, Callable[[RunResult], bool]] = {
    "actuator": lifts,
    "effect": lambda r: bool(np.max(np.abs(r.samples["f_mine_W"])) > 0.5),
    "fault": lambda r: 0.5 < np.max(np.abs(r.samples["f_mine_W"])) < 20.0,
    "estimator": lambda r: differ(r, "est_p_WB", "p_WB"),
    "kind": lambda r: "mine.drift_mm" in r.metrics,
    "law": lambda r: r.description.mission.law.stiffness_n_per_m == 80.0,
    "mission": lambda r: r.description.mission.name == "mine",
    "rule": lambda r: r.description.mission.faults.mine.limit == 3.0,
    "robot": lambda r: r.description.robot.name == "mine",
    "sensor": lambda r: bool(np.ptp(r.samples["mine"]) > 1.0),
    "thing": lambda r: r.description.world.things["button"].stiffness_n_per_m == 400.0,
    "world": lambda r: r.description.world.name == "mine",
}


def call(*words: str) -> str:
    done = CliRunner().invoke(cli.main, list(words))
    assert done.exit_code == 0 and "Traceback" not in done.output, done.output
    return done.stdout


def test_there_is_a_template_of_all_that_can_be_added() -> None:
    assert set(USED) == set(TEMPLATES)
    assert set(GROUPS) - {"arms_law"} | {"robot", "world", "mission"} == set(TEMPLATES)


@pytest.mark.parametrize("what", TEMPLATES)
def test_check_accepts_a_template_as_a_folder_and_file_by_file(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written = call("new", what, "my-own.part").splitlines()
    folder = tmp_path / "my-own.part"
    files = sorted(folder.iterdir())
    assert sorted(written[:-1]) == [str(f.relative_to(tmp_path)) for f in files]
    assert not any(re.search("@[A-Z]+@", f.name + f.read_text()) for f in files)
    assert "my-own.part: a valid" in call("check", "my-own.part")
    for file in files:
        if file.name in CHECKED:
            assert f"a valid {CHECKED[file.name]}" in call("check", str(file))
    with pytest.raises(InputError, match="not overwritten"):
        write_template(what, folder)


@pytest.mark.parametrize("what", TEMPLATES)
def test_a_template_flies_as_it_is(what: str, tmp_path: Path) -> None:
    write_template(what, tmp_path / "mine")
    result = fly_and_evaluate(load_description(tmp_path / "mine" / "mission.toml"))
    assert result.outcome == "succeeded", (result.reason, result.metrics)
    assert USED[what](result)


def test_the_template_of_a_rule_acts(tmp_path: Path) -> None:
    write_template("rule", tmp_path / "mine")
    sets = ["mission.faults.mine.limit=0.4", "mission.faults.mine.hold_s=0.2"]
    result = fly_and_evaluate(load_description(tmp_path / "mine" / "mission.toml", sets=sets))
    assert (result.outcome, result.acted[0].rule) == ("aborted", "mine")
    assert "it was 0." in result.reason and "m from its start" in result.reason


def test_there_is_no_template_of_everything(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no template for 'wrold'; valid: world, "):
        write_template("wrold", tmp_path / "mine")
    with pytest.raises(InputError, match="kind name '1x'"):
        write_template("kind", tmp_path / "1x")


@pytest.mark.parametrize(
    ("what", "name", "says"),
    [
        ("robot", "othex", "othex is the name of an existing robot; choose another"),
        ("law", "waypoints", "waypoints is the name of an existing mission"),
        ("effect", "wind", "wind is the name of an existing effect"),
        ("rule", "Rotor-Lost", "rotor_lost is the name of an existing rule"),
        ("law", "None", "None is a keyword of Python; choose another"),
        ("law", "lambda", "lambda is a keyword of Python"),
        ("robot", "a" * 55, "at most 54 characters"),
        ("world", "a" * 55, "at most 54 characters; its mission is named a+-waypoints"),
        ("thing", "a" * 55, "at most 54 characters"),
    ],
)
def test_a_name_that_means_something_else_is_refused(
    what: str, name: str, says: str, tmp_path: Path
) -> None:
    """The commands that it prints would check and fly the built-in part."""
    with pytest.raises(InputError, match=says):
        write_template(what, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("what", "name"),
    [("robot", "a" * 54), ("world", "a" * 54), ("mission", "a" * 64), ("robot", "lambda")],
)
def test_the_longest_name_and_a_word_without_python_are_valid(
    what: str, name: str, tmp_path: Path
) -> None:
    write_template(what, tmp_path / name)
    assert "valid" in call("check", str(tmp_path / name))
