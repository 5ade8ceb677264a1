"""The survey of decks, walls, pillars and tunnels, by the docking feet or by the probe's tip."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from cut_flights import fly_until
from exact_map import KNOWN
from skywright.core.arrays import Array
from skywright.description.loader import Description, load_description
from skywright.description.map_error import displace_world
from skywright.description.world.structure import build_surface, find_place, locate_point
from skywright.errors import InputError
from skywright.evidence.reproduce.load import load_claims
from skywright.missions.bridge_contact.survey import choose_places
from skywright.missions.skills.survey import Touch
from skywright.missions.skills.surveyed import Ball, get_map_error, is_surveyed
from skywright.missions.skills.surveyed_structure import (
    compute_structure_reach,
    fit_structure,
    judge_structure,
    move_structure,
)
from skywright.run.backends import build_vehicle
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor

WORLDS = ("bridge", "pillar", "tunnel")
TIP = 0.006
LARGE = {"plant.map_error_m": 0.03, "plant.map_error_deg": 3.0}
SHORT = LARGE | {
    "mission.task.forces_n": [2.0, 5.0], "mission.task.hold_s": 1.0,
    "mission.task.without_gear": False, "mission.task.stand_off_m": 0.2,
}  # fmt: skip


def load(world: str, seed: int = 1, **more: Any) -> Description:
    size = {} if world == "bridge" else {"plant.map_error_size_m": 0.005}
    return load_description("wall-contact", world=world, sets=LARGE | size | more, seed=seed)


def list_places(d: Description) -> list[Array]:
    assert d.world.structure is not None
    return choose_places(d.mission.task, d.world.structure)


def make_touches(d: Description, wrong: tuple[int, ...] = ()) -> list[Touch]:
    """Touches of the true surface from over the map's places, along the map's normals."""
    assert d.world.structure is not None and d.true_world.structure is not None
    known, true = build_surface(d.world.structure), build_surface(d.true_world.structure)
    out = []
    for i, place in enumerate(list_places(d)):
        p, R = locate_point(known, place)
        for _ in range(50):  # on along the map's normal until a ball meets the true surface
            p = p - (find_place(true, p)[2] - TIP) * R[:, 2]
        p = p + (0.03 * R[:, 2] if i in wrong else 0.0)
        out.append(Touch(p - TIP * R[:, 2], -R[:, 2], ""))
    return out


@pytest.mark.parametrize("world", WORLDS)
def test_touches_show_the_true_surface(world: str) -> None:
    for seed in range(1, 6):
        d = load(world, seed)
        setup = Setup(d)
        found = fit_structure(setup, make_touches(d), Ball(TIP, 0.0, 1e-4))
        assert found.reason == ""
        m = judge_structure(setup, found, np.zeros(2), Ball(TIP, 0.0, 1e-4))
        assert m["survey.map_error_mm"] > 1.0 or m["survey.map_normal_error_deg"] > 0.5
        assert m["survey.surface_error_mm"] < 1.5, (seed, m)
        assert m["survey.normal_error_deg"] < 0.5, (seed, m)


def test_normals_of_a_deck_whose_answer_is_known() -> None:
    """Found 2 deg steeper than it is; the map leans as it was drawn."""
    d = load("bridge", seed=3)
    setup = Setup(d)
    assert d.world.structure is not None and d.true_world.structure is not None
    true = d.true_world.structure
    steeper = true.model_copy(update={"slope_deg": true.slope_deg + 2.0})
    fitted = fit_structure(setup, make_touches(d), Ball(TIP, 0.0, 1e-4))
    spread = fitted.found.fit._replace(covariance=np.diag([9e-6, 16e-6, 1e-8]))
    found = fitted._replace(structure=steeper, found=fitted.found._replace(fit=spread))
    m = judge_structure(setup, found, np.zeros(2), Ball(TIP, 0.0, 1e-4))
    assert m["survey.normal_error_deg"] == pytest.approx(2.0, abs=1e-6)
    assert m["survey.normal_std_deg"] == pytest.approx(math.degrees(5e-3))
    mapped, is_ = (build_surface(s).R_WS[:, 2] for s in (d.world.structure, true))
    between = math.degrees(math.acos(float(mapped @ is_)))
    assert between > 0.5 and m["survey.map_normal_error_deg"] == pytest.approx(between)


@pytest.mark.parametrize("world", WORLDS)
def test_stated_deviations_hold(world: str) -> None:
    """Over many draws the errors of the surface at the spot are as large as the fit says."""
    ball, rng, off = Ball(TIP, 0.0, 1e-3), np.random.default_rng(1), []
    for seed in range(60):
        d = load(world, seed)
        setup = Setup(d)
        noisy = [t._replace(p_WT=t.p_WT + ball.std * rng.standard_normal() * t.axis_W)
                 for t in make_touches(d)]  # fmt: skip
        m = judge_structure(setup, fit_structure(setup, noisy, ball), np.zeros(2), ball)
        off.append((m["survey.surface_error_mm"] / m["survey.surface_std_mm"],
                    m["survey.normal_error_deg"] / m["survey.normal_std_deg"]))  # fmt: skip
    surface, normal = np.sqrt(np.mean(np.square(off), axis=0))
    assert 0.5 < surface < 1.4 and 0.5 < normal < 1.4, (surface, normal)


@pytest.mark.parametrize("world", WORLDS)
def test_the_true_surface_is_never_farther_than_the_reach(world: str) -> None:
    d = load(world)
    structure, worst = d.world.structure, 0.0
    assert structure is not None
    error, surface = get_map_error(Setup(d)), build_surface(structure)
    places = list_places(d)
    reach = [compute_structure_reach(structure, error, place) for place in places]
    for seed in range(200):
        true = displace_world(d.world, d.plant, seed).structure
        assert true is not None
        at = build_surface(true)
        for place, r in zip(places, reach, strict=True):
            p, R = locate_point(surface, place)
            gone = p
            for _ in range(50):
                gone = gone - find_place(at, gone)[2] * R[:, 2]
            worst = max(worst, float(np.linalg.norm(gone - p)) / r)
    assert 0.5 < worst <= 1.02


@pytest.mark.parametrize("world", WORLDS)
def test_a_found_structure_is_written_as_a_table(world: str) -> None:
    d = load(world)
    known, true = d.world.structure, d.true_world.structure
    assert known is not None and true is not None
    at = build_surface(true)
    again = build_surface(move_structure(known, at.p_WS, at.R_WS[:, 2], at.R_WS[:, 0]))
    np.testing.assert_allclose(again.p_WS, at.p_WS)
    np.testing.assert_allclose(again.R_WS, at.R_WS, atol=1e-9)


def test_false_and_missing_touches_are_told() -> None:
    d = load("pillar")
    setup, ball = Setup(d), Ball(TIP, 0.0, 1e-3)
    one = fit_structure(setup, make_touches(d, wrong=(1,)), ball)
    assert one.reason == "" and list(one.found.fit.used).count(False) == 1
    many = fit_structure(setup, make_touches(d, wrong=(0, 2, 4)), ball)
    assert "inconsistent with each other" in many.reason and "pillar" in many.reason
    missed = Touch(np.full(3, math.nan), np.zeros(3), "no contact within 90 mm")
    few = fit_structure(setup, make_touches(d)[:2] + [missed], ball)
    assert few.reason == "survey: only 2 of 3 touches succeeded (no contact within 90 mm)"


def test_a_press_that_no_slope_within_the_bounds_allows_is_refused() -> None:
    sets = {"mission.task.forces_n": [8.0], "plant.map_error_deg": 1.0}
    plan = plan_mission(load_description("bridge-contact", sets=sets))
    assert "docked at 1.41 deg and 0.0 m/s of wind exceeds 6.38 N, 80%" in str(plan.blocked_by)
    known = plan_mission(load_description("bridge-contact", sets=sets | KNOWN))
    assert known.feasible and known.way.survey is None
    sets = {"mission.task.dock": False, "mission.task.forces_n": [0.3], "plant.map_error_deg": 6.2}
    plan = plan_mission(load_description("bridge-contact", sets=sets))
    assert "requires a tilt" in str(plan.blocked_by)


def test_feet_do_not_find_a_curved_deck() -> None:
    sets = {"world.structure.facing": "down", "world.structure.z_m": 3.0,
            "world.structure.x_m": 2.0, "plant.map_error_size_m": 0.0}  # fmt: skip
    d = load_description("bridge-contact", world="tunnel", sets=sets)
    with pytest.raises(InputError, match=r"mission\.task\.survey=false"):
        plan_mission(d)


def test_the_papers_claims_are_flown_with_known_structures() -> None:
    for case in load_claims("sanchez-cuevas-2020").cases.values():
        d = load_description(case.mission, case.robot or None, sets=case.sets)
        assert d.true_world == d.world
        assert case.mission != "bridge-contact" or not is_surveyed(Setup(d))


def test_the_feet_find_the_deck_before_the_robot_docks() -> None:
    run = fly_and_evaluate(load_description("bridge-contact", sets=SHORT, seed=2))
    m = run.metrics
    assert run.outcome == "succeeded" and not [r for r in run.requirements if not r.passed], m
    assert m["survey.touches"] == 4.0 and m["survey.map_error_mm"] > 5.0
    assert m["survey.map_normal_error_deg"] > 1.0 and m["survey.normal_error_deg"] < 1.0
    assert m["dock.turn_deg"] < 0.3  # flush with the true deck
    names = [p.name for p in run.phases]
    assert names.index("survey_touch") < names.index("dock") < names.index("hold 2 N")


def test_a_deck_that_is_not_there_sends_the_robot_home() -> None:
    d = load_description("bridge-contact", sets=SHORT, seed=1)
    setup = Setup(d)
    structure = setup.true.world.structure
    assert structure is not None
    high = structure.model_copy(update={"z_m": structure.z_m + 0.5})
    setup.true.world = setup.true.world.model_copy(update={"structure": high})
    plan, vehicle = plan_mission(d, setup), build_vehicle(d, setup=setup)
    s = Supervisor(vehicle, d.mission, plan, d.robot.platform.gear_height_m)
    flight = s.fly()
    assert not flight.completed
    assert flight.reason.startswith("survey: only 0 of 4 touches succeeded (no contact within")
    assert [p.name for p in s.phases][-2:] == ["return", "land"]


@pytest.mark.parametrize("world", ["pillar", "tunnel"])
def test_the_tip_finds_a_wall_before_it_presses(world: str) -> None:
    slippery = {"world.structure.friction": 0.4} if world == "pillar" else {}  # 0.6 is refused
    run = fly_until("return", load(world, **{"world.localisation": "mocap"} | slippery))
    m = run.metrics
    assert m["contact.collisions"] == 0.0 and m["slide.length_fraction"] >= 0.95
    assert m["slide.lost_s"] < 1e-9
    assert m["survey.touches"] == 6.0 and m["survey.missed"] == 0.0
    assert m["survey.surface_error_mm"] < 3.0
    assert m["survey.normal_error_deg"] < 0.6 * m["survey.map_normal_error_deg"] + 0.3


def test_the_platform_follows_an_arm_that_reaches_its_stop_while_it_touches() -> None:
    """A link 3.7 mm short, before flat staves: the elbow is at its stop before the tip touches."""
    sets = KNOWN | {
        "mission.task.forces_n": [2.0], "mission.task.slide_m": 0.0, "mission.task.hold_s": 1.0,
        "plant.link_length_error_m": -0.00366, "plant.joint_offset_error_deg": -0.09689,
    }  # fmt: skip
    run = fly_and_evaluate(load_description("wall-contact", sets=sets, seed=94308857699111))
    assert run.outcome != "aborted" and run.metrics["free.rms_error_n"] < 0.5
