"""Commands of the arms: refusals, ends, streams that age, poses around take-off and landing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import skywright
from skywright.core.types import TASK_FORCE, TASK_JOINTS, TASK_POSITION, TASK_VELOCITY
from skywright.errors import InputError
from skywright.models.rigid_body import posture
from skywright.run.session import STREAMS
from skywright.vehicle.arm_commands import ARM_TABLE, ArmCommand
from skywright.vehicle.arms.ports import Hands
from skywright.vehicle.commanded_arms import CommandedArms
from skywright.vehicle.commands import NEEDS, State
from skywright.vehicle.motions import Arrival
from skywright.vehicle.uav import Uav

QUICK = Arrival(tolerance_m=0.3, dwell_s=0.1, yaw_rad=0.3)
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def flown():
    """The dual-arm robot in the air with its arms at the operation pose, and its saved state."""
    vehicle = skywright.build_vehicle(skywright.load("waypoints", robot="bimanual"))
    uav = Uav(vehicle, arrival=QUICK, waits=True)
    while uav.state == State.UNINITIALIZED:
        uav.tick()
    assert uav.take_off(1.2)
    arms = CommandedArms(uav)
    assert arms.operation_pose().result
    return vehicle, vehicle.save()


@pytest.fixture
def both(flown):
    vehicle, air = flown
    vehicle.restore(air)
    uav = Uav(vehicle, arrival=QUICK, waits=True)
    return uav, CommandedArms(uav)


def hand(uav, h=0):
    return np.array(uav.backend.look(Hands).p_WH[h])


def test_the_table_names_every_command_and_each_is_a_method():
    assert set(ARM_TABLE) == set(ArmCommand)
    for command, entry in ARM_TABLE.items():
        assert entry.says and entry.needs and callable(getattr(CommandedArms, command))
        assert all(need in NEEDS for need in entry.needs)
    assert {"tips", "forces", "deflections", "torques"} < set(STREAMS)


def test_a_hand_comes_to_a_point_and_one_out_of_reach_is_told(both):
    uav, arms = both
    goal = hand(uav) + [0.03, 0.02, 0.02]
    assert arms.hands_to({"left": goal}).result == (True, "", uav.backend.t)
    assert np.linalg.norm(hand(uav) - goal) < 0.025
    far = arms.hands_to({"left": goal + [1.0, 0.0, 0.0]}).result
    assert not far and "left hand" in far.reason and "m from its goal" in far.reason
    other = arms.hands_to({"left": goal}, wait=False)
    assert not other.done and uav.mode == "motion"
    assert uav.go_to(uav.backend.estimate["p_WB"] + [0.2, 0.0, 0.0]).result
    assert other.result.reason == "interrupted by go_to"
    assert uav.backend.reference["task"][0] == TASK_POSITION  # the task of the hand goes on


def test_joints_take_their_play_time(both):
    uav, arms = both
    q, start = np.array(uav.backend.reference["q"])[: uav.backend.n_joints], uav.backend.t
    assert arms.move_to(q + 0.1, seconds=3.0).result
    assert 3.0 <= uav.backend.t - start < 4.0
    with pytest.raises(InputError, match="q = "):
        arms.move_to([0.0])
    with pytest.raises(InputError, match="hand 'middle' is unknown; valid: left, right"):
        arms.hands_to({"middle": hand(uav)})
    with pytest.raises(InputError, match="finite"):
        arms.hands_to({"left": [np.nan, 0.0, 0.0]})


FAR = (1e300, 0.0, 1.0)
WRONG = [
    lambda u, a: u.go_to(FAR), lambda u, a: u.go_to((1e7, 0.0, 1.0)), lambda u, a: u.set_pose(FAR),
    lambda u, a: u.land(1e9), lambda u, a: u.set_joints(np.full(u.backend.n_joints, 1e6)),
    lambda u, a: u.wait(np.nan), lambda u, a: u.wait("long"),
    lambda u, a: a.move_to(np.full(u.backend.n_joints, 3.0)), lambda u, a: a.hands_to({}),
    lambda u, a: a.hands_to([1, 2, 3]), lambda u, a: a.push({}), lambda u, a: a.push(None),
    lambda u, a: a.grasp(1.0, np.zeros(3), np.zeros(3)), lambda u, a: a.set_hands({}),
    lambda u, a: a.bar_to(np.zeros(3), np.zeros(3), 0.2), lambda u, a: a.set_forces({"left": FAR}),
    lambda u, a: a.hands_velocity({"left": FAR}), lambda u, a: a.hands_to({"left": FAR}),
]  # fmt: skip


@pytest.mark.parametrize("n", range(len(WRONG)))
def test_extreme_values_are_refused_or_told_and_the_flight_goes_on(both, n):
    """An InputError or a handle with the reason; nothing half begun stays behind."""
    uav, arms = both
    uav.waits = False
    try:
        handle = WRONG[n](uav, arms)
    except InputError as error:
        assert str(error)
    else:
        assert not handle.done or handle.result.reason or n in (12, 14)
    for _ in range(25):
        uav.tick()
    row = uav.backend.reference
    assert all(np.all(np.isfinite(row[name])) for name in row.dtype.names)
    assert uav.state == State.FLYING_AUTO
    assert uav.hold(wait=True)


def test_a_joint_beyond_its_range_is_refused_with_the_range(both):
    uav, arms = both
    q = np.array(uav.backend.reference["q"])[: uav.backend.n_joints]
    q[1] = 3.0
    for handle in (arms.move_to(q), uav.set_joints(q)):
        assert "q[1] = 3 rad" in handle.result.reason and "turns from" in handle.result.reason


def test_a_take_off_to_where_it_stands_is_refused():
    plain = skywright.fly(backend="kinematic", arrival=QUICK)
    stands = float(plain.backend.estimate["p_WB"][2])
    for height in (-5.0, stands, stands + 0.09):
        says = plain.take_off(height).result.reason
        assert says.startswith(f"take_off refused: height = {height:g} m; valid: ")
        assert plain.state == State.LANDED_DISARMED
    assert plain.take_off(1.0).result


def test_what_the_vehicle_or_the_state_lacks_is_refused_with_the_reason(both):
    _, arms = both
    assert "feels" in _refusal(arms)
    free = arms.push({"left": 3.0 * UP}).result  # in free air nothing is felt
    assert not free and "of 3.00 N" in free.reason
    plain = skywright.fly(backend="kinematic", arrival=QUICK)
    landed = plain.arms.rest_pose().result
    assert landed.reason.startswith("rest_pose refused: the state is landed_disarmed")
    plain.take_off(1.0)
    assert plain.arms.rest_pose().result.reason == "rest_pose refused: the vehicle offers no arms"
    assert "offers no hands" in plain.arms.grasp(2.0, [1, 0, 1], [1, 0.1, 1]).result.reason


def _refusal(arms):
    with pytest.raises(InputError) as refused:
        arms.sense_position("left")
    return str(refused.value)


@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(what=st.sampled_from(["p", "v", "f"]), x=st.lists(st.floats(-1, 1), min_size=3, max_size=3),
       ticks=st.integers(1, 20))  # fmt: skip
def test_a_stream_that_falls_silent_stops_the_hand(flown, what, x, ticks):
    vehicle, air = flown
    vehicle.restore(air)
    uav = Uav(vehicle, arrival=QUICK, waits=True)
    arms, x = CommandedArms(uav), np.array(x)
    start = hand(uav)
    for _ in range(ticks):
        if what == "p":
            arms.set_hands({"left": start + 0.03 * x})
        elif what == "v":
            arms.hands_velocity({"left": 0.03 * x})
        else:
            arms.set_forces({"left": x})
        uav.tick()
    row = uav.backend.reference
    assert row["task"][0] == {"p": TASK_POSITION, "v": TASK_VELOCITY, "f": TASK_FORCE}[what]
    assert row["task"][1] == TASK_JOINTS  # the other arm is left alone
    uav.wait(1.2)
    row = uav.backend.reference
    assert row["task"][0] == TASK_POSITION and not np.any(row["f_WH"][0])
    stays = np.array(row["p_WH"][0])
    uav.wait(1.0)
    np.testing.assert_array_equal(uav.backend.reference["p_WH"][0], stays)


def test_an_arm_without_torque_gives_way_and_is_held_again(both):
    uav, arms = both
    assert arms.torque_off("left").result
    uav.backend.devices.helper.push("hand0", np.array([0.0, 0.0, -2.0]))
    before = hand(uav)
    uav.wait(1.0)
    moved = hand(uav) - before
    uav.backend.devices.helper.push("hand0", np.zeros(3))
    assert moved[2] < -0.05
    assert arms.torque_on("left").result
    uav.wait(1.5)
    held = hand(uav)
    uav.wait(1.0)
    assert np.linalg.norm(hand(uav) - held) < 0.02


def test_arms_fold_before_the_robot_lands(both):
    uav, _ = both
    assert uav.land().result and uav.state == State.LANDED_DISARMED
    q, folded = uav.backend.reference["q"], posture(uav.backend.robot, "folded")
    np.testing.assert_allclose(q[: len(folded)], folded, atol=1e-4)


def test_a_platform_that_moves_brakes_before_its_arms_move(both):
    uav, arms = both
    for _ in range(60):
        uav.set_velocity((0.4, 0.0, 0.0))
        uav.tick()
    before = np.array(uav.backend.reference["v_WB"])
    handle = arms.rest_pose(wait=False)
    uav.tick()
    change = np.linalg.norm(uav.backend.reference["v_WB"] - before)
    assert change < 2.0 * 0.02 * uav.backend.limits.acceleration  # no jump of the reference
    assert handle.wait()


def test_a_hand_that_stays_in_place_tells_where_the_platform_is(both):
    uav, arms = both
    arms.hands_to({"left": hand(uav)})
    uav.backend.devices.helper.push("hand0", np.array([0.0, 0.0, -1.5]))  # it rests on something
    uav.wait(2.0)
    sensor = arms.sense_position("left")
    start = np.array(uav.backend.sim.data.qpos[:3])
    np.testing.assert_allclose(sensor.read(), uav.backend.estimate["p_WB"], atol=1e-3)
    uav.go_to(uav.backend.reference["p_WB"] + [0.05, 0.0, 0.03])
    uav.wait(2.0)
    uav.backend.devices.helper.push("hand0", np.zeros(3))
    moved = uav.backend.sim.data.qpos[:3] - start
    assert np.linalg.norm(moved) > 0.04
    assert np.linalg.norm(sensor.read() - uav.backend.estimate["p_WB"]) < 0.015


BAD = [float("nan"), float("inf"), -0.1, 0.0]


@pytest.mark.parametrize("bad", BAD)
def test_a_number_that_is_not_finite_or_not_above_zero_is_refused_by_name(both, bad):
    """NaN never reaches a command, and nothing has moved after a refusal."""
    _, arms = both
    there = {"left": [0.3, 0.2, 1.0]}
    for name, call in {
        "seconds": lambda: arms.move_to(np.zeros(arms._uav.backend.n_joints), bad),
        "speed": lambda: arms.hands_to(there, bad),
        "ramp_s": lambda: arms.push(there, ramp_s=bad),
        "force": lambda: arms.grasp(bad, [0.3, 0.2, 1.0], [0.3, -0.2, 1.0]),
        "width": lambda: arms.bar_to([0.3, 0.0, 1.0], [0.0, 1.0, 0.0], bad),
    }.items():
        with pytest.raises(InputError, match=rf"^{name} = "):
            call()
    with pytest.raises(InputError, match="speed = "):
        arms.set_hands(there, bad)
    with pytest.raises(InputError, match="seconds = "):
        arms.tare(bad)
