"""The comparison of planners: jobs on processes, parts that are kept, rows from what was found."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path
from types import ModuleType

import pytest

from skywright.errors import InputError
from skywright.evidence.bench.runner import run_benchmarks
from skywright.evidence.planning import __main__ as module
from skywright.evidence.planning import jobs
from skywright.evidence.planning.__main__ import draw_found
from skywright.evidence.planning.compare import build_decoupled_rows, build_rows
from skywright.evidence.planning.jobs import (
    DECOUPLED,
    HIGH,
    OMPL,
    OURS,
    PAPER,
    SUCCESS,
    Effort,
    Job,
    list_jobs,
    run_jobs,
)

EFFORT = Effort(("paper",), ("paper", HIGH), 1, 0.1, 0.1, 1, 0.1)


def test_kept_parts_are_used_and_stale_ones_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second call runs nothing; another effort or a broken file is run again."""
    job, ran = Job("paper", OURS), []
    real = jobs.run_job

    def counted(job: Job, effort: Effort):
        ran.append(job)
        return real(job, effort)

    monkeypatch.setattr(jobs, "run_job", counted)
    first = run_jobs([job], EFFORT, keep=tmp_path)
    assert run_jobs([job], EFFORT, keep=tmp_path) == first and len(ran) == 1
    run_jobs([job], EFFORT._replace(star_s=0.2), keep=tmp_path)
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
    assert "arms in their initial posture" in apart["paper_joint_over_decoupled"].note
    # without a ceiling the platform can fly over with hanging arms, and nothing is cheaper
    high = apart[f"{HIGH}_joint_over_decoupled"]
    assert high.value == pytest.approx(1.0, abs=0.02)
    assert apart["joint_success"].value == 1.0 and apart["decoupled_success"].value == 0.0


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="--resume"):
        run_benchmarks(["planning"], effort="quick", resume=file / "parts")


def _load_generator() -> ModuleType:
    path = Path(__file__).parent.parent / "docs" / "generate_planners.py"
    spec = importlib.util.spec_from_file_location("generate_planners", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_s_tables_are_made_from_the_parts() -> None:
    """What is there is shown with its unit, what is not measured as a dash, what failed as none."""
    generator = _load_generator()
    found = {
        Job("paper", OURS): {
            "early": [9.3, 9.2, 9.4], "late": [9.0, 9.1, 9.2], "first_s": [1e-3, 2e-3, 3e-3],
            "curve": [[9.3]] * 3, "reserve": [1e-4, 2e-4, 3e-4], "bound": [9.0],
        },
        Job("paper", SUCCESS): {"cost": [9.5, math.inf], "first_s": [2e-3, math.nan]},
        Job("paper", OMPL[0]): {"cost": [9.3, 18.6, 18.6], "curve": [[18.6]] * 3},
        Job("paper", PAPER): {"cost": [math.inf] * 3, "curve": [[math.inf]] * 3},
        Job(HIGH, DECOUPLED): {"joint": [9.2], "cost": [9.0], "reason": ""},
    }  # fmt: skip
    effort = Effort(("paper", "draw10"), ("paper", HIGH), 3, 5.0, 30.0, 2, 1.0)
    head = "before\n" + generator.BEGIN + "\nold\n" + generator.END + "\nafter\n"
    text = generator.build_page(head, found, effort)
    assert "| paper | 2.0 ms | 9.300 m | 9.100 m | 1.11 % | 0.1 mm | 1 of 2 |" in text
    assert "| draw10 | – | – | – | – | – | – |" in text
    assert "| paper | 18.600 m (+50.0 %) | – | – | none |" in text
    assert "| draw10 | – | – | – | – |\n" not in text  # no reference there at all
    assert "None is measured" in generator.build_section({}, effort)
    assert "| paper, ceiling at 6 m | 1 of 1 | 9.200 m | 1 of 1 | 9.000 m |" in text
    assert "old" not in text and text.startswith("before\n") and text.endswith("after\n")
    assert generator.build_page(text, found, effort) == text
    with pytest.raises(ValueError, match="markers"):
        generator.build_page("no markers", found, effort)


def test_the_plot_shows_all_planners_that_have_run() -> None:
    """The paper's RRT* among them; a planner without a path yet is drawn from where it has one."""
    curve = [[math.inf, 9.5, 9.4], [10.0, 9.6, 9.2]]
    found = {Job("paper", OURS): {"curve": curve, "bound": [9.0]}}
    found |= {Job("paper", what): {"curve": curve} for what in (PAPER, *OMPL)}
    (axes,) = draw_found(found).axes
    names = [t.get_text() for t in axes.get_legend().get_texts()]
    assert names == [
        "default planner", "RRT* of the paper", "OMPL RRT*", "OMPL Informed RRT*",
        "OMPL RRT-Connect",
    ]  # fmt: skip


def test_a_figure_without_the_default_planner_is_refused_before_the_jobs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "run_jobs", lambda *_: pytest.fail("jobs were run"))
    picture = tmp_path / "cost.svg"
    arguments = ["planning", str(tmp_path), "--only", PAPER, "--figure", str(picture)]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(SystemExit, match=f"--figure: draws results of '{OURS}'.* add {OURS} to"):
        module.main()
    assert not picture.exists()


def test_the_tables_of_the_page_are_those_of_the_kept_parts(repository: Path) -> None:
    """Whichever version of a planner has made them: `make bench` would show old ones as dashes."""
    generator, folder = _load_generator(), repository / "benchmarks" / "planning" / "planning-full"
    found = {}
    for job in generator.list_jobs(generator.FULL, True):
        path = folder / f"{job.scenario}-{job.what}.json"
        if path.is_file():
            found[job] = json.loads(path.read_text(encoding="utf-8"))["found"]
    text = (repository / "docs" / "papers" / "caballero-2018.md").read_text(encoding="utf-8")
    assert len(found) > 50 and generator.build_page(text, found, generator.FULL) == text
