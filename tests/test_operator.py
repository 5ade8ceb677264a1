"""The operator at the stick: law (24), live sources, the computed operator, the flights."""

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
from hypothesis import given
from hypothesis import strategies as st

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
from skywright.run.operator import FILE, STILL, Sight, Stick, load_recording
from skywright.run.run import run_mission
from skywright.vehicle.plant import MISSION_TICK
from waiting import Clock, wait_for

AXIS = st.floats(-1.0, 1.0)
NOWHERE = Sight(np.zeros(3), False)


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
