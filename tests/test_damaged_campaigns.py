"""Folders of campaigns and runs that somebody damaged: one line, exit code 2, nothing changed."""

from __future__ import annotations

import json
import os
import random
import signal
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

from skywright.analysis.campaign.store import IDENTITY, JOURNAL, Store, encode_row
from skywright.cli import main
from skywright.errors import InputError
from skywright.run.directory import load_run
from skywright.run.rows import Row

CAMPAIGN: dict[str, Any] = {"mission": "waypoints", "runs": 3, "seed": 1, "versions": {"a": "1"}}
BAD = [
    None, True, -1, 1.5, 10**400, float("nan"), float("inf"), -1e300, "text", "", [], {}, [1],
    {"a": 1}, [[[]]], "9" * 400, "n" * 3_000_000,
]  # fmt: skip
FILES = ("metrics.json", "mission.toml", "recording.mcap")


@pytest.fixture(autouse=True)
def _in_time() -> Iterator[None]:
    signal.alarm(400)  # a pipe without a writer would wait for ever
    yield
    signal.alarm(0)


def row(run: int) -> Row:
    return Row(
        run, run + 1, "failed", "a.b", ("a.b",), "why", {"world.wind.mean_mps": 1.5, "robot": "x"},
        {"a.b": 1.0, "c.d": float("nan")}, {"wall_s": 2.0}, 1, "skywright run", {"flaws": []},
    )  # fmt: skip


def fill(folder: Path, rows: list[Any] | None = None) -> Path:
    """Write a campaign of three finished runs."""
    folder.mkdir()
    (folder / IDENTITY).write_text(json.dumps(CAMPAIGN))
    kept = [encode_row(row(i)) for i in range(3)] if rows is None else rows
    (folder / JOURNAL).write_text("".join(json.dumps(x) + "\n" for x in kept))
    return folder


def list_rows(folder: Path) -> list[Row] | str:
    """Open the campaign; return its rows, or why it is refused."""
    try:
        store = Store(folder, CAMPAIGN)
    except InputError as error:
        return str(error)
    store.close()
    return list(store.rows.values())


def test_a_sound_folder_is_read_back(tmp_path: Path) -> None:
    found = list_rows(fill(tmp_path / "c"))
    assert [x.run for x in found if isinstance(x, Row)] == [0, 1, 2]
    assert repr(found[0]) == repr(row(0))  # NaN equals itself here only


@pytest.mark.parametrize("name", Row._fields)
def test_a_value_of_a_row_of_another_type_is_refused(name: str, tmp_path: Path) -> None:
    good = encode_row(row(1))
    for i, value in enumerate(BAD):
        folder = fill(tmp_path / str(i), [encode_row(row(0)), {**good, name: value}])
        before = (folder / JOURNAL).stat().st_size
        found = list_rows(folder)
        if isinstance(found, str):
            assert f"{JOURNAL}, line 2: is damaged" in found and "remove the line" in found
            assert name in found and len(found) < 600
        else:  # every value that passes is of the type that Row states
            kept = getattr(found[1], name)
            assert isinstance(kept, type(getattr(row(1), name)) | None), (name, value)
        assert (folder / JOURNAL).stat().st_size == before
    for inner in set(good) & {"metrics", "timing", "varied"}:
        for value in ("x", [], 10**400) if inner == name != "varied" else ():
            folder = fill(tmp_path / f"{inner}-{value!s:.3}", [{**good, inner: {"k": value}}])
            assert f"{inner}.k: found" in str(list_rows(folder))


@pytest.mark.parametrize("seed", range(30))
def test_bytes_of_a_campaign_at_random(seed: int, tmp_path: Path) -> None:
    rng = random.Random(seed)
    folder = fill(tmp_path / "c")
    file = folder / rng.choice([IDENTITY, JOURNAL])
    data = bytearray(file.read_bytes())
    kind = seed % 3
    if kind == 0:
        data = data[: rng.randrange(len(data))]
    elif kind == 1:
        for _ in range(rng.randrange(1, 30)):
            data[rng.randrange(len(data))] = rng.randrange(256)
    else:
        at = rng.randrange(len(data))
        data[at:at] = rng.choice(
            [b"[" * 100_000, b"9" * 5000, b"\x00" * 50, b"\xff\xfe", b"\n{}\n"]
        )
    file.write_bytes(data)
    found = list_rows(folder)
    assert sorted(p.name for p in folder.iterdir()) == [IDENTITY, JOURNAL]
    if isinstance(found, str):
        assert len(found.splitlines()) == 1 and str(folder) in found
        assert file.read_bytes() == data or file.name == JOURNAL
    else:
        whole = [row(i) for i in range(3)]
        assert file.name == JOURNAL and len(found) <= 3
        assert kind == 1 or all(repr(x) == repr(whole[x.run]) for x in found)


