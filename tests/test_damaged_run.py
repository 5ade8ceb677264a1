"""Run directories that a copy cut off or that someone edited: no verdict on a part of a flight."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import skywright
from short_mission import HOP
from skywright import cli
from skywright.description.loader import load_description
from skywright.run.run import run_mission


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("flown") / "r"
    description = load_description("waypoints", sets=HOP)
    assert run_mission(description, out=out, backend="kinematic").outcome == "succeeded"
    return out


@pytest.fixture
def run(flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(flown, tmp_path / "r")).relative_to(tmp_path)


def call(*words: object) -> Any:
    return CliRunner().invoke(cli.main, list(map(str, words)), prog_name="skywright")


def cut(run: Path, share: float) -> None:
    file = run / "recording.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])


def test_a_truncated_recording_gives_no_verdict(run: Path) -> None:
    cut(run, 0.6)
    result = skywright.evaluate(run)
    assert result.outcome == "interrupted"
    assert result.reason.startswith("recording.mcap is truncated at t = ")
    for words in (
        ("report", run),
        ("export", run, "--format", "csv"),
        ("compare", "runs", run, run),
    ):
        done = call(*words)
        assert done.exit_code == 0, done.output
        assert "r: interrupted: recording.mcap is truncated at t = " in done.stderr
    assert "recording.mcap is truncated" in (run / "report.html").read_text()
    last = result.phases[-1]
    assert last.outcome == "interrupted" and last.end_s == pytest.approx(result.samples["t"][-1])
    assert [p.outcome for p in result.phases[:-1]] == ["done"] * (len(result.phases) - 1)


def test_an_export_without_samples_is_refused(run: Path) -> None:
    cut(run, 0.03)
    done = call("export", run, "--format", "csv")
    assert done.exit_code == 2 and not Path("r.csv").exists()
    assert "r: the recording has no samples" in done.stderr


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("metrics", [], "metrics: found a list of 0; valid: a JSON object"),
        ("metrics", {"a": "x"}, "metrics.a: found the text 'x'"),
        ("metrics", None, "metrics: found None"),
        ("requirements", [{"name": "a"}], "requirements.0.value: "),
        ("requirements", {"a": 1}, "requirements: found a table"),
        ("checklist", 3, "checklist: found 3"),
    ],
)
@pytest.mark.parametrize(
    "words", [("report", "r"), ("export", "r", "--format", "csv"), ("compare", "runs", "r", "r")]
)
def test_an_edited_metrics_file_is_one_line(
    run: Path, key: str, value: Any, says: str, words: tuple[str, ...]
) -> None:
    file = run / "metrics.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {key: value}))
    done = call(*words)
    assert done.exit_code == 2 and done.stderr.count("\n") == 1, done.output
    assert f"r/metrics.json: is damaged: {says}" in done.stderr


def test_a_list_as_metrics_file_is_named(run: Path) -> None:
    (run / "metrics.json").write_text("[]")
    done = call("report", run)
    assert done.exit_code == 2 and "valid: a JSON object" in done.stderr
