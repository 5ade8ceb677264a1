"""Files of unknown origin: each is refused in one line, at once, with exit code 2."""

import os
import random
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skywright.analysis.locate.trajectory_file import load_trajectory
from skywright.cli import main
from skywright.core.bounded import DEEPEST, LARGEST_TOML, parse_json, parse_toml, read_bytes
from skywright.errors import InputError
from skywright.models.localisation.time_alignment import estimate_offset

LONGEST = 4200  # characters of what is printed


@pytest.fixture(autouse=True)
def _in_time() -> Iterator[None]:
    """A read that waits for a pipe's writer, or reads a device to its end, ends here."""
    signal.alarm(60)
    yield
    signal.alarm(0)


def refuse(*args: str) -> str:
    """Call the command; return its one line of refusal."""
    done = CliRunner().invoke(main, list(args))
    said = (done.stderr or done.output).strip()
    assert done.exit_code == 2, (args, done.exit_code, said[:500])
    assert "internal error" not in said and len(said.splitlines()) == 1, (args, said[:500])
    assert len(said) < LONGEST
    return said


COMMANDS = [
    ["check"], ["show"], ["plan"], ["run"], ["weld"], ["locate"], ["replay"],
    ["identify", "--robot", "othex"], ["records"], ["run", "waypoints", "--plan"],
    ["plan", "pipe-weld-scan", "--robot"], ["plan", "pipe-weld-scan", "--world"],
    ["weld", "examples/weld_data/pipe_scan.csv", "--surface"],
    ["weld", "examples/weld_data/pipe_scan.csv", "--calibration"],
    ["reproduce", "--paper"],
]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_what_is_no_file(command: list[str], tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    command = ["reproduce"] if command[0] == "reproduce" else command
    for name in ("/dev/zero", str(pipe), str(tmp_path), "n" * 5000):
        refuse(*command, name)


def test_a_device_and_a_file_are_called_so(tmp_path: Path) -> None:
    assert "/dev/zero: is a device or pipe" in refuse("identify", "--robot", "othex", "/dev/zero")
    page = tmp_path / "report.html"
    page.write_text("<p>")
    assert "is not a run directory" in refuse("report", str(page))


@pytest.mark.parametrize("suffix", [".toml", ".csv", ".ulg", ".mcap"])
def test_a_link_to_a_device(suffix: str, tmp_path: Path) -> None:
    link = tmp_path / f"x{suffix}"
    link.symlink_to("/dev/zero")
    command = {".toml": ["check"], ".csv": ["weld"], ".mcap": ["replay"]}.get(
        suffix, ["identify", "--robot", "othex"]
    )
    refuse(*command, str(link))


def test_large_and_deep_descriptions(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    large = "n" * (LARGEST_TOML - 100)
    cases = {
        f"[robot]\n{large} = 1\n": "unknown key",
        f"[{large}]\n": "valid tables",
        f'[robot]\nextends = "{large}"\n': "unknown robot",
        f"[robot]\n{large}n{'n' * 100} = 1\n": "larger than 5 MB",
        "[robot" + ".a" * 10_000 + "]\n": "nested too deeply",
        "[robot]\nx = " + "[" * 100_000 + "]" * 100_000 + "\n": "nested too deeply",
        "[robot]\nx = " + "{a = " * (DEEPEST + 1) + "1" + "}" * (DEEPEST + 1): "nested too deeply",
    }
    for text, said in cases.items():
        path.write_text(text)
        if said == "unknown key":
            text = CliRunner().invoke(main, ["check", str(path)]).output
            assert "n" * 50 in text and "internal" not in text
        else:
            assert said in refuse("show", str(path)), said
    for i in range(60):
        extends = f'extends = "{i + 1}.toml"\n' if i < 59 else ""
        (tmp_path / f"{i}.toml").write_text(f'[robot]\nname = "r"\n{extends}')
    assert "is longer than 16 files" in refuse("show", str(tmp_path / "0.toml"))
    (tmp_path / "59.toml").write_text('[robot]\nextends = "58.toml"\n')
    assert "is circular" in refuse("show", str(tmp_path / "57.toml"))


def test_depth_and_size() -> None:
    assert parse_toml("a = " + "[" * 5 + "]" * 5, "x") == {"a": [[[[[]]]]]}
    for text in ("[" * 100, "[" * 100_000):
        with pytest.raises(InputError, match="x: malformed JSON"):
            parse_json(text + "]" * len(text), "x")
    with pytest.raises(InputError, match=r"larger than 0\.001 MB; cut it"):
        read_bytes(Path(__file__), 1000, "cut it")


def test_times_that_no_recording_has(tmp_path: Path) -> None:
    """A time of 1e22 s made a grid of 146 TB; a clock that jumps by years one of 30 GB."""
    t = np.arange(0.0, 60.0, 0.1)
    p = np.column_stack([np.sin(t), np.cos(0.7 * t), 0 * t])

    def write(t: np.ndarray) -> str:
        path = tmp_path / "a.csv"
        rows = [",".join(map(repr, row)) for row in np.column_stack([t, p]).tolist()]
        path.write_text("t_s,x_m,y_m,z_m\n" + "\n".join(rows))
        return str(path)

    good = load_trajectory(write(t))
    one = t.copy()
    one[300] = 1e22
    found = load_trajectory(write(one))
    assert len(found.t) == len(t) - 1 and estimate_offset(good, found).offset < 1e-6
    with pytest.raises(InputError, match=r"span 1e\+09 s .* at most 100000 s"):
        load_trajectory(write(np.where(t > 30, t + 1e9, t)))


BAD = ("nan", "inf", "-inf", "1e300", "-1e300", "1e22", "1e155", "1e-320", "", "x", "9" * 400)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("command", ["weld", "locate"])
def test_damaged_tables(command: str, seed: int, tmp_path: Path) -> None:
    """Truncated, reversed, repeated, rescaled, emptied, binary: refused, or read with a note."""
    rng = random.Random(seed)
    t = np.arange(0.0, 40.0, 0.1)
    around = np.column_stack([np.sin(t), np.cos(0.6 * t), 0.1 * t])
    station = [[repr(x) for x in row] for row in np.column_stack([t, around]).tolist()]
    names = "t_s,x_m,y_m,z_m"
    if command == "weld":
        names, station = "t_s,x_m,y_m,z_m,re,im", [[*row, row[1], row[2]] for row in station]
    (tmp_path / "camera.csv").write_text(
        names + "\n" + "\n".join(",".join(map(repr, r)) for r in np.column_stack([t, around]))
    )
    for _ in range(12):
        rows = [list(row) for row in station]
        c = rng.randrange(len(rows[0]))
        kind = rng.choice(["cut", "cell", "column", "same", "reverse", "scale", "binary", "jump"])
        if kind == "cell":
            for _ in range(rng.choice([1, 5, 300])):
                rows[rng.randrange(len(rows))][c] = rng.choice(BAD)
        elif kind == "column":
            rows = [[*row[:c], rng.choice(BAD), *row[c + 1 :]] for row in rows]
        elif kind == "same":
            rows = [[*row[:c], rows[0][c], *row[c + 1 :]] for row in rows]
        elif kind == "reverse":
            rows.reverse()
        elif kind == "scale":
            factor = rng.choice([1e-30, 1e3, 1e9, 1e150, -1, 0])
            rows = [[*row[:c], repr(float(row[c]) * factor), *row[c + 1 :]] for row in rows]
        elif kind == "jump":
            rows[200:] = [[repr(float(row[0]) + 1e6), *row[1:]] for row in rows[200:]]
        data = bytearray("\n".join([names, *(",".join(row) for row in rows)]).encode())
        if kind == "cut":
            data = data[: rng.randrange(len(data))]
        if kind == "binary":
            for _ in range(rng.choice([1, 500])):
                data[rng.randrange(len(data))] = rng.randrange(256)
        path = tmp_path / "station.csv"
        path.write_bytes(data)
        more = (
            ["--camera", str(tmp_path / "camera.csv"), "--station"] if command == "locate" else []
        )
        done = CliRunner().invoke(main, [command, *more, str(path), "--json"])
        said = done.output + (done.stderr or "")
        assert done.exit_code in (0, 2) and "internal error" not in said, (kind, said[-500:])
