"""A simulated flight is the arms program of others, over sockets of this computer."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.ground.gateway_operator import GatewayOperator
from skywright.links.udp.client import ArmsClient
from skywright.links.udp.flight import FlightGateway, open_gateway
from skywright.links.udp.lead_arms import Lead
from skywright.links.udp.packets import CODES
from skywright.run.backends import build_vehicle
from skywright.run.operator import FILE, load_recording
from skywright.run.run import run_mission
from skywright.vehicle.arms_interface import Arms

ROOT = Path(__file__).parent.parent


class Pilot(threading.Thread):
    """Connects when the robot asks for an operator, pushes the stick, and leaves."""

    def __init__(self, gateway: FlightGateway) -> None:
        super().__init__(daemon=True)
        self.gateway, self.asked = gateway, threading.Event()
        self.states: list[dict[str, Any]] = []
        self.deflections: list[dict[str, Any]] = []
        self.counts: dict[str, int] = {}

    def run(self) -> None:
        self.asked.wait()
        with ArmsClient("127.0.0.1", self.gateway.server.port, timeout_s=300.0) as arms:
            while len(self.states) < 120:
                arms.send_stick([0.4, -0.2, -0.3])
                if arms.poll():
                    self.states.append(arms.state)
                time.sleep(0.01)
            self.deflections += arms.deflections
            self.counts = dict(arms.counts)


def test_a_gateway_that_nobody_uses_changes_no_bit() -> None:
    d = load_description("bimanual-bench")
    gateway = open_gateway("udp:0", None, None, d)
    assert gateway is not None and len(gateway.parts) == 1
    flown = []
    for observers in ([], [gateway]):
        samples: list[Any] = []
        vehicle = build_vehicle(d, samples.append, parts=[p for o in observers for p in o.parts])
        arms = Arms(vehicle)
        arms.hands_velocity({"left": [0.02, 0.0, 0.01], "right": [0.0, -0.02, 0.01]})
        for _ in range(100):
            t = vehicle.tick().t
            for observer in observers:
                observer.on_tick(t, "phase", vehicle)
        vehicle.flush()
        flown.append(np.concatenate(samples))
    gateway.close()
    assert flown[0].tobytes() == flown[1].tobytes() and len(flown[0]) > 150
    assert np.ptp(flown[0]["q"], axis=0).max() > 0.01  # it moved


def test_a_stick_by_udp_moves_the_hands_and_the_state_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("skywright.ground.person.PATIENCE_S", 2.0)
    sets = ["mission.task.hover_s=0", "mission.task.wait_s=1", "mission.timestep_ms=2"]
    d = load_description("tool-install", sets=sets)
    gateway = open_gateway(None, "udp:0", None, d)
    assert gateway is not None
    pilot, operator = Pilot(gateway), GatewayOperator(gateway)
    begin = operator.begin
    monkeypatch.setattr("skywright.ground.gateway_operator.PATIENCE_S", 300.0)
    monkeypatch.setattr(operator, "begin", lambda: (pilot.asked.set(), begin())[1])
    pilot.start()
    result = run_mission(d, out=tmp_path / "a", observers=[gateway], operator=operator)
    pilot.join()

    # what the pilot did moved the hands as law (24) says, and was kept
    kept = load_recording(tmp_path / "a" / FILE)
    pushed = np.any(kept.axes != 0.0, axis=1)
    assert np.sum(pushed) > 20 and np.allclose(kept.axes[pushed], [0.4, -0.2, -0.3], atol=1e-6)
    assert not pushed[-1]  # it left: let go, and after a while nobody is there
    assert result.outcome == "aborted" and "ended before the tool was seated" in result.reason
    assert "carried back to the bench" in result.reason

    # the state is that of the flight as its computer knows it
    assert {s["phase"] for s in pilot.states} == {"install"}
    s = result.samples
    for state in pilot.states[5::20]:
        row = s[int(np.searchsorted(s["t"], state["t"] - 1e-6))]
        n = state["n"]
        assert n == 8 and state["n_hands"] == 2 and state["operation"] == 0
        assert np.linalg.norm(np.subtract(state["p_WB"], row["p_WB"])) < 0.03
        assert np.allclose(state["q"][:n], row["q"][:n], atol=0.03)
        hand = np.array(state["p_hand"]).reshape(2, 3)[0]
        assert np.linalg.norm(hand - row["left_ref_p_WH"]) < 0.05
        assert state["input_age"] >= 0.0
    # 200 Hz of the board, at its own times, as recorded; no deflection where there is no encoder
    t = np.array([p["t"] for p in pilot.deflections])
    steps = np.diff(t) * 200.0  # a packet may be lost where the machine is busy
    assert np.allclose(steps, np.round(steps), atol=0.42) and np.all(steps > 0.5) and len(t) > 50
    assert np.median(steps) == pytest.approx(1.0, abs=0.42)
    last = pilot.deflections[-1]
    row = s[int(np.searchsorted(s["t"], last["t"] - 1e-6))]
    measured = np.array([last["measured"] >> j & 1 for j in range(8)], bool)
    assert np.any(measured) and np.all(np.array(last["deflection"])[:8][~measured] == 0.0)
    assert np.allclose(
        np.array(last["deflection"])[:8][measured], row["deflection"][:8][measured], atol=0.02
    )
    assert set(gateway.server.counts) | set(pilot.counts) <= {"accepted", "old"}
    assert gateway.skipped == 0


class Program(threading.Thread):
    """Leads the arms as an operator's program does: references, a pause, a stick, operations."""

    def __init__(self, gateway: FlightGateway) -> None:
        super().__init__(daemon=True)
        self.gateway = gateway
        self.states: dict[str, list[dict[str, Any]]] = {}
        self.results: list[str] = []

    def run(self) -> None:
        while not self.gateway.server.offered:  # the robot takes off
            time.sleep(0.01)
        with ArmsClient("127.0.0.1", self.gateway.server.port, timeout_s=300.0) as arms:
            self.results.append(arms.operate("connect", 60.0))  # one has a session already
            self.results.append(arms.operate("joints", 60.0))
            start = time.monotonic()
            while arms.state.get("task") != CODES["joints"][0]:
                arms.poll()
                time.sleep(0.005)
                assert time.monotonic() - start < 60.0
            q = np.array(arms.state["q_ref"][:8])
            # A jump at the end. It lasts until it was followed: the flight may be late.
            while (t := time.monotonic() - start) < 1.5 or arms.state["q_ref"][0] < q[0] + 0.3:
                assert t < 60.0
                assert arms.state["task"] == CODES["joints"][0]  # no reference was too old
                shift = 0.15 * np.sin(2.0 * t) if t < 1.5 else 0.6
                arms.send_joints(q + [shift, 0, 0, 0, shift, 0, 0, 0])
                self._hear(arms, "joints", 0.02)
            self._hear(arms, "silent", 2.0)
            self.results.append(arms.operate("stick", 60.0))
            start = time.monotonic()
            while time.monotonic() - start < 1.5:
                arms.send_stick([0.0, 0.0, 0.6])
                self._hear(arms, "stick", 0.02)
            for name, axes in (
                ("force", [0.0, 0.0, 0.4]), ("grasp", None), ("visual", [0.0, 0.6, 0.0]),
                ("torque_off", None), ("torque_on", None),
            ):  # fmt: skip
                self.results.append(arms.operate(name, 60.0))
                self._hear(arms, name, 1.2, axes)
            self.results.append(arms.operate("land", 60.0))

    def _hear(
        self, arms: ArmsClient, name: str, seconds: float, axes: list[float] | None = None
    ) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if axes:
                arms.send_stick(axes)
            if arms.poll():
                self.states.setdefault(name, []).append(arms.state)
            time.sleep(0.005)


