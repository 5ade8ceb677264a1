"""The operator at the stick: law (24), recordings and their faults, live sources, the flights."""

from __future__ import annotations

import math
import os
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st

import skywright.missions.tool_install
from skywright import cli
from skywright.core.rotations import rot_x, rot_z
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.ground.feed import Feed
from skywright.ground.gateway_operator import GatewayOperator
from skywright.ground.operator_model import (
    MANNERS,
    REMNANT,
    TREMOR,
    ModelOperator,
)
from skywright.ground.page_operator import PageOperator
from skywright.ground.person import Person
from skywright.links.pair import build_pair, say
from skywright.links.udp.client import ArmsClient
from skywright.links.udp.flight import FlightGateway, open_gateway
from skywright.missions.skills import operated
from skywright.missions.skills.hook_grip import build_grip, compute_entry
from skywright.missions.skills.operated import compute_velocity
from skywright.missions.tool_install.led_hands import explain_loss
from skywright.missions.tool_install.operated_install import FENCE
from skywright.missions.tool_install.plan import find_places
from skywright.models.things.tool import Tool
from skywright.recordings.recording import read_recording
from skywright.run import operator as operator_file
from skywright.run.operator import (
    COLUMNS,
    FILE,
    GAP_MAX,
    STILL,
    Recording,
    Sight,
    Stick,
    list_recordings,
    load_recording,
    write_recording,
)
from skywright.run.run import run_mission
from skywright.vehicle.plant import MISSION_TICK
from waiting import Clock, wait_for

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


# --- law (24) ------------------------------------------------------------------------------------


def test_a_tool_that_is_tilted_on_the_hooks_has_not_fallen_off() -> None:
    assert "tilted by 17 deg" in explain_loss(rot_x(math.radians(17.0)))
    assert "fell off" in explain_loss(rot_z(1.0))


@given(st.tuples(AXIS, AXIS, AXIS), st.floats(1e-3, 0.2))
def test_the_stick_moves_the_hands_at_its_share_of_v_max(
    axes: tuple[float, float, float], v_max: float
) -> None:
    v = compute_velocity(np.array(axes), v_max, np.zeros(3), FENCE)
    np.testing.assert_array_equal(v, v_max * np.array(axes))


@given(st.lists(st.tuples(AXIS, AXIS, AXIS), min_size=1, max_size=40))
def test_the_stick_cannot_lead_out_of_the_fence_but_back_in(
    pushes: list[tuple[float, float, float]],
) -> None:
    goal, v_max = np.zeros(3), 0.2
    for axes in pushes:
        for _ in range(50):
            goal = goal + MISSION_TICK * compute_velocity(np.array(axes), v_max, goal, FENCE)
    assert np.all(goal >= FENCE[0]) and np.all(goal <= FENCE[1])
    outside = FENCE[1] + 0.05
    assert np.all(compute_velocity(-np.ones(3), v_max, outside, FENCE) == -v_max)
    assert np.all(compute_velocity(np.ones(3), v_max, outside, FENCE) == 0.0)


# --- recordings ----------------------------------------------------------------------------------


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


# --- live sources --------------------------------------------------------------------------------


@pytest.fixture
def gateway() -> Iterator[FlightGateway]:
    opened = open_gateway(None, "udp:0", None, load_description("tool-install"))
    assert opened is not None
    yield opened
    opened.close()


