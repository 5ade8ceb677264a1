"""The platform's commands: states, refusals, arrival, streams, and a pilot's stick."""

from __future__ import annotations

import math
import runpy
from pathlib import Path

import numpy as np
import pytest
from pymap3d import geodetic2enu

import skywright
from skywright.core.rotations import log_so3
from skywright.description.mission.safety import Checklist, Fence
from skywright.description.world.origin import Origin
from skywright.errors import InputError
from skywright.vehicle.bus import Body
from skywright.vehicle.commands import NEEDS, TABLE, Command, ControlMode, Need, State
from skywright.vehicle.drives import TILT_RATE, TURN_MAX, tilt_heading
from skywright.vehicle.geodesy import Geodetic, to_geodetic, to_local
from skywright.vehicle.motions import Arrival
from skywright.vehicle.preflight import run_checklist
from skywright.vehicle.results import Result
from skywright.vehicle.uav import Uav

QUICK = Arrival(tolerance_m=0.3, dwell_s=0.1, yaw_rad=0.3)


@pytest.fixture(scope="module")
def hovering():
    """A vehicle in the air, its saved state, and the state on the ground."""
    sets = {"world.origin.latitude_deg": 37.41, "world.origin.longitude_deg": -6.0}
    description = skywright.load("waypoints", sets=sets)
    vehicle = skywright.build_vehicle(description)
    uav = Uav(vehicle, arrival=QUICK)
    while uav.state == State.UNINITIALIZED:
        uav.tick()
    ground = vehicle.save()
    assert uav.take_off(1.2, wait=True).result
    return vehicle, vehicle.save(), ground


@pytest.fixture
def uav(hovering):
    vehicle, air, _ = hovering
    vehicle.restore(air)
    return Uav(vehicle, arrival=QUICK)


@pytest.fixture
def landed(hovering):
    vehicle, _, ground = hovering
    vehicle.restore(ground)
    return vehicle


def test_the_table_names_every_command_and_need():
    assert set(TABLE) == set(Command) and set(NEEDS) == set(Need)
    for command, entry in TABLE.items():
        assert entry.states and entry.says, command
        # from every state something leads back to the ground
    assert all(State.LANDED_DISARMED in (TABLE[Command.STOP_MOTORS].after,) for _ in State)
    assert set(TABLE[Command.STOP_MOTORS].states) == set(State)
    in_air = {State.TAKING_OFF, State.FLYING_AUTO, State.FLYING_MANUAL, State.LANDING}
    assert in_air <= set(TABLE[Command.TAKE_OVER].states)  # the pilot's switch always wins


def test_the_page_has_todays_commands():
    path = Path(__file__).parent.parent / "docs" / "generate_commands.py"
    module = runpy.run_path(str(path))
    text = module["PAGE"].read_text(encoding="utf-8")
    assert text == module["build_page"](text), "run: python docs/generate_commands.py"


def test_a_flight_from_the_ground_to_the_ground(landed):
    seen = []
    uav = Uav(landed, checklist=Checklist(spin=True))
    uav.on_state = seen.append
    refused = uav.go_to((1.0, 0.0, 1.0))
    assert refused.done and not refused and "the state is landed_disarmed" in refused.result.reason
    up = uav.take_off(1.0)
    assert up and not up.done and uav.state == State.TAKING_OFF
    assert up.wait()
    assert abs(landed.estimate["p_WB"][2] - 1.0) <= 0.05  # arrival: 5 cm
    assert {c.name for c in uav.checked} >= {"battery", "localisation", "spin"}
    down = uav.land(wait=True)
    assert down and not uav.is_turning and uav.mode == ControlMode.OFF
    assert seen == [State.TAKING_OFF, State.FLYING_AUTO, State.LANDING, State.LANDED_DISARMED]


def test_an_interrupted_motion_says_by_what_and_the_next_goes_on_smoothly(uav):
    b = uav.backend
    first = uav.go_to((2.0, 0.0, 1.2))
    uav.wait(1.5)
    v = np.array(b.reference["v_WB"])
    assert v[0] > 0.3
    second = uav.go_to((0.0, 1.0, 1.2))
    assert first.result.reason == "interrupted by go_to"
    speeds = [v]
    while not second.done:
        uav.tick()
        speeds.append(np.array(b.reference["v_WB"]))
    steps = np.linalg.norm(np.diff(speeds, axis=0), axis=1)
    assert steps.max() <= 2.5 * b.limits.acceleration * 0.02  # no jump of the reference
    np.testing.assert_allclose(b.reference["p_WB"], [0.0, 1.0, 1.2], atol=1e-5)


