"""Campaigns end to end: rows that repeat, resumption, dead workers, bad folders, Ray."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

import skywright
from exact_map import EXACT
from skywright.analysis.campaign import campaign as campaign_module
from skywright.analysis.campaign import runner
from skywright.analysis.campaign.campaign import choose_folder, run_campaign
from skywright.analysis.campaign.local import choose_workers, count_cores
from skywright.analysis.campaign.runner import TIMING_METRICS, Task, fly_row
from skywright.analysis.campaign.spec import (
    Campaign,
    build_campaign,
    build_identity,
    draw_run,
    load_run,
)
from skywright.analysis.campaign.store import Store, decode_row, encode_row
from skywright.errors import InputError
from skywright.recordings.writer import RecordingWriter
from skywright.run.rows import Row
from skywright.run.run import fly_and_evaluate

MISSION = """
[mission]
name = "hop"
kind = "waypoints"
robot = "hexarotor"
world = "open"
hover_height_m = 0.6
timestep_ms = 2

[[mission.task.points]]
x_m = 0.3
y_m = 0.0
z_m = 0.6
hold_s = 0.5

[mission.requirements]
"position.rms_m" = { limit = 0.16 }
"position.final_error_m" = { limit = 0.3, unit = "m" }

[world.wind]
kind = "steady"
"""

KILLER = """
import os
import signal
from pathlib import Path

from skywright.core.record import Record
from skywright.vehicle.bus import WrenchCommand
from skywright.vehicle.component import Law, Out

MARK = Path(__file__).with_suffix(".killed")


class Killer(Law):
    class Me(Record):
        none: float

    def build(self, me, table, context):
        if not MARK.exists():
            MARK.touch()
            os.kill(os.getpid(), signal.SIGKILL)

    @staticmethod
    def step(me: Me, cmd: Out[WrenchCommand]) -> None:
        cmd.f_B[2] = float("nan")
"""

VARY = (
    "world.wind.mean_mps=uniform(0,4)",
    "plant.mass_error=normal(0,0.02)",
    "world.mocap.rate_hz=choice(50,100)",
)


@pytest.fixture
def hop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A short mission in a folder of its own, which is the working folder."""
    (tmp_path / "hop.toml").write_text(MISSION)
    (tmp_path / "killer.py").write_text(KILLER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def build(*vary: str, seed: int = 3, sets: tuple[str, ...] = ()) -> Campaign:
    return build_campaign("hop.toml", vary or VARY, seed=seed, sets=sets)


def strip(rows: list[Row]) -> list[Row]:
    """Rows without what depends on the machine's speed and luck; NaN equal to itself."""
    return [decode_row(encode_row(row._replace(timing={}, attempts=1))) for row in rows]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Row]]:
    """The folder and rows of one finished campaign of six runs."""
    folder = tmp_path_factory.mktemp("flown")
    (folder / "hop.toml").write_text(MISSION)
    before = Path.cwd()
    os.chdir(folder)
    try:
        result = run_campaign(build(), 6, out=Path("c"), parquet=True)
    finally:
        os.chdir(before)
    return folder, result.rows


def test_rows_are_complete_and_differ(flown: tuple[Path, list[Row]]) -> None:
    folder, rows = flown
    assert [row.run for row in rows] == list(range(6))
    assert (
        len({row.seed for row in rows}) == len({row.metrics["position.rms_m"] for row in rows}) == 6
    )
    assert {row.outcome for row in rows} <= {"succeeded", "failed"}
    for row in rows:
        assert row.succeeded == (not row.failed) == (row.requirement == "")
        assert 0 <= row.varied["world.wind.mean_mps"] <= 4
        assert all(math.isfinite(v) for v in row.metrics.values())
    assert {p.name for p in (folder / "c").iterdir()} == {
        "campaign.json", "campaign.html", "results.csv", "results.parquet", "runs.jsonl",
    }  # fmt: skip


def test_parquet_holds_every_row(flown: tuple[Path, list[Row]]) -> None:
    import pyarrow.parquet

    folder, rows = flown
    table = pyarrow.parquet.read_table(folder / "c" / "results.parquet")
    cells = table.to_pylist()
    for row, cell in zip(rows, cells, strict=True):
        assert (cell["run"], cell["seed"], cell["outcome"]) == (row.run, row.seed, row.outcome)
        assert all(cell[k] == v for k, v in {**row.varied, **row.metrics}.items())
        assert cell["failed"] == list(row.failed) and cell["command"] == row.command
    identity = json.loads(table.schema.metadata[b"skywright.campaign"])
    assert identity == json.loads((folder / "c" / "campaign.json").read_text())


