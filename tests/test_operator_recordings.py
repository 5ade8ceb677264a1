"""Recordings of an operator's stick: written, read back, cut anywhere, wrong; refused operators."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st

import skywright.missions.tool_install
from skywright import cli
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.ground.operator_model import MANNERS
from skywright.run import operator as operator_file
from skywright.run.operator import (
    COLUMNS,
    GAP_MAX,
    Recording,
    Sight,
    Stick,
    list_recordings,
    load_recording,
    write_recording,
)
from skywright.vehicle.plant import MISSION_TICK

AXIS = st.floats(-1.0, 1.0)
NOWHERE = Sight(np.zeros(3), False)
HEADER = ",".join(COLUMNS)


def call(*args: str) -> Result:
    return CliRunner().invoke(cli.main, list(args))


def find_error(result: Result) -> str:
    """The one line that tells it; on a fresh machine another says that compiling takes a while."""
    lines = [x for x in result.stderr.splitlines() if not x.startswith("compiling")]
    assert len(lines) == 1 and lines[0].startswith("skywright: ")
    return lines[0]


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(AXIS, AXIS, AXIS, st.booleans()), min_size=2, max_size=30))
def test_a_recording_is_read_as_it_was_written(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float, float, bool]]
) -> None:
    path = tmp_path_factory.mktemp("r") / "a.csv"
    sticks = [(k * MISSION_TICK, Stick(np.array(r[:3]), r[3])) for k, r in enumerate(rows)]
    write_recording(path, sticks, 0.03)
    found = load_recording(path)
    assert found.v_max == 0.03
    for k, (t, stick) in enumerate(sticks):
        again = found.read(t, NOWHERE)
        assert again is not None and again.button == stick.button
        assert again.axes.tobytes() == (stick.axes + 0.0).tobytes() or np.all(
            again.axes == rows[k][:3]
        )
    assert found.read(sticks[-1][0] + MISSION_TICK, NOWHERE) is None
    assert sorted(p.name for p in path.parent.iterdir()) == ["a.csv"]


def test_between_rows_the_stick_stays() -> None:
    t = np.array([0.0, 0.3, 0.5])
    r = Recording(t, np.array([[0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]]), t > 0.4, None)
    values = [r.read(x, NOWHERE) for x in (0.0, 0.29, 0.3, 0.49, 0.5)]
    assert [float(s.axes[0]) for s in values if s is not None] == [0.1, 0.1, 0.2, 0.2, 0.3]
    assert r.read(0.52, NOWHERE) is None


def test_a_piece_of_work_to_which_nobody_came_has_no_rows(tmp_path: Path) -> None:
    """It began where the next one begins; what is written can be flown again."""
    file = tmp_path / "operator.csv"
    rows = [(k * MISSION_TICK, Stick(np.zeros(3), False)) for k in range(5)]
    write_recording(file, rows, 0.03, [0.0, 0.0])
    r = load_recording(file)
    r.begin(0, 0.0)
    assert r.read(0.0, NOWHERE) is None
    r.begin(1, 0.0)
    assert r.read(0.0, NOWHERE) is not None and r.read(rows[-1][0], NOWHERE) is not None


def test_each_piece_of_work_has_its_own_rows() -> None:
    """However long the one before it lasts; a button at its end stays pressed."""
    t = np.arange(10) * MISSION_TICK
    axes = np.linspace(0.0, 0.9, 30).reshape(10, 3)
    r = Recording(t, axes, t > 8.5 * MISSION_TICK, None, [0.0, 4 * MISSION_TICK])
    for late in (0, 7):  # ticks that the first piece lasts longer
        r.begin(0, 0.0)
        first = [r.read(k * MISSION_TICK, NOWHERE) for k in range(5)]
        assert first[4] is None and first[3] is not None and first[3].axes[0] == axes[3, 0]
        begun = (4 + late) * MISSION_TICK
        r.begin(1, begun)
        again = [r.read(begun + k * MISSION_TICK, NOWHERE) for k in range(7)]
        assert [float(x.axes[0]) for x in again if x is not None] == list(axes[4:, 0])
    r.begin(2, 1.0)
    assert r.read(1.0, NOWHERE) is None


def test_a_recording_cut_anywhere_is_refused_or_a_beginning(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    sticks = [(0.02 * k, Stick(rng.uniform(-1, 1, 3).round(3), k == 9)) for k in range(10)]
    whole, cut = tmp_path / "whole.csv", tmp_path / "cut.csv"
    write_recording(whole, sticks, 0.03)
    data, full = whole.read_bytes(), load_recording(whole)
    for size in range(len(data)):
        cut.write_bytes(data[:size])
        try:
            found = load_recording(cut)
        except InputError:
            continue
        n = len(found.t)
        assert np.all(found.axes == full.axes[:n]) and np.all(found.button == full.button[:n])


BAD = {
    "empty": ("", "empty"),
    "comments only": ("# nothing\n\n", "empty"),
    "no column": ("t_s,dx,dy,dz\n0,0,0,0\n", "column button is missing"),
    "another column": (f"{HEADER},rz\n0,0,0,0,0,0\n", "unknown column 'rz'"),
    "twice": (f"{HEADER},dx\n0,0,0,0,0,0\n", "twice"),
    "one row": (f"{HEADER}\n0,0,0,0,0\n", "1 rows of numbers"),
    "text": (f"{HEADER}\n0,0,0,0,0\n0.1,left,0,0,0\n", "line 3, dx is 'left'"),
    "nan": (f"{HEADER}\n0,0,0,0,0\n0.1,0,nan,0,0\n", "line 3, dy is 'nan'"),
    "too far": (f"{HEADER}\n0,0,0,0,0\n0.1,0,0,1.01,0\n", "line 3, dz is '1.01'"),
    "half pressed": (f"{HEADER}\n0,0,0,0,0.5\n", "button is '0.5'; valid: 0 or 1"),
    "backwards": (f"{HEADER}\n0,0,0,0,0\n0.2,0,0,0,0\n0.1,0,0,0,0\n", "line 4, t_s is 0.1"),
    "gap": (f"{HEADER}\n0,0,0,0,0\n3,0,0,0,0\n", f"no more than {GAP_MAX:g} s"),
    "late": (f"{HEADER}\n5,0,0,0,0\n5.1,0,0,0,0\n", "must begin at 0"),
    "endless": (f"{HEADER}\n0,0,0,0,0\ninf,0,0,0,0\n", "t_s is 'inf'; valid: 0 or more"),
    "before": (f"{HEADER}\n-0.1,0,0,0,0\n0,0,0,0,0\n", "t_s is '-0.1'; valid: 0 or more"),
    "cut off": (f"{HEADER}\n0,0,0,0,0\n0.1,0,0\n", "line 3 has 3 values"),
    "speed": (f"# v_max_mps = fast\n{HEADER}\n0,0,0,0,0\n0.1,0,0,0,0\n", "v_max_mps is 'fast'"),
    "unit": (f"# v_max_mps = 3 cm/s\n{HEADER}\n0,0,0,0,0\n0.1,0,0,0,0\n", "v_max_mps is '3 cm/s'"),
    "starts back": (f"# starts_s = 0, 0.1, 0\n{HEADER}\n0,0,0,0,0\n0.1,0,0,0,0\n", "in order"),
    "starts": (f"# starts_s = 0, 9\n{HEADER}\n0,0,0,0,0\n0.1,0,0,0,0\n", "starts_s is 0, 9"),
    "another speed": (
        f"# v_max_mps = 0.1\n{HEADER}\n0,0,0,0,0\n0.1,0,0,0,0\n",
        "recorded with v_max_mps",
    ),
    "bytes": (b"\x00\xff\x13" * 99, "not a text file"),
    "null": (f"{HEADER}\n0,0,0,\0,0\n", "not a text file"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_recording_is_refused_before_take_off(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    content, message = BAD[name]
    raw = content if isinstance(content, bytes) else content.encode()
    Path("bad.csv").write_bytes(raw)
    result = call("run", "tool-install", "--set", "mission.task.operator=bad.csv")
    assert result.exit_code == 2, result.output
    line = find_error(result)
    assert "bad.csv" in line and message in line
    assert [p.name for p in tmp_path.iterdir()] == ["bad.csv"]


def test_a_recording_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_file, "MAX_BYTES", 100)
    path = tmp_path / "large.csv"
    path.write_text(f"{HEADER}\n" + "0,0,0,0,0\n" * 100)
    with pytest.raises(InputError, match="larger than"):
        load_recording(path)


def test_a_recording_of_a_long_flight_with_many_contacts_is_read_again(tmp_path: Path) -> None:
    rows = [(0.1 * k, Stick(np.full(3, 0.25), k % 2 == 0)) for k in range(20_000)]
    starts = [10.0 * k for k in range(200)]
    write_recording(tmp_path / "long.csv", rows, 0.03, starts)
    found = load_recording(tmp_path / "long.csv")
    assert found.t[-1] == rows[-1][0] and found.starts == starts and found.v_max == 0.03


TOOL_INSTALL = Path(skywright.missions.tool_install.__file__).parent


def test_the_packaged_recordings_are_found_by_name() -> None:
    assert list_recordings(TOOL_INSTALL) == ["careful", "hasty"]
    assert set(MANNERS) >= {"careful", "hasty"}
    for name in list_recordings(TOOL_INSTALL):
        d = load_description("tool-install", sets={"mission.task.operator": name})
        found = load_recording(Path(d.mission.task.operator))
        assert found.button[-1] and not found.button[0]
        assert found.v_max == d.mission.task.stick_speed_mps


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["tool-install", "--set", "mission.task.operator=nobody"], "packaged: careful, hasty"),
        (["tool-install", "--operator", "ghost"], "valid: view, udp:PORT"),
        (["tool-install", "--operator", "udp:99999"], "valid: udp:PORT"),
        (["tool-install", "--operator", "udp:0.0.0.0:0"], "requires a key"),
        (["tool-install", "--operator", f"udp:{'ä' * 80}:99"], "the host has no address"),
        (["waypoints", "--gateway", "tcp:1"], "valid: udp:PORT"),
        (["waypoints", "--gateway-key", "key"], "requires --gateway"),
        (["waypoints", "--gateway", "udp:0", "--gateway-key", "none"], "none: cannot be read"),
        (["tool-install", "--gateway", "udp:0", "--operator", "udp:0"], "the second one only"),
        (
            ["waypoints", "--operator", "view"],
            "kinds with an operator: bar-insertion, bridge-contact, sensor-install",
        ),
        (
            ["tool-install", "--operator", "view", "--set", "mission.task.operator=careful"],
            "give only one of the two",
        ),
    ],
)
def test_wrong_operators_are_input_errors(
    args: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = call("run", *args)
    assert result.exit_code == 2, result.output
    assert message in find_error(result)
    assert not list(tmp_path.iterdir())
