"""The back end mavlink:URL against a simulated robot that speaks MAVLink, on one clock.

The peer is Skywright's own: what is tested are the protocol, the rules and the frames on both ends.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

import skywright
from mavlink_pair import Cable, Ends, Pair, PairClock, plug
from short_mission import write_short
from skywright.errors import InputError
from skywright.links.mavlink import modes
from skywright.links.mavlink.body_force import compute_most
from skywright.links.mavlink.check import find_refusal
from skywright.links.mavlink.companion import MavlinkVehicle, open_backend
from skywright.links.mavlink.endpoint import Endpoint, parse_url
from skywright.links.mavlink.heard import Heard
from skywright.links.mavlink.link import RENEWED_S, Target, VehicleLink, WallClock
from skywright.links.mavlink.offboard import SILENT_S
from skywright.links.mavlink.robot import Stick
from skywright.run.result import RunResult
from skywright.run.run import run_mission
from skywright.run.session import Vehicle, open_vehicle
from skywright.run.setup import Setup
from skywright.vehicle.commands import State
from skywright.vehicle.motions import Arrival

URL = "mavlink:udpin:14540"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Any:
    description = write_short(tmp_path_factory.mktemp("missions"))
    backend = skywright.build_vehicle(description)
    return description, backend, backend.save()


@pytest.fixture
def pair(built: Any, monkeypatch: pytest.MonkeyPatch) -> Pair:
    description, backend, ground = built
    backend.restore(ground)
    pair = Pair(description, backend)
    plug(monkeypatch, pair)
    return pair


def fly(pair: Pair, tmp_path: Path, backend: str = URL) -> RunResult:
    return run_mission(pair.description, backend=backend, out=tmp_path / "run")


def truth(pair: Pair) -> Any:
    return pair.backend.sim.data.qpos[:3]


# --- missions ----------------------------------------------------------------------------------


def test_waypoints_meets_the_requirements_of_its_simulated_version(
    pair: Pair, tmp_path: Path
) -> None:
    """The built-in mission, its limits unchanged."""
    highest = [0.0]
    pair.description = skywright.load("waypoints")
    pair.on_tick = lambda p: highest.__setitem__(0, max(highest[0], float(truth(p)[2])))
    result = fly(pair, tmp_path)
    assert result.outcome == "succeeded", result.reason
    assert highest[0] > 1.2  # it flew, and not only said so
    assert not pair.service.robot.armed
    assert np.linalg.norm(truth(pair)[:2]) < 0.15
    assert result.backend == URL


def test_a_vehicle_whose_clock_is_slow_is_led_by_its_clock(pair: Pair, tmp_path: Path) -> None:
    """A simulation at half of real time: by the wall clock it would lag behind its reference."""
    pair.slow = 2
    result = fly(pair, tmp_path)
    assert result.outcome == "succeeded", result.reason
    assert pair.link is not None and pair.link.heard.pace == pytest.approx(0.5, abs=0.02)


def test_after_silences_of_the_link_the_flight_goes_on(
    pair: Pair, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A short one changes nothing; in a longer one the robot holds by its own rule.

    Mission time stands still meanwhile. Where the uplink alone is lost, the robot leaves Offboard
    by that rule, too, and is not taken for one that a pilot flies.
    """
    both = ((104.5, 104.7), (105.5, 107.5), (114.0, 116.0), (119.0, 121.0))
    pair.down.lost = lambda t: any(a <= t < b for a, b in both)
    pair.up.lost = lambda t: pair.down.lost(t) or 110.0 <= t < 112.0
    before: list[str] = []

    def read_before_the_longer_ones(p: Pair) -> None:
        if p.clock.t >= 105.4 and not before:
            before.append(capsys.readouterr().err)

    pair.on_tick = read_before_the_longer_ones
    result = fly(pair, tmp_path)
    assert result.outcome == "succeeded", result.reason
    assert "manual" not in [p.name for p in result.phases]
    assert sum("no set-point" in s for s in pair.said) == 4
    told = capsys.readouterr().err
    assert told.count("Offboard again after the silence") == 4
    assert "mission time stands still" in told and "heard again" in told
    (early,) = before
    assert "silent" not in early