def test_a_velocity_is_followed_goes_stale_and_lands_on_what_it_meets(uav):
    b = uav.backend
    for _ in range(100):
        assert uav.set_velocity((0.4, 0.0, 0.0), 0.3)
        uav.tick()
    assert b.reference["v_WB"][0] == pytest.approx(0.4)
    assert b.reference["w_WB_B"][2] == pytest.approx(0.3)
    uav.wait(0.45)
    assert b.reference["v_WB"][0] == pytest.approx(0.4)  # for half a second
    uav.wait(1.5)
    assert abs(b.reference["v_WB"][0]) < 1e-9 and uav.state == State.FLYING_AUTO
    for _ in range(600):
        uav.set_velocity((0.0, 0.0, -0.3))
        uav.tick()
        if uav.state == State.LANDED_DISARMED:
            break
    assert uav.state == State.LANDED_DISARMED and not uav.is_turning
    assert b.estimate["p_WB"][2] == pytest.approx(b.robot.platform.gear_height_m, abs=0.03)
    assert not uav.set_velocity((0.0, 0.0, 0.3))  # and it stays there


def test_poses_are_approached_within_the_limits(uav):
    b, fastest = uav.backend, 0.0
    for _ in range(300):
        uav.set_pose((1.5, 0.0, 1.5), 1.0)
        uav.tick()
        fastest = max(fastest, float(np.linalg.norm(b.reference["v_WB"])))
    np.testing.assert_allclose(b.reference["p_WB"], [1.5, 0.0, 1.5], atol=0.02)
    assert fastest <= b.limits.speed + 1e-9
    R = b.reference["R_WB"]
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(1.0, abs=0.02)


def test_a_pose_that_moves_too_fast_is_followed_at_the_limits(uav):
    """Speeds that come with a pose are cut like those of a stream of velocities."""
    b, fastest, turned = uav.backend, 0.0, 0.0
    for k in range(150):
        uav.set_pose((0.2 * k, 0.0, 1.2), v=(10.0, 0.0, 0.0), yaw_rate=15.0)
        uav.tick()
        fastest = max(fastest, float(np.linalg.norm(b.reference["v_WB"])))
        turned = max(turned, abs(float(b.reference["w_WB_B"][2])))
    assert 0.9 * b.limits.speed < fastest <= b.limits.speed + 1e-9
    assert 0.9 * TURN_MAX < turned <= TURN_MAX + 1e-9


def test_a_velocity_with_a_tilt_comes_up_slowly_and_goes_stale(uav):
    b, lean = uav.backend, []
    for k in range(120):
        if k < 60:
            uav.set_velocity((0.0, 0.0, 0.0), roll=0.1, pitch=-0.1)
        uav.tick()
        R = b.reference["R_WB"]
        lean.append(math.acos(min(float(R[2, 2]), 1.0)))
    tilt = math.hypot(0.1, 0.1)
    assert max(lean) == pytest.approx(tilt, abs=0.002)
    assert max(np.diff(lean)) <= math.sqrt(2.0) * TILT_RATE * 0.02 + 1e-3
    assert lean[-1] < 0.01  # no news for 0.5 s: level again


@pytest.fixture(scope="module")
def leaning():
    """A robot with lateral thrust that hovers with a tilt, and its saved state."""
    vehicle = skywright.build_vehicle(skywright.load("waypoints", robot="othex"))
    uav = Uav(vehicle, arrival=QUICK)
    uav.wait(1.1)
    assert uav.take_off(1.2, wait=True).result
    for _ in range(60):
        uav.set_velocity((0.0, 0.0, 0.0), roll=0.2)
        uav.tick()
    assert vehicle.reference["R_WB"][2, 2] == pytest.approx(math.cos(0.2), abs=1e-6)
    return vehicle, vehicle.save()


@pytest.mark.parametrize(
    "command",
    [
        lambda u: u.hold(),
        lambda u: u.land(),
        lambda u: u.go_to((0.5, 0.0, 1.2), 0.5),
        lambda u: u.set_pose((0.0, 0.0, 1.2), 0.5),
    ],
    ids=["hold", "land", "go_to", "set_pose"],
)
def test_a_tilt_in_place_ends_slowly_with_its_rate_as_reference(leaning, command):
    vehicle, state = leaning
    vehicle.restore(state)
    uav, turned, fastest, off = Uav(vehicle, arrival=QUICK), np.empty(3), 0.0, 0.0
    before = vehicle.reference
    command(uav)
    for _ in range(60):
        uav.tick()
        row = vehicle.reference
        log_so3(before["R_WB"].T @ row["R_WB"], turned)
        fastest = max(fastest, math.hypot(*turned[:2]) / 0.02)
        mean = 0.5 * (before["w_WB_B"] + row["w_WB_B"])
        off = max(off, float(np.linalg.norm(turned / 0.02 - mean)))
        before = row
    assert fastest == pytest.approx(TILT_RATE, rel=0.05)  # 10 rad/s before
    assert off < 0.2  # rad/s; half of the tilt's rate in the first and the last tick
    assert row["R_WB"][2, 2] > 1.0 - 1e-9


