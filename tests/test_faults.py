"""Faults of the plant, the rules that answer them, and what is flown then."""

from __future__ import annotations

import importlib.util
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from exact_map import EXACT
from skywright import cli
from skywright.core.find import find, list_kinds
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.models.capability import compute_capability
from skywright.models.rigid_body import build_body_model
from skywright.recordings.recording import read_recording
from skywright.run.faults._response import respond
from skywright.run.faults._rule import RESPONSES, Follow
from skywright.run.faults._watch import RuleActed, Watch
from skywright.run.parts import build_named, build_rules
from skywright.run.planning import plan_mission
from skywright.run.run import evaluate_directory, fly_and_evaluate, run_mission
from skywright.vehicle.link_arc import compute_link_arc, plan_landing
from skywright.vehicle.readings import ImuBatch
from user_parts import HOVER, write_law

ROOT = Path(__file__).parents[1]


def load_script(path):
    spec = importlib.util.spec_from_file_location(Path(path).stem, ROOT / path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


JUDGE = load_script("benchmarks/judge_faults.py")
SHORT_SCAN = [*EXACT, "mission.task.passes=1", "mission.task.pass_length_m=0.03"]


def fly(mission, fault, more=(), **keys):
    """Fly with one fault; returns the result."""
    sets = SHORT_SCAN if mission == "pipe-weld-scan" else EXACT
    sets = sets[len(EXACT) :] if fault == "bump" else sets  # the plan with a survey is in free air
    sets = [
        *sets,
        "mission.timestep_ms=2",
        *more,
        f"plant.faults.a.kind={fault}",
        *(f"plant.faults.a.{k}={v}" for k, v in keys.items()),
    ]
    return fly_and_evaluate(load_description(mission, sets=sets))


def check_down(result, rule, start, within, response=None):
    """The rule acted soon after the fault, and the robot is down without having hit anything."""
    acted = result.acted[0]
    assert acted.rule == rule, result.reason
    assert start <= acted.t_s <= start + within
    assert result.outcome == "aborted"
    assert acted.says in result.reason
    if response is not None:
        assert acted.response == response
    s = result.samples
    stands = result.description.robot.platform.gear_height_m
    assert s["p_WB"][-1, 2] < stands + 0.05
    assert np.linalg.norm(s["v_WB"][-1]) < 0.1
    assert s["rotor_thrust"][-1].sum() < 0.5
    free = 1.0 if result.description.robot.pendulum is not None else 0.05  # a link lies down
    begins = s["t"][JUDGE.list_collisions(s, s["p_WB"][:, 2] > stands + free)]
    assert not np.any(begins > acted.t_s), begins


# --- data ----------------------------------------------------------------------------------------


def test_every_rule_is_in_every_mission_and_can_be_set():
    d = load_description("waypoints", sets=["mission.faults.excess_force.limit=7"])
    rules = {r.name: r for r in build_rules(d)}
    assert set(rules) == set(list_kinds("rule"))
    assert rules["excess_force"].table.limit == 7.0
    for rule in rules.values():
        assert rule.watches and rule.source and rule.table.response in RESPONSES


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("mission.faults.excess_force.limt=7", "limt"),
        ("mission.faults.excess_froce.limit=7", "excess_froce"),
        ("mission.faults.saturation.response='pray'", "let_go"),
        ("plant.faults.a.kind=gremlin", "joint"),
    ],
)
def test_unknown_keys_are_refused_with_what_is_valid(key, message):
    with pytest.raises(InputError, match=message):
        load_description("waypoints", sets=[key])


def test_a_resolved_mission_keeps_its_rules(tmp_path):
    from skywright.description.dump import dump_description

    d = load_description("waypoints", sets=["mission.faults.saturation.limit=0.25"])
    (tmp_path / "mission.toml").write_text(dump_description(d))
    again = load_description(tmp_path / "mission.toml")
    assert again.mission.faults == d.mission.faults


