"""A simulated flight is the arms program of others, over sockets of this computer."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skywright.description.loader import load_description
from skywright.ground.gateway_operator import GatewayOperator
from skywright.links.udp.client import ArmsClient
from skywright.links.udp.flight import FlightGateway, open_gateway
from skywright.run.operator import FILE, load_recording
from skywright.run.run import build_vehicle, run_mission
from skywright.vehicle.arms_interface import Arms


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
            end = None
            while end is None or time.monotonic() < end:
                arms.send_stick([0.4, -0.2, -0.3])
                if arms.poll():
                    self.states.append(arms.state)
                    end = end or time.monotonic() + 3.0
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
        vehicle = build_vehicle(d, samples.append, observers=observers)
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
    monkeypatch.setattr("skywright.ground.operators.PATIENCE_S", 2.0)
    sets = ["mission.task.hover_s=0", "mission.task.wait_s=1"]
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
    assert np.sum(pushed) > 50 and np.allclose(kept.axes[pushed], [0.4, -0.2, -0.3], atol=1e-6)
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
        assert 0.0 <= state["input_age"] < 2.5
    # 200 Hz of the board, at its own times, as recorded; no deflection where there is no encoder
    t = np.array([p["t"] for p in pilot.deflections])
    assert np.allclose(np.diff(t), 1.0 / 200.0, atol=2.1e-3) and len(t) > 100
    last = pilot.deflections[-1]
    row = s[int(np.searchsorted(s["t"], last["t"] - 1e-6))]
    measured = np.array([last["measured"] >> j & 1 for j in range(8)], bool)
    assert np.any(measured) and np.all(np.array(last["deflection"])[:8][~measured] == 0.0)
    assert np.allclose(
        np.array(last["deflection"])[:8][measured], row["deflection"][:8][measured], atol=0.02
    )
    assert set(gateway.server.counts) == {"accepted"} and set(pilot.counts) == {"accepted"}
    assert gateway.skipped == 0