def test_a_link_that_is_lost_for_good_ends_the_mission(pair: Pair, tmp_path: Path) -> None:
    for cable in (pair.up, pair.down):
        cable.lost = lambda t: t >= 109.0
    result = fly(pair, tmp_path)
    assert result.outcome == "aborted"
    assert "silent for 10 s" in result.reason
    assert pair.service.robot.mode == modes.HOLD and pair.service.robot.armed


def test_an_autopilot_that_restarts_in_flight_ends_the_mission(
    built: Any, pair: Pair, tmp_path: Path
) -> None:
    def restart(p: Pair) -> None:
        if p.clock.t >= 110.0 and not p.ended:
            p.ended = True
            p.restart(built[2])

    pair.on_tick = restart
    result = fly(pair, tmp_path)
    assert result.outcome == "aborted"
    assert "restarted in flight" in result.reason or "stopped its motors" in result.reason


def set_mode(pair: Pair, mode: modes.Mode) -> None:
    assert pair.service.robot.choose(mode).result == 0


def test_the_pilots_switch_wins_and_the_mission_goes_on_after_it(
    pair: Pair, tmp_path: Path
) -> None:
    seen: list[str] = []

    def pilot(p: Pair) -> None:
        t = p.clock.t
        if 109.0 <= t < 109.02:
            set_mode(p, modes.POSITION)
        if 109.0 <= t < 112.0:
            p.service.robot.take_stick(Stick(0.0, 0.5, 0.0, 0.0))
            seen.append(str(p.service.robot.mode))
        if 113.0 <= t < 113.02:
            set_mode(p, modes.OFFBOARD)

    pair.on_tick = pilot
    result = fly(pair, tmp_path)
    assert set(seen[2:]) == {"Position"}  # nobody took it back meanwhile
    names = [p.name for p in result.phases]
    assert "manual" in names and "rejoin" in names
    assert result.outcome in ("succeeded", "failed"), result.reason
    assert result.phases[-1].outcome == "done" and not pair.service.robot.armed


def test_a_pilot_who_lands_ends_the_mission(pair: Pair, tmp_path: Path) -> None:
    def pilot(p: Pair) -> None:
        if 109.0 <= p.clock.t < 109.02:
            set_mode(p, modes.LAND)

    pair.on_tick = pilot
    result = fly(pair, tmp_path)
    assert result.outcome == "aborted" and "pilot landed" in result.reason
    assert not pair.service.robot.armed


def test_a_refused_arming_is_told_with_the_reason_of_the_vehicle(
    pair: Pair, tmp_path: Path
) -> None:
    v = pair.service.vehicle
    v.checklist = v.checklist.model_copy(update={"battery_min_fraction": 1.01})
    result = fly(pair, tmp_path)
    assert result.outcome == "aborted"
    assert "no take-off" in result.reason and "battery" in result.reason