def test_a_stick_of_the_gateway_counts_until_it_is_old(
    gateway: FlightGateway, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its age is that of its stamp: what comes late in a burst moves nothing."""
    operator, clock, now = GatewayOperator(gateway), Clock(), [1000.0]
    monkeypatch.setattr("skywright.ground.person.time", clock)
    monkeypatch.setattr("skywright.ground.gateway_operator.time", clock)
    monkeypatch.setattr(
        FlightGateway, "measure_age", staticmethod(lambda a: a.age + clock.perf_counter() - now[0])
    )
    stop = threading.Event()

    def answer() -> None:
        while not stop.is_set():
            gateway.poll()
            time.sleep(0.005)

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        with ArmsClient("127.0.0.1", gateway.server.port, timeout_s=300.0) as arms:
            arms.send_stick([0.5, 0.0, -1.0], 0)
            wait_for(lambda: gateway.stick is not None)
    finally:
        stop.set()
        thread.join()
    stick = operator.read(0.02, NOWHERE)
    assert stick is not None and tuple(stick.axes) == (0.5, 0.0, -1.0) and not stick.button
    clock.t += 0.2
    assert np.any(operator.read(0.22, NOWHERE).axes)  # type: ignore[union-attr]
    clock.t += 0.1  # 0.3 s old
    assert np.all(operator.read(0.32, NOWHERE).axes == 0.0)  # type: ignore[union-attr]
    monkeypatch.setattr("skywright.ground.person.PATIENCE_S", 0.5)
    clock.t += 0.5
    assert operator.read(0.82, NOWHERE) is None  # and in the end nobody is there


def test_a_joystick_of_linux_arrives(gateway: FlightGateway, tmp_path: Path) -> None:
    """The example reads events as the kernel writes them: ms, value, type, number."""
    device = tmp_path / "js0"
    os.mkfifo(device)
    example = Path(__file__).parent.parent / "examples" / "joystick_to_udp.py"
    sender = subprocess.Popen([sys.executable, example, device, str(gateway.server.port)])

    def read_stick() -> tuple[float, ...]:
        gateway.poll()
        values = {} if gateway.stick is None else gateway.stick.packet.values
        return (*values.get("axes", ())[:3], values.get("buttons"))

    try:
        with device.open("wb", buffering=0) as kernel:
            for value, kind, number in ((0, 0x81, 0), (-32767, 2, 1), (16384, 2, 2), (1, 1, 0)):
                kernel.write(struct.pack("<IhBB", 5, value, kind, number))
            wait_for(lambda: read_stick()[-1] == 1)
            assert read_stick() == pytest.approx((1.0, 0.0, -0.5, 1), abs=1e-3)
        assert sender.wait(300.0) == 0  # unplugged
    finally:
        sender.kill()
    assert set(gateway.server.counts) == {"accepted"}


def test_a_port_in_use_is_refused(gateway: FlightGateway) -> None:
    with pytest.raises(InputError, match="cannot listen"):
        open_gateway(f"udp:{gateway.server.port}", None, None, load_description("tool-install"))


def test_time_waits_for_a_person(monkeypatch: pytest.MonkeyPatch) -> None:
    person, clock = Person(), Clock()
    monkeypatch.setattr("skywright.ground.person.time", clock)
    for k in range(11):
        assert person.read(k * MISSION_TICK, NOWHERE) is not None
        assert clock.t == pytest.approx(k * MISSION_TICK)
        clock.t += 0.005  # the tick itself


def test_a_stick_of_the_page_moves_until_it_is_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the station passes on is judged again: sequence, age, dead-man, finite axes."""
    clock = Clock()
    clock.monotonic = clock.perf_counter  # type: ignore[attr-defined]
    for module in ("feed", "steering", "page_operator", "person"):
        monkeypatch.setattr(f"skywright.ground.{module}.time", clock)
    ours, theirs = build_pair()
    operator = PageOperator()
    operator.feed = Feed(ours, tmp_path)

    def push(seq: int, age: float = 0.0, held: bool = True, axes: tuple = (0, 0, -0.5)) -> list:
        say(theirs, "stick", s=seq, at=clock.perf_counter() - age, v=[*axes], d=held, b=False)
        operator.listen()
        return operator._stick.axes.tolist()

    assert push(1) == [0, 0, -0.5]
    clock.t += 0.2
    operator.listen()
    assert operator._stick.axes[2] == -0.5
    clock.t += 0.1
    operator.listen()
    assert operator._stick.axes[2] == 0.0  # too old now: let go
    assert push(2) == [0, 0, -0.5]
    assert push(3, held=False) == [0, 0, 0]
    assert push(4) == [0, 0, -0.5]
    clock.t += 0.3
    bad = [push(4), push(5, age=0.3), push(6, axes=(0, 0, -1.5)), push(7, axes=(0, True, 0))]
    assert bad == [[0, 0, 0]] * 4
    assert operator.feed.dropped + operator.feed.steering.stick.dropped == 4
    say(theirs, "control")  # another page: its sequence begins anew
    assert push(1) == [0, 0, -0.5]
    ours.close()
    theirs.close()


# --- the computed operator -----------------------------------------------------------------------


def test_the_computed_operator_trembles_and_repeats() -> None:
    """On the spot its stick is tremor and the noise of its eyes; the same seed does the same."""

    def watch(seed: int) -> np.ndarray:
        model = ModelOperator("careful", seed, 0.03)
        sticks = [model.read(k * MISSION_TICK, NOWHERE) for k in range(6000)]
        return np.array([s.axes[:2] for s in sticks if s is not None])

    a = watch(1)
    np.testing.assert_array_equal(a, watch(1))
    assert np.any(a != watch(2))
    fast = np.fft.rfft(a, axis=0)[(120 * 6) : (120 * 14)]
    rms = math.sqrt(2.0 * float(np.mean(np.sum(np.abs(fast) ** 2, axis=0)))) / len(a)
    assert rms == pytest.approx(TREMOR, rel=0.15)
    assert float(np.std(a)) < 2.0 * MANNERS["careful"].crossover * REMNANT / 0.03 + TREMOR


# --- flights -------------------------------------------------------------------------------------

QUICK = ["mission.task.hover_s=3", "mission.task.wait_s=2", "mission.timestep_ms=2"]


def test_a_packaged_recording_installs_the_tool_elsewhere(tmp_path: Path) -> None:
    """Another seed, pipe, tool and weight than those of the recording."""
    sets = [*QUICK, "mission.task.operator=careful", "world.pipe.diameter_m=0.16",
            "world.pipe.z_m=1.3", "world.things.tool.mass_kg=0.55",
            "world.things.tool.yaw_deg=3"]  # fmt: skip
    result = run_mission(load_description("tool-install", sets=sets, seed=7), out=tmp_path / "a")
    m = result.metrics
    assert result.outcome == "succeeded", (result.reason, m)
    assert m["tool.seat_error_mm"] < 10.0 and m["tool.seat_angle_deg"] < 3.0
    assert 15.0 < m["operator.time_s"] < 30.0 and m["operator.hand_error_mm"] < 20.0
    # it was taken from the pipe again by hand: the hooks carry what the tool weighs, not more
    names = [p.name for p in result.phases]
    assert names.count("grasp") == 1 and names.index("hook") < names.index("lift off")
    assert 10.0 < m["operator.retrieval_time_s"] < 30.0
    assert m["operator.retrieval_force_max_n"] < 0.75 * 9.81 * 0.55 and m["tool.returned"] == 1.0

    phase = [p.name for p in result.phases].index("install")
    s = result.samples[result.samples["phase"] == phase][::2]  # once a mission tick
    # (24): the goal of both hands moves at v_max times the stick, in the frame of the seat
    _, seat = find_places(result.description.world, result.description.mission.task)
    v = (0.03 * s["operator_stick"] @ rot_z(seat.yaw).T)[5:300]
    for side in ("left", "right"):
        moved = np.diff(s[f"{side}_ref_p_WH"], axis=0)[5:300] / MISSION_TICK
        np.testing.assert_allclose(moved[:, 2], v[:, 2], atol=1e-10)
        size = np.linalg.norm(v, axis=1)
        np.testing.assert_allclose(np.linalg.norm(moved, axis=1), size, atol=1e-10)
        assert np.max(np.linalg.norm(moved - v, axis=1) / size) < math.radians(1.0)  # as tracked

    # the run's directory is complete in itself, and the recording holds the stick
    kept = load_recording(tmp_path / "a" / FILE)
    packaged = load_recording(Path(result.description.mission.task.operator))
    assert kept.axes.tobytes() == packaged.axes.tobytes()
    assert f'operator = "{FILE}"' in (tmp_path / "a" / "mission.toml").read_text()
    stored = read_recording(tmp_path / "a" / "recording.mcap").samples
    assert stored.tobytes() == result.samples.tobytes()


class AimsBeside(ModelOperator):
    """Sees the hooks 2 cm behind where they are, and says all the time that the tool hangs."""

    def read(self, t: float, sight: Sight) -> Stick | None:
        if sight.towards[2] < 0.0:
            return super().read(t, sight)
        stick = super().read(t, sight._replace(off=sight.off - [0.02, 0.0, 0.0]))
        assert stick is not None
        return Stick(stick.axes, True)


def test_hooks_that_are_led_beside_the_handle_do_not_tip_the_tool_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(operated, "LONGEST_S", 20.0)
    result = run_mission(
        load_description("tool-install", sets=[*QUICK, "mission.task.hover_s=0"], seed=2),
        out=tmp_path / "a", operator=AimsBeside("hasty", 2, 0.03),
    )  # fmt: skip
    assert result.outcome == "aborted" and not result.acted
    assert "the operator took more than 20 s before the tool was lifted off" in result.reason
    assert "it stays on the pipe" in result.reason
    assert result.metrics["operator.retrieval_force_max_n"] < 0.1  # nothing was touched
    assert result.metrics["contact.collisions"] == 0.0
    assert result.metrics["tool.seat_error_mm"] < 10.0  # nor moved
    d = result.description
    tool = result.samples["object0_p_WO"]
    hook = [p.name for p in result.phases].index("hook")
    assert np.ptp(tool[result.samples["phase"] >= hook], axis=0).max() < 1e-3
    assert result.phases[-1].name == "land" and d.mission.task.retrieve_by_hand


def test_hooks_pass_a_handle_beside_which_they_are_led_no_higher() -> None:
    """The tip of a hook that rises so far beside the handle grazes it; so far below it is clear."""
    d = load_description("tool-install")
    arm, tool = d.robot.arm, d.world.find_thing("tool", Tool)
    assert arm is not None
    grip = build_grip(d.robot, tool, 9.81)
    beside, below = compute_entry(d.robot, grip)
    slope = math.radians(25.0)  # of the hook from straight up: the forearm is 65 deg from down
    hook = np.array([math.sin(slope), math.cos(slope)])
    corner = -grip.cradle[[0, 2]]  # ahead, up; of the handle in the cradle
    tip = corner + arm.hand.hook_length_m * hook
    both = 0.5 * tool.handle_diameter_m + arm.hand.radius_m
    rises = np.linspace(-0.1, 0.0, 2001)

    def come_near(shift: float) -> float:
        return float(min(np.hypot(tip[0] + shift, tip[1] + z) for z in rises))

    assert come_near(-beside + 1e-4) > both > come_near(-beside - 1e-3)
    assert tip[1] + below == pytest.approx(-both, abs=1e-9)


class Leaves:
    """Lowers the tool, then the flight is interrupted."""

    def __init__(self, after: float) -> None:
        self.after = after

    def read(self, t: float, sight: Sight) -> Stick | None:
        if t > self.after:
            raise KeyboardInterrupt
        return Stick(np.array([0.3, -0.3, -0.2]), False) if t > 0.1 else STILL


def test_an_interrupted_operator_is_kept_repeats_and_fails_safely(tmp_path: Path) -> None:
    d = load_description("tool-install", sets=[*QUICK, "mission.task.hover_s=0"], seed=3)
    cut = run_mission(d, out=tmp_path / "a", operator=Leaves(2.0))
    assert cut.outcome == "interrupted"
    partial = tmp_path / "a.partial"
    kept = load_recording(partial / FILE)
    assert kept.t[-1] == pytest.approx(2.0) and kept.v_max == 0.03

    again = run_mission(load_description(partial), out=tmp_path / "b")
    n = len(cut.samples)
    assert again.samples[:n].tobytes() == cut.samples.tobytes()  # the same flight, bit for bit
    # the input ends in the air: the tool is kept and laid down where it was
    assert again.outcome == "aborted" and "ended before the tool was seated" in again.reason
    assert "carried back to the bench" in again.reason
    assert again.metrics["tool.returned"] == 1.0
    assert again.metrics["contact.collisions"] == 0.0
    assert "tool.seat_error_mm" not in again.metrics