def test_a_rule_from_a_file_acts(tmp_path, monkeypatch):
    (tmp_path / "my_rule.py").write_text(
        "from skywright.run.faults import Rule\n\n\n"
        "class TooHigh(Rule):\n"
        "    watches, unit = 'estimated height', 'm'\n\n"
        "    def look(self, v):\n"
        "        return float(v.estimate['p_WB'][2])\n"
    )
    monkeypatch.chdir(tmp_path)
    sets = ["mission.faults.too_high.kind=my_rule.py:TooHigh", "mission.faults.too_high.limit=0.9"]
    result = fly_and_evaluate(load_description("waypoints", "othex", sets=sets))
    check_down(result, "too_high", 0.0, 10.0)


RULE = """
from skywright.run.faults import Rule


class Mine(Rule):
    def look(self, v):
        return -1.0
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("    def look(self, v):\n        return -1.0", "    unit = 'm'", "has no method look"),
        ("    def", "    every = 0\n\n    def", "every is 0; valid: whole numbers from 1"),
        ("    def", "    class Table(Rule.Table):\n        response: str = 'pray'\n\n    def",
         "response is 'pray'; valid: hold, come_home"),
        ("    def", "    def __init__(self, *a):\n        1 / 0\n\n    def",
         r"mission.faults.a of Mine failed: ZeroDivisionError.*line 7 of rule.py"),
        ("class", "import nothing_of_that_name\n\n\nclass", "importing .*rule.py failed"),
    ],
)  # fmt: skip
def test_a_bad_rule_of_a_user_is_refused_in_one_line(tmp_path, old, new, message):
    (tmp_path / "rule.py").write_text(RULE.replace(old, new, 1))
    text = (ROOT / "src/skywright/missions/waypoints/waypoints.toml").read_text()
    file = tmp_path / "mission.toml"
    file.write_text(text + '\n[mission.faults.a]\nkind = "rule.py:Mine"\n')
    with pytest.raises(InputError, match=message) as told:
        run_mission(load_description(file), out=tmp_path / "run")
    assert "\n" not in str(told.value)
    assert not list(tmp_path.glob("run*"))
    done = CliRunner().invoke(cli.main, ["check", str(file)])
    assert done.exit_code == 2 and re.search(message, done.output.replace("\n", " "))


@pytest.mark.parametrize("kind", [k for k in list_kinds("fault") if k != "random"])
def test_every_fault_draws_keys_that_it_takes(kind):
    d, rng = load_description("tool-install"), np.random.default_rng(1)
    drawn = find("fault", kind).cls.draw_table(rng, d.robot, d.world)
    assert (drawn is None) == (kind == "link")  # this world has none
    if drawn is not None:
        find("fault", kind).cls.Table.model_validate(drawn)


def test_links_are_drawn_that_lose_packets_and_that_get_later():
    d = load_description("waypoints", sets=["world.link.delay_s=0.001"])
    rng = np.random.default_rng(1)
    link = find("fault", "link").cls
    drawn = [link.Table.model_validate(link.draw_table(rng, d.robot, d.world)) for _ in range(20)]
    later = [t.delay_s for t in drawn if t.loss_fraction == 0.0]
    assert 5 <= len(later) <= 15 and all(0.005 <= s <= 0.015 for s in later)
    assert all(t.loss_fraction == 1.0 for t in drawn if t.delay_s == 0.0)


def test_a_random_fault_follows_from_the_seed():
    def draw(seed):
        sets = ["plant.faults.a.kind=random", "plant.faults.a.end_s=50"]
        (fault,) = build_named(load_description("waypoints", "othex", sets=sets, seed=seed))
        return type(fault).__name__, fault.table

    assert draw(3) == draw(3)
    assert len({draw(seed)[0] for seed in range(8)}) > 3


def test_a_fault_that_does_not_fit_is_refused():
    for keys in ({"kind": "rotor", "rotor": 7}, {"kind": "joint", "joint": 9},
                 {"kind": "tool_dropped"}, {"kind": "bump", "body": "wing"}):  # fmt: skip
        sets = [f"plant.faults.a.{k}={v}" for k, v in keys.items()]
        with pytest.raises(InputError, match=r"plant\.faults\.a"):
            fly_and_evaluate(load_description("waypoints", "othex", sets=sets))


def test_the_page_has_todays_rules_and_faults():
    module = load_script("docs/generate_faults.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_faults.py"


def test_the_page_of_the_long_reach_has_its_flights():
    module = load_script("docs/generate_long_reach.py")
    text = module.PAGE.read_text(encoding="utf-8")
    assert text == module.build_page(text), "run: python docs/generate_long_reach.py"


# --- watching ------------------------------------------------------------------------------------


class Told:
    """Senses of a value that a test tells."""

    t, value, reference, failure = 0.0, 0.0, {"active": 1.0}, ""

    def told(self, name):
        return self.reference[name]


def build_watch(response="come_home", hold=0.1):
    from skywright.run.faults._rule import Rule

    class Given(Rule):
        every = 1

        def look(self, v):
            return v.value

    table = Rule.Table(limit=1.0, hold_s=hold, response=response)
    senses = Told()
    watch = Watch([Given("given", table)], senses)
    watch.begin(airborne=True)
    return watch, senses


def test_a_value_has_to_stay_beyond_its_limit_for_the_hold_time():
    watch, v = build_watch()
    for t, value in [(0.0, 2.0), (0.05, 0.5), (0.06, 2.0), (0.15, float("nan")), (0.2, 2.0)]:
        v.t, v.value = t, value
        watch.look("scan")
    v.t = 0.3
    with pytest.raises(RuleActed, match=r"given 2, limit 1 in scan at t = 0\.3 s"):
        watch.look("scan")
    assert [a.rule for a in watch.acted] == ["given"]
    v.t = 1.0
    watch.look("come home")  # no weaker nor equal response follows


def test_a_repair_runs_once_for_each_part_whatever_response_is_flown():
    """Rank decides which response is flown, not whether a repair runs."""
    from skywright.run.faults._rule import Rule

    class Repairing(Rule):
        every, repaired = 1, ()

        def look(self, v):
            return v.value

        def repair(self, s):
            self.repaired += (self.part,)
            return "come_home"

    plain, senses = build_watch("land_here", hold=0.0)
    rule = Repairing("repairing", Rule.Table(limit=1.0))
    watch = Watch([*plain.rules, rule], senses)
    watch.begin(airborne=True)
    senses.value = 2.0
    for part in (1, 1, 2, 2):
        rule.part = part
        try:
            watch.look("scan")
        except RuleActed as acted:
            assert watch.answer(acted.rule, None) == "land_here"  # the stronger one stays
        try:
            watch.look("land here")
        except RuleActed as acted:
            assert watch.answer(acted.rule, None) == "land_here"
    assert rule.repaired == (1, 2)
    assert [(a.rule, a.response) for a in watch.acted] == [
        (name, "land_here") for name in ("given", "repairing", "repairing")
    ]


def test_a_second_joint_is_noticed_beside_one_that_does_not_follow():
    rule = find("rule", "joint_off").cls("joint_off")
    rule._told = rule._seen = np.zeros(3)
    rule._loose, rule._swing = True, -1
    rule._told = np.array([0.0, 0.6, 0.3])
    senses: Any = SimpleNamespace(stuck=set(), told=lambda name: 0.0)
    assert (rule.look(senses), rule.part) == (0.6, 2)
    rule.repair(SimpleNamespace(senses=senses))
    assert senses.stuck == {1, 2} and rule.look(senses) == 0.0
    rule._told[0] = 0.4
    assert (rule.look(senses), rule.part) == (0.4, 1)


def test_nothing_is_watched_while_the_motors_are_off():
    watch, v = build_watch(hold=0.0)
    v.value, v.reference = 5.0, {"active": 0.0}
    watch.look("start")
    assert not watch.acted


def test_a_rule_of_a_user_that_raises_acts_and_is_blamed(tmp_path):
    (tmp_path / "rule.py").write_text(RULE.replace("return -1.0", "return v.estimate.p_WX"))
    (rule,) = [
        r for r in build_rules(load_description("waypoints", sets=[
            f"mission.faults.a.kind={tmp_path}/rule.py:Mine", "mission.faults.a.response=hold"]))
        if r.name == "a"
    ]  # fmt: skip
    senses = Told()
    watch = Watch([rule], senses)
    watch.begin(airborne=True)
    with pytest.raises(RuleActed, match=r"rule a \(Mine\) failed: AttributeError.*rule.py") as told:
        for _ in range(5):
            watch.look("scan")
    assert (told.value.acted.response, told.value.acted.value) == ("hold", 0.0)
    rule.repair = lambda s: "pray"  # what it answers is not known either: its table holds
    assert watch.answer(rule, None) == "hold"


def test_an_infinite_value_acts_and_is_written(tmp_path):
    watch, v = build_watch(hold=0.0)
    v.value = float("inf")
    with pytest.raises(RuleActed) as told:
        watch.look("scan")
    assert json.loads(json.dumps(told.value.acted.value, allow_nan=False)) > 1e6


def test_a_lag_forgets_a_step_by_a_factor_of_e_in_its_time():
    lag = Follow(2.0)
    lag.step(0.0, [0.0])
    for t in np.arange(0.02, 2.0 + 1e-9, 0.02):
        (value,) = lag.step(float(t), [1.0])
    assert value == pytest.approx(1.0 - np.exp(-1.0), abs=1e-6)


# --- before take-off -----------------------------------------------------------------------------


def test_a_link_later_than_the_attitude_loop_bears_is_refused_with_the_number():
    late = plan_mission(load_description("waypoints", "othex", sets=["world.link.delay_s=0.015"]))
    assert not late.feasible
    assert "5.2 ms" in late.blocked_by
    early = load_description("waypoints", "othex", sets=["world.link.delay_s=0.004"])
    assert plan_mission(early).feasible


def test_parallel_rotors_can_lose_one_and_six_tilted_ones_cannot():
    for robot, dispensable in (
        ("bimanual", (1, 2, 3, 4, 5, 6)), ("othex", ()), ("f550-bridge", ()),
        ("omnicopter", (2, 3, 6, 7)),
    ):  # fmt: skip
        found = compute_capability(load_description("waypoints", robot).robot)
        assert found.dispensable == dispensable


# --- flown ---------------------------------------------------------------------------------------


def test_localisation_lost_for_good_lands_on_the_spot(tmp_path):
    sets = ["plant.faults.a.kind=localisation", "plant.faults.a.start_s=6"]
    d = load_description("waypoints", "othex", sets=sets)
    result = run_mission(d, out=tmp_path / "run")
    check_down(result, "localisation_lost", 6.0, 2.2, "land_here")
    told = json.loads((result.directory / "metrics.json").read_text())
    assert told["faults"][0]["rule"] == "localisation_lost"
    assert told["outcome"] == "aborted" and "no localisation for" in told["reason"]
    events = [e.text for e in read_recording(result.directory / "recording.mcap").events]
    assert any(text.startswith("rule localisation_lost") for text in events)


@pytest.mark.parametrize(
    ("kind", "keys", "rule", "within"),
    [
        ("sensor", {"jump": "[0.3, 0, 0]"}, "estimator_inconsistent", 0.5),
        ("battery", {"charge_fraction": 0.15}, "battery_low", 1.0),
        ("bump", {"force_x_n": -15, "for_s": 0.4}, "unintended_contact", 0.6),
        ("link", {"for_s": 0.15}, "link_silent", 0.2),
        ("joint", {"joint": 2, "how": "stuck"}, "joint_off", 8.0),
    ],
)
def test_a_fault_in_the_air_is_answered_by_its_rule(kind, keys, rule, within):
    check_down(fly("pipe-weld-scan", kind, start_s=8, **keys), rule, 8.0, within)


def test_a_link_that_is_lost_for_good_is_a_fall_that_is_told():
    sets = ["plant.faults.a.kind=link", "plant.faults.a.start_s=6"]
    result = fly_and_evaluate(load_description("waypoints", "othex", sets=sets))
    acted = [(a.rule, a.response) for a in result.acted]
    assert acted == [("link_silent", "land_here"), ("link_lost", "let_go")]
    assert 6.5 < result.acted[1].t_s < 6.6 and "link lost 0.5" in result.reason
    s = result.samples
    assert s["rotor_thrust"][s["t"] > 6.7].sum() == 0.0
    assert np.linalg.norm(s["v_WB"][-1]) < 0.1 and s["p_WB"][-1, 2] < 0.3


def test_a_link_gets_later_for_a_time():
    class Ages:
        def __init__(self):
            self.seen = []

        def on_plan(self, plan, description):
            pass

        def on_tick(self, t, phase, vehicle):
            self.seen.append((t, vehicle.t - float(vehicle.look(ImuBatch).t)))

        def close(self):
            pass

    ages = Ages()
    # 4 ms in all, of the 5.2 ms that the law bears
    keys = ("kind=link", "start_s=6", "for_s=2", "loss_fraction=0", "delay_s=0.002")
    sets = [*(f"plant.faults.a.{k}" for k in keys), "world.link.delay_s=0.002"]
    d = load_description("waypoints", "othex", sets=sets)
    result = fly_and_evaluate(d, observers=[ages])
    assert result.outcome == "succeeded", result.reason
    t, age = np.array(ages.seen).T
    usual, late = (np.median(age[m]) for m in ((t > 3) & (t < 6), (t > 6.1) & (t < 8)))
    assert late - usual == pytest.approx(0.002, abs=1e-4)
    assert np.median(age[t > 8.1]) == pytest.approx(usual, abs=1e-4)


def test_a_link_that_gets_later_than_the_law_bears_slows_it_and_lands():
    keys = ("kind=link", "start_s=6", "loss_fraction=0", "delay_s=0.012")
    sets = [*(f"plant.faults.a.{k}" for k in keys), "world.link.delay_s=0.001"]
    result = fly_and_evaluate(load_description("waypoints", "othex", sets=sets))
    check_down(result, "link_late", 6.0, 0.2, "land_here")
    assert "delay of 14.0 ms" in result.reason and "5.2 ms" in result.reason
    s = result.samples
    settled = s["saturated"][s["t"] > result.acted[0].t_s + 1.0]
    assert np.mean(settled > 0) < 0.1  # the loop is stable again


def test_a_link_with_jitter_that_was_accepted_is_not_late():
    keys = ("delay_s=0.002", "jitter_s=0.003", "loss_fraction=0.3")
    d = load_description("waypoints", "othex", seed=3, sets=[f"world.link.{k}" for k in keys])
    result = fly_and_evaluate(d)
    assert result.outcome == "succeeded", result.reason


@pytest.mark.parametrize("robot", ["othex", "f550-bridge", "bimanual"])
def test_no_squall_is_drawn_that_the_robot_does_not_hold(robot):
    d, rng = load_description("waypoints", robot), np.random.default_rng(5)
    holds = float(np.min(compute_capability(d.robot).wind_limit))
    drawn = [find("fault", "squall").cls.draw_table(rng, d.robot, d.world) for _ in range(2)]
    assert all(0.6 * min(holds, 12.0) <= x["speed_mps"] <= min(holds, 12.0) for x in drawn)


def test_a_squall_is_drawn_for_the_gravity_and_the_air_of_its_world():
    """In another world the same draws have another speed, in the ratio of the robot's limits."""
    speeds, limits = [], []
    for sets in ([], ["world.air_density_kg_m3=2.4"], ["world.gravity_mps2=12.0"]):
        d, rng = load_description("waypoints", "f550-bridge", sets=sets), np.random.default_rng(5)
        gravity, air = d.world.gravity_mps2, d.world.air_density_kg_m3
        c = compute_capability(d.robot, gravity=gravity, air_density=air)
        limits.append(min(float(np.min(c.wind_limit)), 12.0))
        speeds.append(find("fault", "squall").cls.draw_table(rng, d.robot, d.world)["speed_mps"])
    assert np.array(speeds) / speeds[0] == pytest.approx(np.array(limits) / limits[0])
    assert limits[1] < 0.9 * limits[0] and limits[2] < 0.9 * limits[0]


