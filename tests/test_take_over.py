"""A pilot takes a running mission over, and gives it back: what is flown then, and what is told."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import skywright
from short_mission import HOP
from skywright.core.types import REFERENCE
from skywright.run.hand_flight import SPEED
from skywright.run.pilot import AGAIN_S, TakenOver, build_rest_of
from skywright.run.run import run_mission
from skywright.vehicle.rest_to_rest import ROW_PERIOD, build_straight

POINTS = (
    "mission.task.points=[{ x_m = 0.8, y_m = 0.0, z_m = 1.2, hold_s = 2.0 },"
    "{ x_m = 0.0, y_m = 0.4, z_m = 1.0, hold_s = 2.0 }]",
    "mission.hover_height_m=0.8",
    "mission.timestep_ms=2",
)


class Switch:
    """Takes over at a time, moves the stick for a while, brakes and gives back, or not."""

    def __init__(self, at, seconds=1.5, stick=(0.0, 0.2, 0.2, 0.3), gives=True, again=()):
        self.at, self.seconds, self.stick, self.gives = [at, *again], seconds, list(stick), gives
        self.results, self.phases, self.acted, self.began = [], [], [], 0.0

    def on_plan(self, plan, description):
        pass

    def on_supervisor(self, supervisor):
        self.s = supervisor

    def on_acted(self, acted):
        self.acted.append((acted.rule, acted.response))

    def on_tick(self, t, phase, vehicle):
        if phase not in self.phases[-1:]:
            self.phases.append(phase)
        if self.at and t >= self.at[0]:
            self.at.pop(0)
            self.began = t
            self.results.append(self.s.take_over())
        if self.s.pilot.flies and self.stick is not None and t < self.began + 10.0:
            self.s.move_stick(self.stick)
        has = self.s.pilot.flies and self.s.pilot.switch
        if has and self.gives and t > self.began + self.seconds:
            v = vehicle.estimate["R_WB"].T @ vehicle.estimate["v_WB"]
            self.s.move_stick([*np.clip([v[1], -v[0]], -1.0, 1.0), 0.0, 0.5])
            if abs(v[0]) + abs(v[1]) < 0.3 and vehicle.estimate["p_WB"][2] > 0.6:
                self.results.append(self.s.give_back())

    def close(self):
        pass


def fly(folder: Path, switch: Switch, *sets: str, backend="kinematic"):
    return run_mission(
        skywright.load("waypoints", sets=(*POINTS, *sets)), out=folder / "run", observers=[switch],
        backend=backend,
    )  # fmt: skip


@pytest.mark.parametrize("backend", ["kinematic", "physics"])
def test_a_phase_of_free_flight_goes_on_where_it_was_taken_over(tmp_path, backend):
    switch = Switch(7.0)
    result = fly(tmp_path, switch, backend=backend)
    assert result.outcome == "succeeded", result.reason
    names = [(p.name, p.outcome) for p in result.phases]
    at = names.index(("manual", "done"))
    phase = names[at - 1][0]
    assert names[at - 1 : at + 3] == [
        (phase, "taken over"), ("manual", "done"), ("rejoin", "done"), (phase, "done"),
    ]  # fmt: skip
    manual, on = result.phases[at], result.phases[at + 2]
    s = result.samples
    left, back = np.searchsorted(s["t"], [manual.start_s, on.start_s + 0.02])
    by_hand = s["p_WB"][(s["t"] > manual.start_s) & (s["t"] < manual.end_s)]
    assert np.linalg.norm(by_hand - by_hand[0], axis=1).max() > 0.1  # the stick moved it
    gap = s["ref_p_WB"][left - 1] - s["ref_p_WB"][back]
    assert np.linalg.norm(gap) < 0.02  # and it came back
    steps = np.linalg.norm(np.diff(s["ref_p_WB"], axis=0), axis=1)
    assert steps[s["t"][1:] > manual.end_s + 0.02].max() < 0.03  # nothing is jumped from then on


@pytest.mark.parametrize("at, stick, gives, says", [
    (7.0, None, False, "was silent for 5 s"),
    (7.0, (0.0, 0.0, 0.0, -1.0), False, "the pilot took over in .* and landed"),
])  # fmt: skip
def test_a_pilot_who_is_gone_or_lands_ends_the_mission(tmp_path, at, stick, gives, says):
    switch = Switch(at, stick=stick or (0, 0, 0, 0), gives=gives)
    if stick is None:
        switch.stick = None
    result = fly(tmp_path, switch)
    assert result.outcome == "aborted"
    assert __import__("re").search(says, result.reason), result.reason
    assert result.samples["p_WB"][-1, 2] < 0.4
    assert result.metrics["flight.duration_s"] < 60.0


def test_the_switch_wins_over_a_rule_that_acts_and_the_response_is_flown_after_it(tmp_path):
    switch = Switch(9.0)
    fence = ("mission.fence.x_max_m=0.2",)
    result = fly(tmp_path, switch, *fence)
    assert [r.ok for r in switch.results] == [True, True]
    names = [p.name for p in result.phases]
    assert names.count("manual") == 1 and result.outcome == "aborted"
    assert "geofence" in result.reason
    where = names.index("manual")
    assert "come home" in names[where:]
    home = result.samples["p_WB"][-1]
    assert np.hypot(home[0], home[1]) < 0.2 and home[2] < 0.4


def test_rules_only_tell_while_the_pilot_flies(tmp_path):
    switch = Switch(6.0, seconds=4.0, stick=(0.0, 0.3, 0.0, 0.0))
    result = fly(tmp_path, switch, "mission.fence.x_max_m=1.0")
    told = [a for a in switch.acted if a[1] == "told"]
    assert told == [("geofence", "told")], switch.acted
    assert result.outcome == "aborted" and "geofence" in result.reason  # it was outside at the end


def test_after_a_rule_has_held_the_robot_comes_home(tmp_path):
    """The other responses are flown again: docs/howto/faults.md."""
    held = ("mission.fence.x_max_m=0.2", "mission.faults.geofence.response=hold")
    result = fly(tmp_path, Switch(9.0), *held)
    names = [p.name for p in result.phases]
    assert names[names.index("manual") - 1] == "hold" and names.count("hold") == 1
    assert names[names.index("manual") + 1] == "come home" and result.outcome == "aborted"


COMPUTER = (
    "plant.faults.a.kind=computer", "plant.faults.a.start_s=7", "plant.faults.a.again=true"
)  # fmt: skip
LINK = (
    "world.link.delay_s=0.001", "plant.faults.a.kind=link", "plant.faults.a.start_s=7",
    "plant.faults.a.for_s=0.7",
)  # fmt: skip


@pytest.mark.parametrize(
    "sets, rule, own",
    [
        (COMPUTER, "computer_failed", False),
        (COMPUTER, "computer_failed", True),
        (LINK, "link_lost", False),
    ],
)
def test_a_pilot_does_not_start_motors_that_a_rule_has_stopped(tmp_path, sets, rule, own):
    """The switch stays on, also `own` of the vehicle, and the link is back after 0.7 s."""

    class Held(Switch):
        active = ()

        def on_tick(self, t, phase, vehicle):
            if own and t > 6.0:
                vehicle.piloted = True
            super().on_tick(t, phase, vehicle)
            if phase == "let go":
                self.active = (*self.active, float(vehicle.reference["active"]))
                self.again = self.s.take_over()

    switch = Held(6.0, stick=(0.0, 0.0, 0.0, 0.0), gives=False)
    result = fly(tmp_path, switch, *sets, backend="physics")
    assert [p.name for p in result.phases[-2:]] == ["manual", "let go"]
    last = result.acted[-1]
    assert (last.rule, last.response) == (rule, "let_go") and last.t_s < 7.6
    assert len(switch.active) > 100 and not any(switch.active)
    assert switch.again.reason == "take_over refused: the motors are off"
    s = result.samples
    assert s["rotor_thrust"][s["t"] > last.t_s + 0.5].max() < 0.2  # they run down
    assert s["p_WB"][-1, 2] < 0.4


def test_wrong_sticks_modes_and_orders_are_refused_and_large_ones_limited(tmp_path):
    class Wild(Switch):
        def on_tick(self, t, phase, vehicle):
            if self.s.pilot.flies and len(self.results) == 1:
                move = self.s.move_stick
                self.results += [move([math.nan, 0.0, 0.0, 0.0]), move([1.0, 0.0]), move(["a"] * 4)]
                self.results += [self.s.choose_mode("acro"), self.s.order("abort")]
            super().on_tick(t, phase, vehicle)

    switch = Wild(7.0, seconds=0.6, stick=(5.0, 0.0, 0.0, 2.0))
    result = fly(tmp_path, switch, backend="physics")
    words = ", 0.0, 0.0, 0.0] refused: valid: four finite numbers from -1 to 1: right, ahead"
    assert words in switch.results[1].reason
    assert [r.ok for r in switch.results] == [True, *5 * [False], True]
    assert switch.results[4].reason == "mode 'acro' refused: valid: position, angle, attitude"
    assert switch.results[5].reason == "order 'abort' refused: valid: next, retry, retract"
    assert result.outcome == "succeeded", result.reason
    s = result.samples
    (manual,) = [p for p in result.phases if p.name == "manual"]
    _, x, y, _ = s["ref_q_WB"][(s["t"] > manual.start_s) & (s["t"] < manual.start_s + 0.5)].T
    tilt = np.degrees(np.arccos(1.0 - 2.0 * (x**2 + y**2)))
    assert tilt.max() == pytest.approx(15.0, abs=1e-6)  # and 75 deg for a stick of 5


def test_the_switch_is_refused_on_the_ground_and_before_it_was_taken(tmp_path):
    early = Switch(0.5)
    result = fly(tmp_path, early)
    assert result.outcome == "succeeded"
    assert early.results[0].reason == "take_over refused: the motors are off"
    assert early.s.give_back().reason == "give_back refused: no pilot has taken over"


class Hand(Switch):
    """A pilot in a mode: each stick for a time (s), then gives back."""

    def __init__(self, mode, *sticks, at=7.0):
        super().__init__(at, gives=False)
        self.stick = None
        self.mode, self.sticks, self.seen, self.lacks = mode, sticks, [], []

    def on_tick(self, t, phase, vehicle):
        if not self.results:
            super().on_tick(t, phase, vehicle)
            if self.results:
                self.results.append(self.s.choose_mode(self.mode))
            return
        super().on_tick(t, phase, vehicle)
        if not (self.s.pilot.flies and self.s.pilot.switch):
            return
        gone = t - self.began
        for stick, seconds in self.sticks:
            if gone < seconds:
                self.s.move_stick(list(stick))
                est = vehicle.estimate
                self.seen.append(
                    (t, np.array(est["p_WB"]), np.array(est["v_WB"]), est["R_WB"][2, 2])
                )
                self.lacks.append(self.s.pilot.flown)
                return
            gone -= seconds
        self.results.append(self.s.give_back())


def test_in_position_mode_the_stick_is_a_velocity_and_let_go_it_brakes(tmp_path):
    hand = Hand("position", ((0.0, 1.0, 0.0, 0.0), 4.0), ((0.0, 0.0, 0.0, 0.0), 2.0))
    result = fly(tmp_path, hand)
    assert result.outcome == "succeeded", result.reason
    assert all(r.ok for r in hand.results), hand.results
    assert set(hand.lacks[3:]) == {"position"}
    speed = [float(np.linalg.norm(v)) for _, _, v, _ in hand.seen]
    assert max(speed) == pytest.approx(SPEED, rel=0.05)  # a full axis
    assert speed[-1] < 0.02
    late = [p for t, p, *_ in hand.seen if t > hand.seen[-1][0] - 0.5]
    assert np.linalg.norm(late[-1] - late[0]) < 0.01  # it holds its place


def test_a_robot_with_parallel_rotors_has_no_angle_mode(tmp_path):
    hand = Hand("angle", ((0.0, 0.0, 0.0, 0.0), 0.5))
    fly(tmp_path, hand)
    assert hand.results[1].reason == (
        "angle mode refused: hexarotor cannot tilt in place, its rotors are parallel"
    )


def test_in_angle_mode_a_tilted_robot_leans_in_place(tmp_path):
    hand = Hand("angle", ((0.0, 1.0, 0.0, 0.0), 4.0), ((0.0, 0.0, 0.0, 0.0), 3.0), at=9.0)
    sets = ("mission.robot=f550-bridge", "mission.timestep_ms=1")
    result = fly(tmp_path, hand, *sets, backend="physics")
    assert all(r.ok for r in hand.results), hand.results
    lean = [math.degrees(math.acos(min(z, 1.0))) for *_, z in hand.seen]
    p = np.array([p for _, p, *_ in hand.seen])
    assert max(lean) > 3.0 and lean[-1] < 1.0
    assert np.linalg.norm(p[-1] - p[100]) < 0.15  # it leans where it is
    assert result.outcome == "succeeded", result.reason


def test_without_a_position_the_stick_tilts_the_robot_and_the_reason_is_told(tmp_path):
    hand = Hand("position", ((0.0, 0.0, 0.0, 0.2), 3.0), ((0.0, 0.0, 0.0, 0.0), 2.5))
    lost = (
        'plant.faults.blind.kind="localisation"', "plant.faults.blind.start_s=8.0",
        "plant.faults.blind.for_s=1.5", "mission.faults.localisation_lost.on=false",
    )  # fmt: skip
    fly(tmp_path, hand, *lost, backend="physics")
    assert "attitude" in hand.lacks[60:150] and hand.lacks[-1] == "position"
    assert hand.lacks[30] == "position"


@settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    at=st.lists(st.floats(1.2, 9.0), min_size=1, max_size=3).map(sorted),
    stick=st.lists(st.floats(-0.3, 0.3), min_size=4, max_size=4),
    seconds=st.floats(0.1, 1.5),
)
def test_at_any_time_and_again_the_switch_is_obeyed(tmp_path_factory, at, stick, seconds):
    stick[3] = abs(stick[3])
    switch = Switch(at[0], seconds, stick, again=at[1:])
    result = fly(tmp_path_factory.mktemp("switch"), switch, *HOP)
    assert result.outcome in ("succeeded", "aborted", "failed")
    assert all(r.ok or "motors are off" in r.reason for r in switch.results), switch.results
    if any(r.ok for r in switch.results):
        assert "manual" in [p.name for p in result.phases]
    assert np.all(np.isfinite(result.samples["ref_p_WB"]))
    assert result.samples["p_WB"][-1, 2] < 0.4  # down, in one way or another


@given(along=st.floats(0.0, 3.0), far=st.floats(0.05, 2.0))
@settings(deadline=None)
def test_the_rest_of_a_reference_starts_at_rest_and_ends_where_it_did(along, far):
    start = np.zeros(1, REFERENCE)[0]
    start["R_WB"] = start["R_WT"] = start["R_WS"] = np.eye(3)
    table = build_straight(start, start, np.array([far, 0.0, 0.0]), 3.0)[0]
    row = table[min(int(along / ROW_PERIOD), len(table) - 1)].copy()
    row["t"] = along
    row["p_WB"] = [np.interp(along, table["t"], table["p_WB"][:, k]) for k in range(3)]
    rest = build_rest_of(TakenOver("a", row, table, along, False))
    assert rest["t"][0] == 0.0 and np.all(np.diff(rest["t"]) > 0.0)
    assert np.allclose(rest[0]["v_WB"], 0.0)
    np.testing.assert_allclose(rest[-1]["p_WB"], table[-1]["p_WB"], atol=1e-12)
    if len(rest) > 2:
        told = np.interp(0.5 * (rest["t"][1:] + rest["t"][:-1]), rest["t"], rest["v_WB"][:, 0])
        moved = np.diff(rest["p_WB"][:, 0])
        assert np.abs(moved - told * np.diff(rest["t"])).max() < 0.01
        assert rest["t"][-1] <= table["t"][-1] - along + math.ceil(AGAIN_S)