def make_fifo(path: Path) -> None:
    os.mkfifo(path)


def make_loop(path: Path) -> None:
    path.symlink_to(path.name)


def make_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_folder(path: Path) -> None:
    path.mkdir()


ODD = [make_fifo, make_loop, make_device, make_folder]


@pytest.mark.parametrize("make", ODD)
@pytest.mark.parametrize("name", [IDENTITY, JOURNAL])
def test_what_is_no_file_in_a_campaign(
    name: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    folder = fill(tmp_path / "c")
    (folder / name).unlink()
    make(folder / name)
    found = list_rows(folder)
    assert isinstance(found, str) and str(folder) in found and len(found.splitlines()) == 1
    assert sorted(p.name for p in folder.iterdir()) == [IDENTITY, JOURNAL]


def test_the_command_refuses_another_folder(tmp_path: Path) -> None:
    folder = fill(tmp_path / "c")
    (folder / IDENTITY).write_text(json.dumps({**CAMPAIGN, "runs": "n" * 4_000_000}))
    for out in (folder, tmp_path / "loop"):
        if out.name == "loop":
            make_loop(out)
        done = CliRunner().invoke(main, ["campaign", "waypoints", "--runs", "1", "--out", str(out)])
        said = done.stderr.strip()
        assert done.exit_code == 2 and len(said.splitlines()) == 1 and len(said) < 4200
    assert sorted(p.name for p in folder.iterdir()) == [IDENTITY, JOURNAL]


COMMANDS = [
    ["report"], ["replay", "--no-open"], ["weld"], ["export", "--format", "csv", "--out", "OUT"],
    ["compare", "runs", "--out", "OUT"],
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: c[0])
def test_what_is_no_file_in_a_run(command: list[str], tmp_path: Path) -> None:
    """Each of a run's files as a pipe, a loop, a device, a folder, text that never ends."""
    tracemalloc.start()
    for k, (name, make) in enumerate((n, m) for n in FILES for m in ODD):
        folder, out = tmp_path / str(k), tmp_path / "out"
        folder.mkdir()
        for other in FILES:
            (folder / other).write_text("{}")
        (folder / name).unlink()
        make(folder / name)
        args = [str(out) if a == "OUT" else a for a in command]
        runs = [str(folder)] * (2 if command[0] == "compare" else 1)
        done = CliRunner().invoke(main, [*args, *runs])
        said = (done.stderr or done.output).strip()
        assert done.exit_code == 2, (command, name, make.__name__, said[:300])
        assert len(said.splitlines()) == 1 and "internal error" not in said and len(said) < 4200
        assert not out.exists() and sorted(p.name for p in folder.iterdir()) == sorted(FILES)
    assert tracemalloc.get_traced_memory()[1] < 300e6
    tracemalloc.stop()


@pytest.mark.parametrize("name", ["phases", "timing", "outcome", "reason", "faults"])
def test_metrics_of_a_run_are_read_by_their_type(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    phase = {"name": "hover", "start_s": 0.0, "end_s": 1.0, "outcome": "done"}
    good: dict[str, Any] = {
        "phases": [phase], "timing": {"wall_s": 1.0}, "outcome": "failed", "reason": "",
        "faults": [],
    }  # fmt: skip
    for file in FILES:
        (tmp_path / file).write_text("")
    whole = SimpleNamespace(samples=[], events=[], complete=True)
    monkeypatch.setattr("skywright.run.directory.read_recording", lambda _: whole)

    def load(value: dict[str, Any]) -> Any:
        (tmp_path / "metrics.json").write_text(json.dumps(value))
        return load_run(tmp_path)

    assert load(good).phases[0].end_s == 1.0
    wrong = [x for x in BAD if not isinstance(x, type(good[name])) or (name == "faults" and x)]
    nested: list[Any] = [{**good, name: value} for value in wrong]
    nested += [{**good, "phases": [{**phase, key: x}]} for key in phase for x in ([], {}, None)]
    nested += [{**good, "phases": [{**phase, "end_s": x}]} for x in ("1", 10**400, float("nan"))]
    for value in nested:
        with pytest.raises(InputError, match=r"metrics\.json: is damaged") as told:
            load(value)
        assert len(str(told.value)) < 600 + len(str(tmp_path))