def test_csv_holds_every_row(flown: tuple[Path, list[Row]]) -> None:
    folder, rows = flown
    with (folder / "c" / "results.csv").open(newline="") as file:
        cells = list(csv.DictReader(file))
    for row, cell in zip(rows, cells, strict=True):
        assert (int(cell["run"]), int(cell["seed"])) == (row.run, row.seed)
        assert (cell["outcome"], cell["command"]) == (row.outcome, row.command)
        assert all(float(cell[k]) == v for k, v in {**row.varied, **row.metrics}.items())
        assert cell["failed"].split() == list(row.failed)


def test_parquet_without_its_extra_is_refused_before_anything_flies(
    flown: tuple[Path, list[Row]], hop: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)  # as if it were not installed
    with pytest.raises(InputError, match=r"skywright\[parquet\]"):
        run_campaign(build(), 1, out=Path("c"), parquet=True)
    assert not Path("c").exists()
    rows = run_campaign(build(), 1, out=Path("c"), workers=1).rows
    assert Path("c/results.csv").is_file() and not Path("c/results.parquet").exists()
    assert strip(rows) == strip(flown[1][:1])


def test_a_row_repeats_alone_bit_for_bit(
    flown: tuple[Path, list[Row]], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, rows = flown
    monkeypatch.chdir(folder)
    words = shlex.split(rows[4].command)
    sets = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
    description = skywright.load(words[2], sets=sets, seed=int(words[words.index("--seed") + 1]))
    alone = skywright.run(description, out="alone", report=False)
    metrics = {k: v for k, v in alone.metrics.items() if k != "plan.wall_s"}
    assert metrics == rows[4].metrics  # exactly
    assert alone.outcome == rows[4].outcome


def test_a_scan_flown_by_a_worker_repeats_here(hop: Path) -> None:
    """The probe's table and the weld's statistics sum much: threads of BLAS must not show."""
    vary = ["world.pipe.friction=uniform(0.1,0.3)"]
    short = [*EXACT, "mission.task.passes=2", "mission.task.pass_length_m=0.1",
             "mission.timestep_ms=2"]  # fmt: skip
    campaign = build_campaign("pipe-weld-scan", vary, sets=short)
    (row,) = run_campaign(campaign, 1, out=Path("c")).rows
    with threadpool_limits(limits=2, user_api="blas"):  # as outside these tests
        alone = fly_and_evaluate(load_run(campaign, draw_run(campaign, 0)))
    metrics = {k: v for k, v in alone.metrics.items() if k not in TIMING_METRICS}
    assert row.metrics == pytest.approx(metrics, rel=0, abs=0, nan_ok=True)
    assert "weld.offset_std_mm" in row.metrics


def test_a_campaign_goes_on_where_it_was_and_may_grow(
    flown: tuple[Path, list[Row]], hop: Path
) -> None:
    rows = flown[1]
    first = run_campaign(build(), 3, out=Path("c"), workers=1)
    journal = Path("c/runs.jsonl")
    kept = journal.read_bytes()
    with journal.open("ab") as file:  # the machine went down while a row was written
        file.write(b'{"run": 3, "seed": 12')
    grown = run_campaign(build(), 6, out=Path("c"))
    assert journal.read_bytes().startswith(kept)
    assert strip(grown.rows) == strip(rows)
    assert strip(first.rows) == strip(rows[:3])
    kept = journal.read_bytes()
    again = run_campaign(build(), 6, out=Path("c"))
    assert again.rows == grown.rows and journal.read_bytes() == kept  # nothing was flown
    smaller = run_campaign(build(), 2, out=Path("c"))  # nothing that was flown is lost
    assert smaller.rows == grown.rows and smaller.to_json()["runs"] == 6
    page = Path("c/campaign.html").read_text()
    assert "6 runs, 0 of them in" in page and "Interrupted" not in page


def test_an_interrupted_campaign_loses_only_runs_in_flight(
    flown: tuple[Path, list[Row]], hop: Path
) -> None:
    command = [sys.executable, "-m", "skywright", "campaign", "hop.toml", "--runs", "40"]
    command += ["--seed", "3", "--out", "c", *(w for v in VARY for w in ("--vary", v))]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    journal = Path("c/runs.jsonl")
    deadline = time.monotonic() + 300  # a busy machine, or code to compile
    while not (journal.exists() and journal.read_bytes().count(b"\n") >= 3):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 1 and "interrupted after" in err, err
    assert "Traceback" not in err and "Interrupted" in Path("c/campaign.html").read_text()
    kept = journal.read_bytes()
    count = kept.count(b"\n")
    assert 3 <= count < 40
    grown = run_campaign(build(), max(6, count), out=Path("c"), workers=1)
    assert journal.read_bytes().startswith(kept)
    assert strip(grown.rows[:6]) == strip(flown[1])


# -- runs that go wrong are rows ------------------------------------------------------------------


def test_a_killed_worker_costs_nothing(hop: Path) -> None:
    """The law kills the first worker that builds it; then it diverges, which is a row, too."""
    law = "mission.law=choice('killer.py:Killer','thrust_vectoring')"
    result = run_campaign(build(law, seed=1), 6, out=Path("c"))
    assert Path("killer.killed").exists()
    assert [row.run for row in result.rows] == list(range(6))
    outcomes = {row.varied["mission.law"]: row.outcome for row in result.rows}
    assert outcomes == {"killer.py:Killer": "diverged", "thrust_vectoring": "succeeded"}
    assert sorted({row.attempts for row in result.rows}) == [1, 2]
    assert all("NaN" in row.reason for row in result.rows if row.outcome == "diverged")


def test_a_run_that_always_kills_its_worker_is_a_row(hop: Path) -> None:
    Path("killer.py").write_text(KILLER.replace("MARK.touch()", "pass"))
    result = run_campaign(build("mission.law=choice('killer.py:Killer')"), 1, out=Path("c"))
    (row,) = result.rows
    assert (row.outcome, row.attempts) == ("crashed", 3) and "SIGKILL" in row.reason
    assert result.exit_code == 1
    assert result.to_json()["failures"][0]["requirement"] == "crashed"


def test_infeasible_and_contradictory_runs_are_rows(hop: Path) -> None:
    result = run_campaign(
        build("world.wind.mean_mps=choice(1,100)", seed=2), 4, out=Path("c"), workers=1
    )
    outcomes = {row.varied["world.wind.mean_mps"]: row for row in result.rows}
    assert outcomes[100].outcome == "infeasible" and "wind of 100" in outcomes[100].reason
    assert outcomes[1].outcome == "succeeded"
    # each valid alone, not together
    vary = ("world.pipe.z_m=choice(0.3,1.5)", "world.pipe.diameter_m=choice(0.2,1.0)")
    result = run_campaign(build(*vary, seed=2), 8, out=Path("d"), workers=1)
    for row in result.rows:
        below = row.varied["world.pipe.z_m"] == 0.3 and row.varied["world.pipe.diameter_m"] == 1.0
        assert (row.outcome == "refused") == below, row
    assert any("below the ground" in row.reason for row in result.rows)


def test_asked_for_directories_are_kept(hop: Path) -> None:
    campaign = build_campaign(
        "hop.toml", ["world.wind.mean_mps=choice(0,4)"], seed=2,
        sets=["mission.requirements.position.rms_m.limit=0.15"],
    )  # fmt: skip
    result = run_campaign(campaign, 4, out=Path("c"), record="failed", workers=1)
    failed = {f"{row.run:05d}" for row in result.rows if not row.succeeded}
    kept = {p.name for p in Path("c/runs").iterdir()} if failed else set()
    assert kept == failed
    for name in kept:
        metrics = json.loads((Path("c/runs") / name / "metrics.json").read_text())
        row = result.rows[int(name)]
        assert metrics["metrics"]["position.rms_m"] == row.metrics["position.rms_m"]
        assert (Path("c/runs") / name / "recording.mcap").stat().st_size > 1000


# -- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--runs", "0"], "--runs 0: at least 1"),
        (["--runs", "-3"], "at least 1"),
        (["--runs", "3", "--workers", "0"], "valid: 1 to"),
        (["--runs", "3", "--workers", "4096"], "--ray ADDRESS"),
        (["--runs", "3", "--target", "95"], "--target 95"),
        (["--runs", "3", "--vary", "world.wind.men_mps=uniform(0,4)"], "mean_mps"),
        (["--runs", "3", "--vary", "world.wind.mean_mps=unifrom(0,4)"], "uniform(a,b)"),
        (["--runs", "3", "--vary", "nothing.csv"], "nothing.csv"),
        (["--runs", "3", "--ray", "127.0.0.1:1"], "--ray"),
        (["--runs", "3", "--out", "hop.toml"], "is a file"),
        (["--runs", "3", "--out", "."], "contains no campaign"),
        (["--runs", "3", "--set", "mission.requirements=1"], "mission.requirements"),
    ],
    ids=lambda v: " ".join(v) if isinstance(v, list) else "",
)
def test_bad_input_is_one_line_and_nothing_starts(
    hop: Path, more: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from skywright.cli import main

    with pytest.raises(SystemExit) as caught:
        main(["campaign", "hop.toml", *more])
    err = capsys.readouterr().err
    assert caught.value.code == 2
    assert err.startswith("skywright: ") and err.count("\n") == 1 and words in err, err
    assert not Path("campaigns").exists()


def test_json_is_one_object_with_the_keys_of_the_contract(
    hop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from skywright.cli import main

    with pytest.raises(SystemExit) as caught:
        main(["campaign", "hop.toml", "--runs", "2", "--workers", "1", "--json",
              "--set", "mission.requirements.position.rms_m.limit=0.001"])  # fmt: skip
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert caught.value.code == 1 and captured.err == ""
    assert list(found) == [
        "answer", "runs", "succeeded", "success_rate", "interval", "failures", "wall_s",
    ]  # fmt: skip
    assert (found["runs"], found["succeeded"], found["success_rate"]) == (2, 0, 0.0)
    assert len(found["interval"]) == 2 and 0 <= found["interval"][0] < found["interval"][1] <= 1
    assert set(found["failures"][0]) == {"run", "seed", "requirement", "varied"}
    assert found["failures"][0]["requirement"] == "position.rms_m"
    assert Path("campaigns/hop/campaign.html").is_file()


def test_the_folder_of_another_campaign_is_refused_and_left_alone(hop: Path) -> None:
    identity = build_identity(build())
    store = Store(Path("c"), identity)
    with pytest.raises(InputError, match="another process"):
        Store(Path("c"), identity)
    store.close()
    before = {p: p.read_bytes() for p in Path("c").iterdir()}
    others = {
        "its seed is 3, not 4": build(seed=4),
        "its vary is": build(VARY[0]),
        "its set is": build(sets=("world.wind.toward_deg=3",)),
    }
    for words, other in others.items():
        with pytest.raises(InputError, match=words):
            run_campaign(other, 2, out=Path("c"))
    Path("hop.toml").write_text(MISSION.replace("hold_s = 0.5", "hold_s = 0.6"))
    with pytest.raises(InputError, match="the mission's files changed"):
        run_campaign(build(), 2, out=Path("c"))
    identity["versions"] = {**identity["versions"], "mujoco": "3.0"}
    Path("c/campaign.json").write_text(json.dumps(identity))
    Path("hop.toml").write_text(MISSION)
    with pytest.raises(InputError, match="another version of Skywright"):
        run_campaign(build(), 2, out=Path("c"))
    before.pop(Path("c/campaign.json"))
    assert {p: p.read_bytes() for p in before} == before


def test_without_out_a_campaign_finds_its_own_folder(hop: Path) -> None:
    campaign = build()
    identity = build_identity(campaign)
    assert choose_folder(campaign, identity) == Path("campaigns/hop")
    Store(Path("campaigns/hop"), identity).close()
    assert choose_folder(campaign, identity) == Path("campaigns/hop")
    other = build(seed=9)
    assert choose_folder(other, build_identity(other)) == Path("campaigns/hop-2")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_ends_it_with_one_line_and_keeps_the_rows(
    flown: tuple[Path, list[Row]], hop: Path
) -> None:
    rows = flown[1]
    store = Store(Path("c"), build_identity(build()))
    for row in rows[:2]:
        store.append(row)
    store._file.close()
    store._file = Path("/dev/full").open("ab", buffering=0)  # noqa: SIM115
    with pytest.raises(InputError, match=r"No space left.*2 finished runs are kept"):
        store.append(rows[2])
    store.close()
    again = Store(Path("c"), build_identity(build()))
    assert strip(list(again.rows.values())) == strip(rows[:2])
    again.close()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_what_a_full_disk_left_in_the_buffer_does_not_hide_the_reason(
    flown: tuple[Path, list[Row]], hop: Path
) -> None:
    store = Store(Path("c"), build_identity(build()))
    store._file.close()
    store._file = Path("/dev/full").open("ab")  # noqa: SIM115
    with pytest.raises(InputError, match="No space left"):
        store.append(flown[1][0])
    store.close()  # its flush fails a second time


def test_a_run_that_cannot_be_recorded_is_no_row(
    hop: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its conditions are not to blame: it is flown again when there is room."""
    campaign = build()

    def task(folder: Path) -> Task:
        return Task(draw_run(campaign, 0), load_run(campaign, draw_run(campaign, 0)), "", "all",
                    str(folder))  # fmt: skip

    Path("file").write_text("")
    row = fly_row(task(Path("file") / "runs"))  # no folder can be made there
    assert row.outcome == "interrupted" and "cannot create" in row.reason

    def append(self: RecordingWriter, samples: object) -> None:
        with self._writing():
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(RecordingWriter, "append", append)
    row = fly_row(task(Path("runs")))
    assert row.outcome == "interrupted" and "No space left" in row.reason
    assert not list(Path("runs").iterdir())  # room for the rows of the others

    monkeypatch.setattr(campaign_module, "fly_local", lambda *args, **more: iter([row]))
    with pytest.raises(InputError, match=r"run 0 could not be recorded.*same command continues"):
        run_campaign(campaign, 1, out=Path("c"), record="all", workers=1)
    assert Path("c/runs.jsonl").read_bytes() == b""


def test_a_run_whose_evaluation_fails_is_a_failed_row(
    hop: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if no requirement failed."""
    campaign = build()
    says = "evaluation: describe of Mine is not plain JSON: Out of range float values"
    judged: Any = SimpleNamespace(
        outcome="failed", reason=says, requirements=[], metrics={}, timing={}, inspected=None
    )
    monkeypatch.setattr(runner, "fly_and_evaluate", lambda description: judged)
    draw = draw_run(campaign, 0)
    row = fly_row(Task(draw, load_run(campaign, draw), "", "none", "runs"))
    assert (row.outcome, row.requirement, row.reason) == ("failed", "evaluation", says)


def test_another_law_behind_the_same_name_is_another_campaign(hop: Path) -> None:
    law = "mission.law=choice('killer.py:Killer','thrust_vectoring')"
    Store(Path("c"), build_identity(build(law))).close()
    Path("killer.py").write_text(KILLER + "\n")
    with pytest.raises(InputError, match="the file of a control law"):
        run_campaign(build(law), 1, out=Path("c"))


def test_a_damaged_journal_is_told_with_its_line(flown: tuple[Path, list[Row]], hop: Path) -> None:
    store = Store(Path("c"), build_identity(build()))
    store.append(flown[1][0])
    store.close()
    with Path("c/runs.jsonl").open("a") as file:
        file.write('{"run": 1}\n')
    with pytest.raises(InputError, match=r"runs\.jsonl, line 2: is damaged"):
        Store(Path("c"), build_identity(build()))


def test_workers_default_to_all_cores_and_never_exceed_runs() -> None:
    assert choose_workers(None, 1000) == count_cores()
    assert choose_workers(None, 1) == 1
    with pytest.raises(InputError, match=f"valid: 1 to {count_cores()}"):
        choose_workers(count_cores() + 1, 10)


# -- Ray ------------------------------------------------------------------------------------------


def test_ray_gives_the_same_rows_and_survives_a_killed_worker(
    flown: tuple[Path, list[Row]], hop: Path
) -> None:
    """With the law varied too, every other draw stays: half of the rows must be those of before."""
    pytest.importorskip("ray", reason="Ray is not installed (extra 'cluster')")
    law = "mission.law=choice('killer.py:Killer','thrust_vectoring')"
    result = run_campaign(build(*VARY, law), 6, out=Path("c"), ray="local", workers=2)
    assert Path("killer.killed").exists()
    assert sorted({row.attempts for row in result.rows}) == [1, 2]
    same = 0
    for with_ray, local in zip(result.rows, flown[1], strict=True):
        name = with_ray.varied.pop("mission.law")
        if name == "killer.py:Killer":
            assert with_ray.outcome == "diverged" and "NaN" in with_ray.reason
            continue
        assert strip([with_ray._replace(command="")]) == strip([local._replace(command="")])
        same += 1
    assert 0 < same < 6


@pytest.mark.parametrize("address", ["127.0.0.1:1", "nowhere", "127.0.0.1:99999"])
def test_no_cluster_at_the_address_is_told_before_the_start(hop: Path, address: str) -> None:
    pytest.importorskip("ray", reason="Ray is not installed (extra 'cluster')")
    with pytest.raises(InputError, match=r"no cluster found|is not an address"):
        run_campaign(build(), 1, out=Path("c"), ray=address)
    assert not Path("c").exists()