def test_a_hexarotor_lands_without_a_rotor():
    check_down(fly("tool-install", "rotor", efficiency=0, start_s=8), "rotor_lost", 8.0, 0.2)


@pytest.mark.parametrize(
    ("robot", "more", "rule", "tilt_deg"),
    [
        ("bimanual", ("b.kind=rotor", "b.efficiency=0", "b.start_s=9"), "rotor_lost", 7.0),
        ("othex", ("b.kind=link", "b.loss_fraction=0", "b.delay_s=0.012", "b.start_s=8.8"),
         "link_late", 5.0),
    ],
)  # fmt: skip
def test_a_second_fault_is_repaired_while_the_robot_lands(robot, more, rule, tilt_deg):
    """Its rule has the rank of the response that is flown; without its repair the robot falls."""
    sets = [f"plant.faults.{k}" for k in ("a.kind=localisation", "a.start_s=6", *more)]
    sets += ["world.link.delay_s=0.001"] if rule == "link_late" else []
    result = fly_and_evaluate(load_description("waypoints", robot, sets=sets))
    check_down(result, "localisation_lost", 6.0, 2.3, "land_here")
    assert [(a.rule, a.response) for a in result.acted[1:]] == [(rule, "land_here")]
    s = result.samples
    late = s[s["t"] > result.acted[0].t_s]
    up = 1.0 - 2.0 * np.sum(late["q_WB"][:, 1:3] ** 2, axis=1)
    assert math.degrees(math.acos(min(up.min(), 1.0))) < tilt_deg
    assert late["v_WB"][:, 2].min() > -0.8


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("bump", {"force_x_n": -23, "force_y_n": -12}),
        ("sensor", {"jump": "[-0.22, 0.08, 0.19]"}),
    ],
)
def test_a_robot_below_a_handle_backs_off_by_the_way_it_came(kind, keys):
    """Pushed away it does not come back; an estimate that jumps leads no hand into the tool."""
    result = fly("tool-install", kind, start_s=27.8, **keys)
    check_down(result, result.acted[0].rule, 27.8, 0.6)