def test_a_robot_with_tilted_rotors_is_led_by_the_force_of_its_own_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nearer than by positions; a link that is slower than the position loop bears is refused."""
    description = write_short(tmp_path, "f550-bridge")
    backend = skywright.build_vehicle(description)
    ground = backend.save()
    pair = Pair(description, backend)
    plug(monkeypatch, pair)
    result = fly(pair, tmp_path, URL + "?force")
    assert result.outcome == "succeeded", result.reason
    assert result.metrics["position.hold_error_m"] < 0.01
    backend.restore(ground)
    slow = Pair(description, backend)
    plug(monkeypatch, slow)
    slow.up.delay = slow.down.delay = 0.06
    with pytest.raises(InputError, match="phase margin of 30 deg with a dead time up to"):
        run_mission(description, backend=URL + "?force", out=tmp_path / "slow")


# --- scripts -----------------------------------------------------------------------------------


def open_session(pair: Pair) -> Vehicle:
    arrival = Arrival(tolerance_m=0.15, dwell_s=0.2)
    return open_vehicle(pair.description, URL, arrival, checklist=False)


def test_a_script_flies_gives_to_the_pilot_and_takes_over_again(pair: Pair) -> None:
    vehicle = open_session(pair)
    assert vehicle.take_off(1.0).result
    assert vehicle.go_to([0.5, 0.0, 1.0]).result
    assert np.linalg.norm(truth(pair) - [0.5, 0.0, 1.0]) < 0.2
    assert vehicle.take_over()
    assert vehicle.state == State.FLYING_MANUAL
    assert pair.service.robot.mode == modes.POSITION
    vehicle.wait(1.0)
    handle = vehicle.recover_from_manual()
    assert handle.result, handle
    assert pair.service.robot.mode == modes.OFFBOARD
    assert vehicle.state == State.FLYING_AUTO
    assert vehicle.land().result
    vehicle.wait(0.5)
    assert not pair.service.robot.armed
    vehicle.close()


def test_a_pilots_switch_changes_the_state_of_a_script(pair: Pair) -> None:
    vehicle = open_session(pair)
    assert vehicle.take_off(1.0).result
    set_mode(pair, modes.POSITION)
    vehicle.wait(1.5)
    assert vehicle.state == State.FLYING_MANUAL
    refused = vehicle.go_to([1.0, 0.0, 1.0])
    assert not refused and "flying_manual" in refused.result.reason
    set_mode(pair, modes.OFFBOARD)
    vehicle.wait(3.0)
    assert vehicle.state == State.FLYING_AUTO


# --- what is refused before anything flies -----------------------------------------------------


@pytest.mark.parametrize(
    ("mission", "robot", "why"),
    [
        ("sensor-install", None, "hands"), ("pipe-weld-scan", None, "probe"),
        ("impact", None, "dynamics"), ("waypoints", "bimanual-longreach", "link on the ground"),
    ],
)  # fmt: skip
def test_what_cannot_be_flown_is_refused_before_anything_is_connected(
    mission: str, robot: str | None, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    description = skywright.load(mission, robot=robot)
    assert why in find_refusal(Setup(description))


def test_without_a_vehicle_it_says_what_it_waited_for(
    pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair.down.lost = lambda t: True
    with pytest.raises(InputError, match="no MAVLink vehicle was heard on udpin"):
        fly(pair, tmp_path)


def test_body_forces_need_rotors_that_push_sideways(pair: Pair, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="do not push sideways"):
        fly(pair, tmp_path, URL + "?force")
    with pytest.raises(InputError, match="valid: \\?force"):
        fly(pair, tmp_path, URL + "?fast")


# --- parts -------------------------------------------------------------------------------------


def test_the_dead_time_that_the_position_loop_bears_is_that_of_its_phase() -> None:
    """At the dead time that is named, the loop has 30 deg left: found anew by bisection."""
    robot = skywright.load_robot("othex")
    c, tau = robot.control, 0.03
    most = compute_most(c, tau)
    w, z, wi = (
        c.position_bandwidth_rad_s, c.position_damping, c.position_integral_rad_s,
    )  # fmt: skip

    def gain(x: float) -> complex:
        s = 1j * x
        return (w * w + 2 * z * w * s + wi * w * w / s) / (s * s * (1 + tau * s))

    lo, hi = 0.5 * w, 20.0 * w
    for _ in range(60):
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if abs(gain(mid)) > 1.0 else (lo, mid)
    phase = math.pi + np.angle(gain(lo) * np.exp(-1j * lo * most))
    assert math.degrees(phase) == pytest.approx(30.0, abs=1.0)


def test_a_set_point_that_is_not_renewed_loses_its_velocity(pair: Pair) -> None:
    vehicle = open_session(pair)
    assert vehicle.take_off(1.0).result
    handle = vehicle.go_to([2.0, 0.0, 1.0], wait=False)
    vehicle.wait(1.0)
    link = pair.link
    assert link is not None and link._target is not None and link._target[1].v[0] > 0.2
    sent: list[Any] = []
    monitor = pair.up.put
    pair.up.put = lambda data: (sent.append(data), monitor(data))[1]  # type: ignore[method-assign]
    pair.clock.sleep(0.5)  # the mission thinks
    parser = common.MAVLink(None)
    points = [m for d in sent for m in parser.parse_buffer(d) or [] if m.get_msgId() == 84]
    assert len(points) >= 24  # the stream is steady
    assert points[0].vy > 0.2
    late = points[int(RENEWED_S / 0.02) + 2 :]
    assert all(m.vx == m.vy == m.vz == 0.0 for m in late)
    assert handle


def test_the_clock_of_the_vehicle_that_goes_back_is_a_restart() -> None:
    heard = Heard()
    parser = common.MAVLink(None, 1, 1)
    sender = common.MAVLink(None, 1, 1)

    def tell(m: Any, now: float) -> None:
        for found in parser.parse_buffer(m.pack(sender)) or []:
            heard.take(found, now)

    tell(common.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), 1.0)
    for ms in (5000, 5020, 4990, 5040):  # late packets are none
        tell(common.MAVLink_local_position_ned_message(ms, 1, 2, -3, 0, 0, 0), 1.0)
    assert heard.restarts == 0 and np.allclose(heard.p, [2, 1, 3])
    tell(common.MAVLink_local_position_ned_message(20, 1, 2, -3, 0, 0, 0), 1.0)
    assert heard.restarts == 1
    tell(common.MAVLink_local_position_ned_message(40, math.nan, 2, -3, 0, 0, 0), 1.0)
    assert np.allclose(heard.p, [2, 1, 3])


@pytest.mark.parametrize("part", ["p", "v", "a", "R_WB", "rate", "f_B"])
@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e300])
def test_a_set_point_with_a_number_that_is_none_is_not_sent(part: str, wrong: float) -> None:
    """The last one stands, and becomes stale: the vehicle holds there."""
    clock = PairClock()
    endpoint = Endpoint(parse_url("udpin:1"), 1, 191, Ends(Cable(clock), Cable(clock)))
    link = VehicleLink(endpoint, clock)
    zeros = np.zeros(3)
    good = Target(zeros, zeros, zeros, np.eye(3), 0.0, zeros)
    link.lead(good)
    value = getattr(good, part)
    link.lead(good._replace(**{part: wrong if part == "rate" else np.full_like(value, wrong)}))
    assert link._target == (clock.now(), good)
    link.lead(None)
    assert link._target is None


def test_the_stream_goes_on_after_what_went_wrong_in_its_thread() -> None:
    link = VehicleLink(Endpoint(parse_url("udpin:1"), 1, 191, Ends(*plain_cables())), WallClock())
    went, right = [], link.step

    def step() -> None:
        went.append(link.clock.now())
        if len(went) < 3:
            raise ValueError("odd")
        right()

    link.step = step  # type: ignore[method-assign]
    deadline = link.clock.now() + 5.0
    while len(went) < 6 and link.clock.now() < deadline:
        link.clock.sleep(0.02)
    link.close()
    assert len(went) >= 6 and link.failure == "ValueError: odd"


def plain_cables() -> tuple[Cable, Cable]:
    clock = PairClock()
    return Cable(clock), Cable(clock)


def test_without_its_library_a_back_end_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    with pytest.raises(InputError, match="pip install"):
        open_backend("udpin:14550")


def test_a_companion_does_not_sleep_for_the_uptime_of_an_autopilot_that_restarted() -> None:
    slept: list[float] = []
    now = [0.0]

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += seconds

    clock = SimpleNamespace(now=lambda: now[0], sleep=sleep)
    vehicle: Any = SimpleNamespace(
        _due=600.0, _now=lambda: 8.0 + now[0], clock=clock, late_s=0.0,
        link=SimpleNamespace(heard=SimpleNamespace(pace=1.0)),
    )  # fmt: skip
    MavlinkVehicle._pace(vehicle)
    assert max(slept) < 0.03 and sum(slept) <= SILENT_S + 0.03