@pytest.mark.parametrize(
    ("axis", "stick", "sign"), [(0, {"pitch": 0.08}, 1.0), (1, {"roll": 0.08}, -1.0)]
)
def test_a_stick_tilts_and_accelerates_by_g_tan_of_it(uav, axis, stick, sign):
    b = uav.backend
    uav.take_over()
    v = []
    for _ in range(50):  # within 0.4 s the platform has tilted
        uav.stick(**stick)
        uav.tick()
        v.append(float(b.estimate["v_WB"][axis]))
    gained = sign * (v[49] - v[19])
    assert gained == pytest.approx(9.81 * math.tan(0.08) * 0.6, rel=0.1)
    assert uav.go_to((0.0, 0.0, 1.0)).result.reason.startswith("go_to refused: the state is flying")
    back = uav.recover_from_manual(wait=True)
    assert back and uav.state == State.FLYING_AUTO
    uav.wait(1.0)
    assert np.linalg.norm(b.estimate["v_WB"]) < 0.15


@pytest.mark.parametrize("streams_attitude", [False, True])
def test_without_position_loops_the_reference_is_at_the_estimate(uav, streams_attitude):
    """Else the loops pull towards a reference that runs on, and tilt by more than commanded."""
    b, off, tilt = uav.backend, 0.0, 0.0
    R = np.array(tilt_heading(0.0, 0.0, 0.1))
    f = [0.0, 0.0, b.look(Body).mass * 9.81 / math.cos(0.1)]
    if not streams_attitude:
        uav.take_over()
    for k in range(70):
        if streams_attitude:
            uav.set_attitude(R if k < 40 else np.eye(3), f)
        else:
            uav.stick(pitch=0.1 if k < 40 else 0.0)
        uav.tick()
        ref, est = b.reference, b.estimate
        off = max(off, float(np.linalg.norm((ref["p_WB"] - est["p_WB"])[:2])))
        tilt = max(tilt, math.acos(min(float(est["R_WB"][2, 2]), 1.0)))
    assert est["v_WB"][0] > 0.4 and off < 0.01  # m; 0.1 before
    assert tilt < 0.12  # rad; 0.17 before


def test_a_pilot_takes_off_and_lands(landed):
    uav = Uav(landed)
    assert uav.arm(wait=True) and uav.take_over()
    while landed.estimate["p_WB"][2] < 1.0:
        uav.stick(climb=0.4)
        uav.tick()
    assert uav.state == State.FLYING_MANUAL
    for _ in range(1000):
        uav.stick(climb=-0.3)
        uav.tick()
        if uav.state == State.LANDED_DISARMED:
            break
    assert uav.state == State.LANDED_DISARMED
    assert landed.estimate["p_WB"][2] == pytest.approx(
        landed.robot.platform.gear_height_m, abs=0.03
    )


def test_recovery_is_refused_where_it_cannot_hold(uav):
    uav.take_over()
    b = uav.backend
    while b.estimate["p_WB"][2] > b.robot.platform.gear_height_m + 0.15:
        uav.stick(climb=-0.5)
        uav.tick()
    says = uav.recover_from_manual().result.reason
    assert "above the ground" in says and "land by hand" in says
    assert uav.state == State.FLYING_MANUAL


def test_goals_outside_the_fence_are_refused_with_the_key(uav):
    fenced = Uav(uav.backend, fence=Fence(x_max_m=1.0, height_max_m=2.0))
    says = fenced.go_to((1.5, 0.0, 1.0)).result.reason
    assert says == (
        "go_to refused: the goal is 0.50 m outside the geofence: mission.fence.x_max_m = 1, "
        "goal 1.50"
    )
    assert not fenced.set_pose((0.0, 0.0, 3.0)) and fenced.go_to((0.5, 0.0, 1.0))