def test_a_dropped_tool_is_missed():
    # the mission would look after it itself
    sets = ("mission.faults.tool_dropped.on=true", "mission.task.hover_s=0")
    result = fly("tool-install", "tool_dropped", more=sets, start_s=38)
    check_down(result, "tool_dropped", 38.0, 0.6)


def test_a_hand_that_presses_too_hard_is_drawn_back():
    sets = [*EXACT, "mission.task.force_n=4", "mission.faults.excess_force.limit=3",
            "mission.task.hover_s=0", "mission.task.swing_deg=0",
            "mission.timestep_ms=2"]  # fmt: skip
    result = fly_and_evaluate(load_description("sensor-install", sets=sets))
    check_down(result, "excess_force", 45.0, 30.0, "come_home")
    assert "retract" in [p.name for p in result.phases]


def test_a_weak_rotor_is_noticed_by_its_effect():
    sets = ["plant.faults.a.kind=rotor", "plant.faults.a.rotor=3", "plant.faults.a.start_s=8"]
    result = fly_and_evaluate(load_description("waypoints", "othex", sets=sets))
    check_down(result, "rotor_weak", 8.0, 3.0, "come_home")
    assert "rotor 3" in result.reason


def test_stale_localisation_in_contact_draws_back():
    start = 28.0
    result = fly("pipe-weld-scan", "localisation", start_s=start, for_s=1.0)
    check_down(result, "localisation_stale", start, 0.3, "hold")
    assert [p.name for p in result.phases[-3:]] == ["retract", "hold", "come home"]


