"""Commands on damaged runs: a result or one message, and nothing written by halves."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import skywright
from skywright.cli import main

FILES = ("recording.mcap", "metrics.json", "mission.toml")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    point = [{"x_m": 0.2, "y_m": 0.0, "z_m": 1.2, "hold_s": 0.1}]
    folder = tmp_path_factory.mktemp("runs") / "one"
    d = skywright.load("waypoints", sets={"mission.task.points": point})
    skywright.run(d, out=folder, report=False)
    return folder


def replace_key(rng: np.random.Generator, value: Any) -> Any:
    """Return a JSON value in which one entry is something else, or gone."""
    if isinstance(value, dict) and value:
        key = str(rng.choice(list(value)))
        kind = int(rng.integers(5))
        if kind == 0:
            return {k: v for k, v in value.items() if k != key}
        if kind == 1:
            return value | {key: replace_key(rng, value[key])}
        return value | {key: [None, "text", -1e300, [], {}][int(rng.integers(5))]}
    return [None, "text", -1e300, [], {}][int(rng.integers(5))]


def damage(rng: np.random.Generator, folder: Path) -> str:
    """Damage one file of a run; return what was done."""
    file = folder / FILES[int(rng.integers(len(FILES)))]
    data = file.read_bytes()
    kind = int(rng.integers(5))
    if kind == 0:
        file.write_bytes(data[: int(rng.integers(len(data)))])
        return f"{file.name} truncated"
    if kind == 1:
        file.unlink()
        return f"{file.name} removed"
    if kind == 2 and file.suffix == ".json":
        file.write_text(json.dumps(replace_key(rng, json.loads(data))))
        return f"{file.name}: a key replaced"
    if kind == 3:
        at = int(rng.integers(len(data)))
        file.write_bytes(data[:at] + rng.bytes(int(rng.integers(1, 200))) + data[at:])
        return f"{file.name}: bytes inserted at {at}"
    changed = bytearray(data)
    for at in rng.integers(0, len(data), int(rng.integers(1, 30))):
        changed[at] = int(rng.integers(256))
    file.write_bytes(bytes(changed))
    return f"{file.name}: bytes changed"


def list_commands(folder: Path, whole: Path, out: Path) -> list[list[str]]:
    x = str(folder)
    return [
        ["export", x, "--format", "csv", "--out", str(out)],
        ["compare", "runs", x, str(whole), "--out", str(out)],
        ["report", x],
        ["weld", x],
        ["identify", x, "--robot", "hexarotor", "--out", str(out)],
        ["replay", x, "--no-open"],
    ]


@pytest.mark.parametrize("seed", range(24))
def test_a_damaged_run_is_read_or_refused_in_one_message(
    run: Path, tmp_path: Path, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    folder, out = tmp_path / "run", tmp_path / "out"
    shutil.copytree(run, folder)
    what = damage(rng, folder)
    commands = list_commands(folder, run, out)
    command = commands[seed % len(commands)]
    before = sorted(p.name for p in folder.iterdir())
    found = CliRunner().invoke(main, command)
    told = f"{what}: {' '.join(command[:2])}: {found.output[-500:]}"
    assert found.exception is None or isinstance(found.exception, SystemExit), told
    assert found.exit_code in ((0, 1, 2) if command[0] == "report" else (0, 2)), told
    assert "Traceback" not in found.output
    assert not list(tmp_path.rglob("*.partial")) and not list(tmp_path.rglob("*.tmp")), told
    if found.exit_code == 2:
        assert found.stderr.strip() and len(found.stderr.strip().splitlines()) <= 4, told
        assert not out.exists() and sorted(p.name for p in folder.iterdir()) == before, told