def test_a_flat_battery_and_a_dead_rotor_stay_on_the_ground():
    sets = {"plant.faults.flat.kind": "battery", "plant.faults.flat.charge_fraction": 0.1,
            "plant.faults.flat.start_s": 0.0}  # fmt: skip
    vehicle = skywright.build_vehicle(skywright.load("waypoints", sets=sets))
    uav = Uav(vehicle, checklist=Checklist())
    uav.wait(1.1)
    assert uav.take_off(1.0).result.reason == "take_off refused: battery 0.1, at least 0.3"
    sets = {"plant.faults.dead.kind": "rotor", "plant.faults.dead.efficiency": 0.0,
            "plant.faults.dead.start_s": 0.0}  # fmt: skip
    vehicle = skywright.build_vehicle(skywright.load("waypoints", sets=sets))
    uav = Uav(vehicle, checklist=Checklist(spin=True))
    uav.wait(1.1)
    up = uav.take_off(1.0, wait=True)
    assert "spin check: rotor 1 turns at 0 rad/s" in up.result.reason
    assert uav.state == State.LANDED_DISARMED and not uav.is_turning
    assert all(c.passed for c in run_checklist(Checklist(), vehicle, None))


def test_no_command_skips_the_spin_check(landed):
    """`disarm` and `stop_motors` end it; `take_off` replaces that of `arm` by its own."""
    uav = Uav(landed, checklist=Checklist(spin=True))
    first = uav.arm()
    uav.wait(0.06)
    says = uav.arm().result.reason
    assert says.startswith("arm refused: arm is still starting the motors") and not first.done
    up = uav.take_off(1.0)
    assert first.result.reason == "interrupted by take_off"
    uav.wait(0.06)
    for command in (uav.hold, uav.land):
        assert "refused: take_off is still starting the motors" in command().result.reason
    assert "spin" not in {c.name for c in uav.checked} and not up.done
    while landed.estimate["p_WB"][2] < 0.5:
        uav.tick()
    assert uav.checked[-1].name == "spin" and uav.checked[-1].passed
    assert uav.hold()  # it may be interrupted from the climb on
    assert uav.stop_motors(confirm=True) and not uav.is_turning


def test_a_start_that_fails_before_the_spin_check_stops_the_motors(landed, monkeypatch):
    uav = Uav(landed, checklist=Checklist(spin=True))
    uav.arm()
    uav.wait(0.06)
    assert uav.is_turning

    def fail(fly):
        yield
        return Result(False, "the arms do not fold: stuck")

    monkeypatch.setattr(uav._fly, "rest_then", fail)
    up = uav.take_off(1.0, wait=True)
    assert up.result.reason == "the arms do not fold: stuck"
    assert uav.state == State.LANDED_DISARMED and not uav.is_turning


def test_a_geodetic_goal_is_the_place_that_the_library_says(uav):
    origin = uav.backend.world.origin
    p = np.array(geodetic2enu(37.41001, -5.99999, 2.0, 37.41, -6.0, 0.0))
    handle = uav.go_to_geo(37.41001, -5.99999, 2.0, wait=True)
    assert handle, handle
    np.testing.assert_allclose(uav.backend.reference["p_WB"], p, atol=1e-6)
    place = to_geodetic(origin, p)
    np.testing.assert_allclose(to_local(origin, place), p, atol=1e-6)
    # a second of latitude is 30.8 m on every ellipsoid
    north = to_local(origin, Geodetic(37.41 + 1.0 / 3600.0, -6.0, 0.0))
    assert north[1] == pytest.approx(30.83, abs=0.05) and abs(north[0]) < 0.01


def test_numbers_that_are_none_are_told_by_their_name(uav):
    for call, words in (
        (lambda: uav.go_to((1.0, math.nan, 0.0)), "p = "),
        (lambda: uav.set_velocity((1.0, 2.0)), "v = "),
        (lambda: uav.take_off(math.inf), "height = inf"),
        (lambda: uav.stick(roll="a"), "roll = 'a'"),
        (lambda: uav.go_to((1.0, 0.0, 1.0), 90.0), r"yaw = 90 rad.* not degrees"),
        (lambda: uav.go_to_geo(91.0, 0.0, 0.0), "latitude = 91 deg; valid: -90 to 90"),
    ):
        with pytest.raises(InputError, match=words):
            call()


def test_without_an_origin_or_a_home_the_reason_is_told(hovering):
    vehicle = skywright.build_vehicle("waypoints")
    uav = Uav(vehicle)
    assert vehicle.world.origin is None and Origin(latitude_deg=1.0, longitude_deg=2.0)
    for handle in (uav.go_to_geo(1.0, 2.0, 3.0), uav.go_home(), uav.stop_motors()):
        assert handle.done and not handle and "refused" in handle.result.reason
    assert "`confirm=True`" in uav.stop_motors().result.reason