def test_joint_references_and_a_stick_lead_the_arms_and_stale_ones_stop(tmp_path: Path) -> None:
    d = load_description(
        ROOT / "examples" / "gateway" / "external-arms.toml", world="tool-bench",
        sets=["robot.arm.encoders=both", "mission.timestep_ms=2"],
    )  # fmt: skip
    gateway = open_gateway(None, "udp:0", None, d)
    assert gateway is not None
    program = Program(gateway)
    program.start()
    result = run_mission(
        d, out=tmp_path / "a", observers=[gateway], operator=GatewayOperator(gateway)
    )
    program.join(60.0)
    assert program.results == ["unavailable", *["accepted"] * 8]
    assert result.outcome == "succeeded", (result.reason, result.metrics)
    names = [p.name for p in result.phases]
    assert names[names.index("hold") :] == [
        "hold", "joints", "hold", "stick", "force", "grasp", "visual", "torque_off", "torque_on",
        "hold", "fold", "land",
    ]  # fmt: skip
    s, first = result.samples, names.index("hold")

    def select(k: int) -> Any:
        return s[s["phase"] == first + k]

    # the references were followed, no faster than the joints may go
    led = select(1)
    rate = np.diff(led["ref_q"], axis=0) / 0.01
    limit = 0.8
    assert np.max(np.abs(rate)) < 1.01 * limit + 1e-6
    assert np.max(np.abs(rate)) > 0.95 * limit  # in the jump
    moved = led["ref_q"] - led["ref_q"][0]
    assert np.ptp(moved[:, 0]) > 0.2 and np.all(np.abs(moved[:, [1, 2, 3, 5, 6, 7]]) < 1e-6)
    assert result.metrics["arms.tracking_rms_deg"] < 6.0
    # after the last one they held, and after a second the task was over
    silent = program.states["silent"]
    held = [x["q_ref"] for x in silent if x["input_age"] > 0.4]
    assert np.ptp(np.array(held), axis=0).max() < 1e-6
    tasks = [(x["input_age"], x["task"]) for x in silent]
    assert all(task == CODES["joints"][0] for age, task in tasks if 0.0 <= age < 0.95)
    assert tasks[-1][1] == CODES["hold"][0]
    # (24): the hands rise at the stick's share of v_max
    stick = select(3)
    rise = stick["left_ref_p_WH"][-1] - stick["left_ref_p_WH"][10]
    seconds = stick["t"][-1] - stick["t"][10]
    assert rise[2] / seconds == pytest.approx(0.05 * 0.6, rel=0.35)
    assert np.all(np.abs(rise[:2]) < 0.01)
    # a force upward raises hands that nothing resists; a grasp of nothing leaves them
    first_hand = {k: np.array([x["p_hand"][:3] for x in v]) for k, v in program.states.items()}
    assert first_hand["force"][-1, 2] > first_hand["force"][0, 2] + 0.01
    assert np.ptp(first_hand["grasp"][-30:], axis=0).max() < 0.02
    # (23): the places in the marker's frame move at the stick's share of v_max, to the left of the
    # robot, which faces +y; where the hands are depends on the force before and on gusts, too
    visual = select(6)
    left = visual["left_ref_p_WH"][-1] - visual["left_ref_p_WH"][10]
    seconds = visual["t"][-1] - visual["t"][10]
    assert -left[0] / seconds == pytest.approx(0.05 * 0.6, rel=0.05)
    assert np.max(np.abs(left[1:])) < 1e-3
    felt = first_hand["visual"][-1] - first_hand["visual"][10]
    assert 0.5 < felt[1] / (0.05 * 0.6 * seconds) < 2.0
    # without torque the springs carry nothing and the arms hang; with it they stay so
    assert np.max(np.abs(program.states["torque_off"][-1]["tau"])) < 0.25
    assert first_hand["torque_off"][-1, 2] < first_hand["torque_off"][0, 2] - 0.05
    held = [x["q_ref"] for x in program.states["torque_on"][-20:]]
    assert np.ptp(np.array(held), axis=0).max() < 1e-6


@pytest.mark.parametrize("hand", ["hook", "gripper"])
def test_hands_with_fingers_do_not_press_what_they_grasp(hand: str) -> None:
    fingers = ["robot.arm.hand.length_m=0.06", "robot.arm.hand.mass_kg=0.04"]
    d = load_description(
        ROOT / "examples" / "gateway" / "external-arms.toml",
        sets=["robot.arm.encoders=both", f"robot.arm.hand.kind={hand}", *fingers],
    )
    s: Any = SimpleNamespace(vehicle=build_vehicle(d), surroundings=None)
    gateway: Any = SimpleNamespace(robot=d.robot)
    offered = Lead(s, gateway, 0.05, 2.0)._list_offered()
    assert "force" in offered and ("grasp" in offered) == (hand == "hook")


def test_without_a_gateway_the_example_says_what_it_needs(tmp_path: Path) -> None:
    d = load_description(ROOT / "examples" / "gateway" / "external-arms.toml")
    result = run_mission(d, out=tmp_path / "a")
    assert result.outcome == "aborted" and "run with --operator udp:PORT" in result.reason
