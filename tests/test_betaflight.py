"""Betaflight: packets, settings and rules, against a peer that behaves as documented."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import math
import socket
import struct
import threading
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from betaflight_peer import BetaflightPeer, Wrong
from skywright.cli import main
from skywright.core.rotations import rot_from_quat, rot_z
from skywright.description.loader import load_description
from skywright.description.robot.loader import list_robots, load_robot
from skywright.description.world.loader import load_world
from skywright.errors import InputError
from skywright.links.betaflight import msp
from skywright.links.betaflight.airframe import IDLE, MIN_CHECK, build_airframe, list_commands
from skywright.links.betaflight.flight import STATE_RATES, STATE_S, Options, fly_betaflight
from skywright.links.betaflight.link import REFUSALS_MAX, BetaflightLink, Ports
from skywright.links.betaflight.outer_loop import OuterLoop, Target
from skywright.links.betaflight.packets import (
    OUTPUTS,
    STATE,
    STICKS,
    Sticks,
    pack_state,
    pack_sticks,
    parse_outputs,
)
from skywright.links.betaflight.route import Route, add_landing, build_line, build_rest
from skywright.links.betaflight.set_up import SetUp
from skywright.links.sitl.plant import SitlPlant
from skywright.links.sitl.result import SitlResult
from skywright.models.nominal import Nominal
from skywright.models.rigid_body import compute_body, posture
from skywright.recordings.recording import read_recording
from skywright.vehicle.geodesy import Geodetic

WORLD = load_world("open")[0]
COPLANAR = ["ars-lrm", "bimanual", "bimanual-longreach", "hexarotor"]


@pytest.mark.parametrize("name", [entry.name for entry in list_robots()])
def test_every_robot_is_flown_or_refused_with_the_reason(name: str) -> None:
    robot = load_robot(name, [])[0]
    if name not in COPLANAR:
        with pytest.raises(InputError, match=r"rotors that are tilted by \d+ deg"):
            build_airframe(robot, WORLD)
        return
    airframe = build_airframe(robot, WORLD)
    assert np.all((airframe.gains >= 0) & (airframe.gains <= 250)) and airframe.angle_gain > 3.0
    np.testing.assert_allclose(np.abs(airframe.mix).max(axis=0), 1.0)
    # throttle alone turns nothing about the centre of mass; each axis turns about itself alone
    rotors = Nominal(robot, WORLD).rotors
    _, p_BC, _ = compute_body(Nominal(robot, WORLD).model, posture(robot, "folded"))
    torque = rotors.B[3:] - np.cross(p_BC, rotors.axis).T
    np.testing.assert_allclose(torque @ (airframe.mix[:, 0] ** 2), 0.0, atol=1e-9)
    made = torque @ airframe.mix[:, 1:]
    np.testing.assert_allclose(made, np.diag(np.diag(made)), atol=1e-9)
    assert np.all(np.diag(made) > 0.0)


def test_throttle_is_the_inverse_of_the_thrust() -> None:
    airframe = build_airframe(load_robot("bimanual", [])[0], WORLD)
    for throttle in (0.0, 0.3, 0.71, 1.0):
        thrust = airframe.compute_thrust(throttle)
        assert airframe.compute_throttle(thrust) == pytest.approx(throttle, abs=1e-12)
    command = IDLE + (1 - IDLE) * airframe.compute_throttle(airframe.mass * 9.81)
    assert command == pytest.approx(airframe.hover, abs=0.02)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("name", ["hexarotor", "bimanual"])
def test_a_step_in_each_axis_turns_the_robot_that_way(name: str, axis: int) -> None:
    """The lines of the command line, mixed as the firmware does, on the plant."""
    d = load_description("waypoints", name, "open", {}, 3)
    plant, airframe = SitlPlant(d, STATE_S, STATE_RATES), build_airframe(d.robot, d.world)
    lines = [line.split()[1:] for line in list_commands(airframe) if line[:5] == "mmix "][1:]
    mix = np.array([[float(x) for x in line[1:]] for line in lines])

    def command(share: float) -> np.ndarray:
        told = np.zeros(3)
        told[axis] = share
        told[2] *= -1.0  # mixTable negates yaw
        throttle = airframe.compute_throttle(1.15 * airframe.mass * 9.81)
        return np.clip(IDLE + (1 - IDLE) * (throttle * mix[:, 0] + mix[:, 1:] @ told), IDLE, 1.0)

    for _ in range(150):
        plant.step(command(0.0))
    saved, turned = plant.vehicle.save(), []
    for share in (0.0, 0.04):
        plant.vehicle.restore(saved)
        for _ in range(60):
            reading = plant.step(command(share))
        turned.append(reading.gyro)
    by_step = turned[1] - turned[0]
    assert by_step[axis] > 0.02, by_step
    assert np.abs(np.delete(by_step, axis)).max() < 0.5 * by_step[axis], by_step


@pytest.mark.parametrize("axis", range(3))
def test_the_state_carries_the_signs_that_betaflight_undoes(axis: int) -> None:
    """What sitl.c does to a packet gives the angular velocity and attitude of FLU."""
    w, angle = np.zeros(3), 0.3
    w[axis] = 0.7
    c, s = math.cos(angle), math.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(3)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    place = Geodetic(47.0, 8.0, 500.0)
    data = pack_state(w, np.array([0.1, 0.2, 9.8]), R, np.zeros(3), place, 95000.0)
    v = STATE.unpack(data)
    np.testing.assert_allclose(np.array(v[1:4]) * [1, -1, -1], w, atol=1e-12)
    np.testing.assert_allclose(-np.array(v[4:7]), [0.1, 0.2, 9.8])
    q = np.array([v[7], v[8], -v[9], -v[10]])
    np.testing.assert_allclose(rot_from_quat(q), R, atol=1e-12)
    assert (v[14], v[15], v[17]) == (8.0, 47.0, 95000.0)


def test_sticks_are_channels() -> None:
    v = STICKS.unpack(pack_sticks(1.0, Sticks(1.0, -2.0, 0.0, 0.5), MIN_CHECK, False))[1:]
    assert v[:6] == (2000, 1000, 1000, 1750, 1000, 2000) and set(v[6:]) == {1500}
    v = STICKS.unpack(pack_sticks(1.0, Sticks(0.0, 0.0, 1.0, 0.0), MIN_CHECK, True))[1:]
    assert v[2] == 2000 and v[4] == 2000


@settings(max_examples=60)
@given(st.lists(st.floats(1000, 2000, width=32), min_size=16, max_size=16), st.integers(1, 8))
def test_outputs_come_back(raw: list[float], n: int) -> None:
    found = parse_outputs(OUTPUTS.pack(n, *raw), n)
    assert not isinstance(found, str)
    np.testing.assert_allclose(found, (np.array(raw[:n]) - 1000) / 1000, atol=1e-6)
    assert parse_outputs(OUTPUTS.pack(n, *raw), n + 1) == "count"


@settings(max_examples=100)
@given(st.binary(max_size=200))
def test_bytes_that_are_no_outputs_are_refused_by_their_cause(data: bytes) -> None:
    if len(data) != OUTPUTS.size:
        assert parse_outputs(data, 6) == "size"
    bad = OUTPUTS.pack(6, *([float("nan")] * 16))
    assert parse_outputs(bad, 6) == "numbers"


@settings(max_examples=60)
@given(st.integers(0, 255), st.binary(max_size=255), st.binary(max_size=40), st.integers(1, 60))
def test_msp_frames_are_found_in_any_stream(
    command: int, payload: bytes, junk: bytes, cut: int
) -> None:
    parser = msp.MspParser()
    junk = junk.replace(b"$", b"")
    data = junk + msp.pack_answer(command, payload) + junk + msp.pack_answer(7, b"x")
    found = [f for k in range(0, len(data), cut) for f in parser.feed(data[k : k + cut])]
    assert found == [msp.Frame(command, payload), msp.Frame(7, b"x")]
    assert parser.counts["garbage"] == 2 * len(junk)


@settings(max_examples=100)
@given(st.binary(max_size=300), st.integers(1, 40))
def test_msp_survives_any_bytes_and_keeps_little(data: bytes, cut: int) -> None:
    parser = msp.MspParser()
    for k in range(0, len(data), cut):
        for frame in parser.feed(data[k : k + cut]):
            msp.parse_status(frame.payload)
            msp.parse_attitude(frame.payload)
    assert len(parser._rest) <= 261


def test_a_broken_checksum_costs_one_frame_only() -> None:
    parser = msp.MspParser()
    bad = bytearray(msp.pack_answer(msp.ATTITUDE, b"123456"))
    bad[-1] ^= 1
    assert list(parser.feed(bytes(bad) + msp.pack_answer(2, b"BTFL"))) == [msp.Frame(2, b"BTFL")]
    assert parser.counts["checksum"] == 1


@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (0, -1), (1, 1), (1, -1)])
def test_the_sticks_lean_towards_the_target(axis: int, sign: int, yaw: float) -> None:
    """The thrust of the attitude that the sticks ask for pushes along the error."""
    airframe = build_airframe(load_robot("hexarotor", [])[0], WORLD)
    loop = OuterLoop(airframe, 9.81)
    p = np.zeros(3)
    p[axis] = 0.3 * sign
    target = Target(p, np.zeros(3), np.zeros(3), yaw, 0.0)
    sticks = loop.compute(target, np.zeros(3), np.zeros(3), rot_z(yaw), 0.004, False)
    roll, pitch = (math.radians(30.0) * x for x in (sticks.roll, sticks.pitch))
    lean = np.array([math.cos(roll) * math.sin(pitch), -math.sin(roll), 1.0])
    push = rot_z(yaw) @ lean
    assert sign * push[axis] > 0.05 and abs(push[1 - axis]) < 1e-9
    assert abs(sticks.yaw) < 1e-12
    turned = loop.compute(target, p, np.zeros(3), rot_z(yaw - 0.2), 0.004, False)
    assert turned.yaw < 0.0  # a heading to the left: the stick goes left


def test_the_integral_grows_by_little_in_a_step_and_never_stands_still() -> None:
    loop = OuterLoop(build_airframe(load_robot("hexarotor", [])[0], WORLD), 9.81)
    for _ in range(250):  # 1 s
        far = Target(np.array([1.0, 0.0, 0.1]), np.zeros(3), np.zeros(3), 0.0, 0.0)
        loop.compute(far, np.zeros(3), np.zeros(3), np.eye(3), 0.004, True)
    assert 0.0 < loop.integral[2] < loop.integral[0] < 0.3
    assert loop.integral[0] == pytest.approx(2.0 * loop.integral[2])


# --- flights with the peer --------------------------------------------------------------------


def short(start: np.ndarray) -> Route:
    up = start + [0.0, 0.0, 0.4]
    legs = [build_line("take-off", start, up, 0.0, 0.8, 2.0), build_rest("hover", up, 0.0, 0.4)]
    return add_landing(Route(legs), float(start[2]))


def fly(
    tmp_path: Path, wrong: Wrong | None = None, patience: float = 10.0
) -> tuple[SitlResult, BetaflightPeer, list[str]]:
    """Fly a short hop with the peer; a real time of seconds."""
    peer, said = BetaflightPeer(wrong), list[str]()
    peer.start()
    try:
        options = Options(
            wait_s=60.0, patience_s=patience, out=tmp_path / "run", command_port=peer.command_port,
            ports=peer.ports,
        )  # fmt: skip
        d = load_description("waypoints", "hexarotor", "open", {}, 3)
        return fly_betaflight(d, options, said.append, short), peer, said
    finally:
        peer.stop()


def test_a_hop_with_the_peer_sets_up_arms_flies_lands_and_is_recorded(tmp_path: Path) -> None:
    result, peer, said = fly(tmp_path, Wrong(silent={700: 0.6}, junk={720}, nan={730}))
    assert (result.outcome, result.reason) == ("finished", "landed"), (result, said)
    assert result.metrics["flight.height_max_m"] > 0.5
    airframe = build_airframe(load_robot("hexarotor", [])[0], WORLD)
    assert set(list_commands(airframe)) <= set(peer.lines)
    assert any("time stands still" in line for line in said)
    refused = "\n".join(result.refused)
    assert "1 refused: a datagram that is no packet" in refused and "not finite" in refused
    samples = read_recording(result.directory / "recording.mcap").samples
    armed = samples["autopilot_armed"] > 0.5
    assert np.all(np.isfinite(samples["autopilot_command"]))
    led = armed & np.isfinite(samples["autopilot_p_WB_des"][:, 0])
    off = samples["p_WB"][led] - samples["autopilot_p_WB_des"][led]
    assert np.sqrt(np.mean(off[:, :2] ** 2)) < 0.1
    events = json.loads((result.directory / "metrics.json").read_text())["result"]["events"]
    assert any("Betaflight is armed" in text for _, text in events)
    assert len(set(state[0] for state in peer.states)) == 1  # equal times: its clock is the wall's


@pytest.mark.parametrize(
    ("wrong", "patience", "reason"),
    [
        (Wrong(silent={40: 3.0}), 1.5, "sent no outputs for 1.5 s"),
        (Wrong(vanish=60), 10.0, "has ended or restarted"),
        (Wrong(disarm=60), 10.0, "disarmed in flight: crash"),
        (Wrong(count=4), 10.0, "another number of motors"),
    ],
)
def test_what_ends_a_flight(tmp_path: Path, wrong: Wrong, patience: float, reason: str) -> None:
    result, _, _ = fly(tmp_path, wrong, patience)
    assert (result.outcome, result.exit_code) == ("aborted", 3) and reason in result.reason, result
    assert result.directory.name == "run.partial"


def test_a_setting_that_it_does_not_know_is_refused_before_the_flight(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Betaflight refuses 'set angle_limit = 30'"):
        fly(tmp_path, Wrong(refuses="set angle_limit"))
    assert not list(tmp_path.iterdir())


def test_without_betaflight_nothing_is_started(tmp_path: Path) -> None:
    d = load_description("waypoints", "hexarotor", "open", {}, 3)
    with socket.create_server(("127.0.0.1", 0)) as s:
        closed = int(s.getsockname()[1])
    with pytest.raises(InputError, match="no Betaflight at"):
        fly_betaflight(d, Options(wait_s=0.2, out=tmp_path / "run", command_port=closed,
                                  ports=Ports(0)), route=short)  # fmt: skip
    with pytest.raises(InputError, match="is no program"):
        fly_betaflight(d, Options(binary=tmp_path / "no", ports=Ports(0)), route=short)
    assert not (tmp_path / "run").exists()


def test_a_busy_port_is_told() -> None:
    first = BetaflightLink(6, "127.0.0.1", Ports(0))
    port = int(first._in.getsockname()[1])
    with pytest.raises(InputError, match=f"UDP port {port} .* another simulator listens there"):
        BetaflightLink(6, "127.0.0.1", Ports(port))
    first.close()


def test_refused_outputs_change_no_command_and_end_the_link() -> None:
    link = BetaflightLink(6, "127.0.0.1", Ports(0))
    link._take(OUTPUTS.pack(6, *([1500.0] * 16)), 0.0)
    for _ in range(REFUSALS_MAX):
        link._take(OUTPUTS.pack(5, *([1900.0] * 16)), 0.0)
    np.testing.assert_allclose(link.command, 0.5)
    assert "another number of motors" in link.trouble
    link.close()


def test_options_of_px4_and_betaflight_are_not_mixed() -> None:
    def run(*words: str) -> str:
        out = CliRunner().invoke(main, ["sitl", "hexarotor", *words])
        assert out.exit_code == 2, out.output
        return out.output

    assert "real time only" in run("--autopilot", "betaflight", "--speed", "2")
    assert "valid for betaflight: cli" in run("--autopilot", "betaflight", "--params", "env")
    assert "valid for px4" in run("--params", "cli")
    assert "started by you" in run("--binary", "x")
    out = CliRunner().invoke(
        main, ["sitl", "hexarotor", "--autopilot", "betaflight", "--params", "cli"]
    )
    assert out.exit_code == 0 and "mmix 5 " in out.output and out.output.endswith("save\n")


def test_the_page_has_the_flights_that_are_kept(repository: Path) -> None:
    spec = importlib.util.spec_from_file_location(
        "generate_betaflight", repository / "docs" / "generate_betaflight.py"
    )
    assert spec is not None and spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    text = generate.PAGE.read_text("utf-8")
    assert generate.build_page(text) == text
    assert "| `bimanual` | 1 | finished |" in text


def test_what_closes_the_connection_is_told_as_such() -> None:
    """A program that is no Betaflight on its port: one line, no internal error."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        over = threading.Event()
        server.settimeout(0.1)

        def close() -> None:  # each time: a reset during the handshake is tried again
            while not over.is_set():
                with contextlib.suppress(TimeoutError):
                    peer, _ = server.accept()
                    peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    peer.close()

        thread = threading.Thread(target=close)
        thread.start()
        set_up = SetUp("127.0.0.1", port, 2.0, None, lambda text: None)
        with pytest.raises(InputError, match="closed"):
            set_up.run(["mixer CUSTOM"])
        over.set()
        thread.join(2.0)
