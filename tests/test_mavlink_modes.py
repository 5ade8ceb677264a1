"""Modes of the MAVLink vehicle: chosen before arming, refused, and while a fault rule flies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from mavlink_talk import Talk, begin, build, fly
from skywright.description.mission.safety import Fence
from skywright.links.mavlink import modes
from skywright.vehicle.commands import State

ACCEPTED, REJECTED = 0, 1


@pytest.fixture(scope="module")
def hexarotor() -> Any:
    return build("hexarotor")


@pytest.fixture
def talk(hexarotor: Any) -> Talk:
    return begin(hexarotor)


def test_takeoff_chosen_on_the_ground_begins_when_armed(talk: Talk) -> None:
    """QGroundControl and pymavlink scripts set the mode before they arm."""
    assert talk.command(176, 1.0, 4.0, 2.0) == ACCEPTED
    talk.tick(1.0)
    assert talk.last("HEARTBEAT").custom_mode == 4 << 16 | 2 << 24
    assert talk.command(400, 1.0) == ACCEPTED
    talk.until(lambda: talk.vehicle.state == State.FLYING_AUTO)
    talk.tick(1.0)
    assert talk.last("HEARTBEAT").custom_mode == 4 << 16 | 3 << 24
    robot = talk.service.robot
    risen = talk.vehicle.backend.estimate["p_WB"][2] - robot.home[2]
    assert risen == pytest.approx(robot.parameters["MIS_TAKEOFF_ALT"], abs=0.2)


def test_a_take_off_that_failed_is_not_tried_again_by_arming(talk: Talk) -> None:
    assert talk.command(176, 1.0, 4.0, 2.0) == ACCEPTED  # Takeoff
    assert talk.command(400, 1.0) == ACCEPTED
    talk.until(lambda: talk.vehicle.state == State.TAKING_OFF)
    assert talk.command(400, 0.0, 21196.0) == ACCEPTED  # termination during the climb
    talk.until(lambda: talk.vehicle.state == State.LANDED_DISARMED)
    assert talk.mode() == (4, 3)  # Hold
    assert talk.command(400, 1.0) == ACCEPTED
    talk.until(lambda: talk.vehicle.state == State.LANDED_ARMED)
    talk.tick(2.0)
    assert talk.vehicle.state == State.LANDED_ARMED


def test_a_stick_mode_of_an_earlier_flight_leaves_the_ground_by_the_stick_only(talk: Talk) -> None:
    assert talk.command(176, 1.0, 2.0) == ACCEPTED  # Altitude
    assert talk.command(400, 1.0) == ACCEPTED
    talk.until(lambda: talk.vehicle.state == State.LANDED_ARMED)
    talk.tick(2.0)
    assert talk.vehicle.state == State.LANDED_ARMED
    assert talk.command(400, 0.0) == ACCEPTED  # and is disarmed
    assert talk.command(400, 1.0) == ACCEPTED
    fly_up = (22, 0, 0, 0, math.nan, math.nan, math.nan, 1.5)
    assert talk.command(*fly_up) == ACCEPTED
    talk.until(lambda: talk.vehicle.state == State.FLYING_AUTO)


def test_a_rule_s_response_is_not_replaced_by_commands(talk: Talk) -> None:
    fly(talk)
    rule = next(r for r in talk.service.supervisor.faults.rules if r.name == "battery_low")
    rule.look = lambda v: 1e9  # type: ignore[method-assign]
    robot = talk.service.robot
    seen: list[Any] = []
    polled = talk.service.server.poll

    def poll() -> None:
        if robot.flies_itself and not seen:
            seen.append(robot.reposition(np.array([1.0, 0.0, 1.5]), None))
            seen.append(robot.take_off(None))
            seen.extend(robot.choose(m) for m in (modes.ALTITUDE, modes.POSITION, modes.HOLD))
        polled()

    talk.service.server.poll = poll  # type: ignore[method-assign]
    talk.until(lambda: bool(seen) and talk.vehicle.state == State.LANDED_DISARMED, 60.0)
    assert all(reply.result == REJECTED and "a rule flies" in reply.says for reply in seen)
    assert not talk.service.robot.armed
    assert np.linalg.norm(talk.estimate["p_WB"][:2]) < 0.3  # it came home


def test_a_flight_termination_ends_a_rule_s_response(talk: Talk) -> None:
    fly(talk)
    rule = next(r for r in talk.service.supervisor.faults.rules if r.name == "battery_low")
    rule.look = lambda v: 1e9  # type: ignore[method-assign]
    robot, polled, turned = talk.service.robot, talk.service.server.poll, list[bool]()

    def poll() -> None:
        if robot.flies_itself and not turned:
            assert robot.disarm(force=True).result == ACCEPTED
        if robot.flies_itself:
            turned.append(robot.armed)
        polled()

    talk.service.server.poll = poll  # type: ignore[method-assign]
    talk.until(lambda: bool(turned) and talk.vehicle.state == State.LANDED_DISARMED, 60.0)
    assert not any(turned[2:])  # the motors stay off while it falls
    assert "flight termination" in " ".join(talk.vehicle.acted)


def test_a_stick_mode_chosen_before_arming_flies(talk: Talk) -> None:
    assert talk.command(176, 1.0, 2.0) == ACCEPTED  # Altitude
    assert talk.command(400, 1.0) == ACCEPTED
    talk.stream_of = lambda: common.MAVLink_manual_control_message(1, 0, 0, 900, 0, 0)
    talk.until(lambda: talk.vehicle.state == State.FLYING_MANUAL)
    talk.until(lambda: talk.estimate["p_WB"][2] > 0.5)
    talk.stream_of = None
    assert talk.command(20) == ACCEPTED  # return: the place that was left is home
    talk.until(lambda: talk.vehicle.state == State.LANDED_DISARMED, 60.0)


def test_a_refused_goal_leaves_control_with_the_pilot(talk: Talk) -> None:
    fly(talk)
    talk.vehicle.fence = Fence(x_max_m=0.5)
    assert talk.command(176, 1.0, 2.0) == ACCEPTED  # Altitude
    robot = talk.service.robot
    refused = robot.reposition(np.array([3.0, 0.0, 1.5]), None)
    assert refused.result == REJECTED and "fence" in refused.says
    assert talk.vehicle.state == State.FLYING_MANUAL
    talk.vehicle._fly.home = None
    assert robot.choose(modes.RETURN).result == REJECTED
    assert talk.vehicle.state == State.FLYING_MANUAL


def test_hold_stops_a_reposition(talk: Talk) -> None:
    fly(talk)
    robot = talk.service.robot
    assert robot.reposition(np.array([3.0, 0.0, 1.5]), None).result == ACCEPTED
    talk.tick(1.5)
    assert talk.estimate["v_WB"][0] > 0.3
    assert robot.choose(modes.HOLD).result == ACCEPTED
    talk.tick(3.0)
    assert np.linalg.norm(talk.estimate["v_WB"]) < 0.1 and talk.estimate["p_WB"][0] < 2.0
