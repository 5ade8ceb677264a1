"""The comparison of planners: jobs on processes, parts that are kept, rows from what was found."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from skywright.errors import InputError
from skywright.studies.bench.runner import run_benchmarks
from skywright.studies.planning import jobs
from skywright.studies.planning.__main__ import draw_found
from skywright.studies.planning.compare import build_decoupled_rows, build_rows
from skywright.studies.planning.jobs import HIGH, OURS, SUCCESS, Effort, Job, list_jobs, run_jobs

EFFORT = Effort(("paper",), ("paper", HIGH), 1, 0.1, 0.1, 2, 0.1)


def test_kept_parts_are_used_and_stale_ones_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second call runs nothing; another effort or a broken file is run again."""
    job, ran = Job("paper", SUCCESS), []
    real = jobs.run_job

    def counted(one: Job, effort: Effort):
        ran.append(one)
        return real(one, effort)

    monkeypatch.setattr(jobs, "run_job", counted)
    first = run_jobs([job], EFFORT, keep=tmp_path)
    assert run_jobs([job], EFFORT, keep=tmp_path) == first and len(ran) == 1
    run_jobs([job], EFFORT._replace(success_seeds=1), keep=tmp_path)
    assert len(ran) == 2
    (kept,) = tmp_path.glob("*.json")
    kept.write_text("{", encoding="utf-8")
    run_jobs([job], EFFORT, keep=tmp_path)
    assert len(ran) == 3 and json.loads(kept.read_text(encoding="utf-8"))["found"]


def test_two_processes_find_what_one_finds() -> None:
    """All jobs but OMPL's, on processes; each seed has a path, and rows judge the costs."""
    found = run_jobs(list_jobs(EFFORT, with_ompl=False), EFFORT, workers=2)
    rows = {row.name: row for row in build_rows("paper", EFFORT, found)}
    assert rows["paper_success_1s"].value == 1.0 and rows["paper_reserve_mm"].passed
    assert all(math.isfinite(c) for c in found[Job("paper", OURS)]["late"])
    assert rows["paper_over_ompl"].value is None and "paper_over_ompl_rrtstar" not in rows
    # what the processes found is drawn, with the lower bound
    figure = draw_found(found)
    assert [a.get_title(loc="left") for a in figure.axes] == ["paper"]
    assert {t.get_text() for t in figure.axes[0].get_legend().get_texts()} == {
        "default planner", "RRT* of the paper",
    }  # fmt: skip
    apart = {row.name: row for row in build_decoupled_rows(EFFORT, found)}
    assert apart["paper_joint_over_decoupled"].value is None
    assert "arms held" in apart["paper_joint_over_decoupled"].note
    # without a ceiling the platform can fly over with hanging arms, and nothing is cheaper
    high = apart[f"{HIGH}_joint_over_decoupled"]
    assert high.value == pytest.approx(1.0, abs=0.02)
    assert apart["joint_success"].value == 1.0 and apart["decoupled_success"].value == 0.0


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="--resume"):
        run_benchmarks(["planning"], effort="quick", resume=file / "parts")