def test_an_interrupt_while_a_response_is_flown_leaves_a_readable_run(tmp_path):
    class Impatient:
        def on_plan(self, plan, description):
            pass

        def on_tick(self, t, phase, vehicle):
            if phase == "come home":
                raise KeyboardInterrupt

        def close(self):
            pass

    sets = ["plant.faults.a.kind=battery", "plant.faults.a.start_s=6"]
    d = load_description("waypoints", "othex", sets=sets)
    result = run_mission(d, out=tmp_path / "run", observers=[Impatient()])
    assert result.outcome == "interrupted" and result.directory.suffix == ".partial"
    told = json.loads((result.directory / "metrics.json").read_text())
    assert re.fullmatch(r"battery low .*; then interrupted by the user", told["reason"])
    assert [a["rule"] for a in told["faults"]] == ["battery_low"]
    recording = read_recording(result.directory / "recording.mcap")
    assert recording.samples["t"][-1] == pytest.approx(result.samples["t"][-1])
    assert evaluate_directory(result.directory).acted == result.acted


def test_a_robot_with_a_long_link_lands_where_it_is_and_behind():
    robot = load_description("waypoints", "bimanual-longreach").robot
    arc = compute_link_arc(robot, build_body_model(robot))
    usual, here = (plan_landing(arc, 2.0, 1.0, 0.8, 0.02, flag) for flag in (False, True))
    assert usual.forward.max() - usual.forward[0] > 0.5  # in front of it stands what it works on
    assert here.forward.max() <= 0.0
    assert here.forward[0] == here.forward[len(here.forward) // 4] == 0.0
    np.testing.assert_allclose(here.height[-1], usual.height[-1])


def check_fallen(result, start):
    """The law's second failure was answered: motors off at once, and the robot lies."""
    first, second = result.acted
    assert (first.rule, first.response) == ("computer_failed", "land_here")
    assert (second.rule, second.response) == ("computer_failed", "let_go")
    assert start <= first.t_s < second.t_s < start + 0.2
    assert result.outcome == "aborted" and result.reason == f"{first.says}; then {second.says}"
    s = result.samples
    assert np.isfinite(s["rotor_thrust"]).all()
    assert np.isfinite(s["cmd_f_B"][s["t"] > second.t_s + 0.02]).all()
    assert s["rotor_thrust"][s["t"] > second.t_s + 0.5].max() < 0.2  # they run down
    assert s["t"][-1] > second.t_s + 2.5
    assert s["p_WB"][-1, 2] < result.description.robot.platform.gear_height_m + 0.3
    assert np.linalg.norm(s["v_WB"][-1]) < 0.1


@pytest.mark.parametrize(
    ("mission", "robot", "how"),
    [
        ("waypoints", "othex", "raises"), ("waypoints", "othex", "nan"),
        ("waypoints", None, "hangs"),
    ],
)  # fmt: skip
def test_a_law_that_fails_once_is_started_again_and_the_robot_lands(mission, robot, how):
    sets = [f"plant.faults.a.{k}" for k in ("kind=computer", f"how={how}", "start_s=7")]
    result = fly_and_evaluate(load_description(mission, robot, sets=sets))
    check_down(result, "computer_failed", 7.0, 0.1, "land_here")
    assert "control law" in result.reason
    s = result.samples
    gap = s[(s["t"] > 7.0) & (s["t"] < 7.06)]  # the rotors go on as they were
    assert np.abs(np.diff(gap["rotor_thrust"], axis=0)).max() < 0.5
    assert s["v_WB"][:, 2].min() > -0.8  # it sinks and does not fall


@pytest.mark.parametrize("how", ["raises", "nan"])
def test_a_law_that_fails_again_lets_the_robot_fall(how):
    keys = ("kind=computer", f"how={how}", "start_s=7", "again=true")
    d = load_description("waypoints", "othex", sets=[f"plant.faults.a.{k}" for k in keys])
    check_fallen(fly_and_evaluate(d), 7.0)


def test_a_users_law_that_raises_in_the_air_is_named(tmp_path):
    sets = write_law(tmp_path, 'if est.t > 5.0:\n    raise ValueError("no idea")\n' + HOVER)
    result = fly_and_evaluate(load_description("waypoints", "othex", sets=sets))
    check_fallen(result, 5.0)
    assert "component law (Mine.step" in result.reason and "no idea" in result.reason
    assert (result.outcome, result.exit_code) == ("aborted", 1)


def test_a_users_law_that_raises_on_the_ground_ends_the_run(tmp_path):
    """Nothing has to land: exit code 3, as docs/howto/your-own-control-law.md has it."""
    sets = write_law(tmp_path, 'if ref.active < 0.5:\n    raise ValueError("no idea")\n' + HOVER)
    result = fly_and_evaluate(load_description("waypoints", "othex", sets=sets))
    assert result.exit_code == 3 and "no idea" in result.reason


@pytest.mark.parametrize(
    ("speed", "wind", "rule", "response"),
    [
        (7.0, "none", "saturation", "come_home"),
        (7.0, "dryden", "saturation", "come_home"),
        (16.0, "none", "lost_control", "land_here"),
    ],
)
def test_a_squall_is_answered_and_the_robot_lands_upright(speed, wind, rule, response, tmp_path):
    sets = [
        "plant.faults.a.kind=squall", f"plant.faults.a.speed_mps={speed}",
        "plant.faults.a.start_s=8", "mission.faults.unintended_contact.on=false",
        f"world.wind.kind={wind}", f"world.wind.mean_mps={float(wind != 'none')}",
    ]  # fmt: skip
    result = run_mission(load_description("waypoints", "othex", sets=sets), out=tmp_path / "run")
    told = json.loads((tmp_path / "run" / "metrics.json").read_text())["faults"]
    assert [(a["rule"], a["response"]) for a in told] == [(rule, response)]
    assert result.samples["f_wind_W"][-1, 1] > 1.5  # it still blows
    last = result.samples[-1]
    assert last["p_WB"][2] < 0.3 and abs(last["q_WB"][0]) > 0.9
    assert np.min(result.samples["v_WB"][:, 2]) > -1.5  # it did not fall


def test_after_a_fall_the_run_goes_on_until_the_robot_lies_still() -> None:
    def fall(rate: Callable[[float], float]) -> float:
        """Return how long (s) is waited for a robot whose gyroscope tells `rate` (rad/s)."""
        vehicle = SimpleNamespace(t=50.0, estimate={"w_WB_B": np.zeros(3)})

        def tick() -> None:
            vehicle.t += 0.02
            vehicle.estimate["w_WB_B"] = np.array([0.0, rate(vehicle.t - 50.0), 0.0])

        s: Any = SimpleNamespace(
            vehicle=vehicle, senses=None, begin=lambda _: None, tick=tick,
            uav=SimpleNamespace(motors=lambda _: None),
        )  # fmt: skip
        respond(s, "let_go")
        return float(vehicle.t) - 50.0

    assert fall(lambda t: 0.0) == pytest.approx(3.0, abs=0.03)  # it may still be in the air
    assert fall(lambda t: 2.0 if t < 6.0 else 0.01) == pytest.approx(6.5, abs=0.05)
    assert fall(lambda t: 2.0) == pytest.approx(15.0, abs=0.03)
    assert fall(lambda t: math.nan) == pytest.approx(15.0, abs=0.03)  # nothing tells that it lies
