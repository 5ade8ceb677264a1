"""Contact missions: docked under a deck, in flight at a wall, on the bench, and the modes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from exact_map import KNOWN
from skywright.description.loader import load_description
from skywright.description.robot.arm import Arm
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.missions.bridge_contact.sliding import find_way
from skywright.models.contact_stance import LEAN_MAX, compute_flying_press, find_free_stance
from skywright.models.docked import build_docked, find_stance
from skywright.models.docked_balance import compute_docked_balance
from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.statics import wrench_at
from skywright.run.planning import plan_mission
from skywright.run.records import RecordStore
from skywright.run.result import RunResult
from skywright.run.run import fly_and_evaluate, run_mission

SHORT = KNOWN | {
    "mission.task.forces_n": [2.0, 8.0], "mission.task.settle_s": 2.0, "mission.task.hold_s": 1.0,
    "mission.task.without_gear": False, "mission.task.stand_off_m": 0.2,
}  # fmt: skip


@pytest.fixture(scope="module")
def docked(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """A short flight whose measurements are kept in `r.db` beside it."""
    folder = tmp_path_factory.mktemp("docked")
    d = load_description("bridge-contact", sets=SHORT)
    return run_mission(d, out=folder / "run", records=folder / "r.db")


def test_docked_the_force_is_held_and_the_robot_stays(docked: RunResult) -> None:
    result = docked
    assert result.outcome == "succeeded", result.reason
    assert result.metrics["force.rms_error_n"] < 0.1  # a third of what is required
    assert result.metrics["dock.wander_mm"] < 2.0
    assert 0.0 < result.metrics["dock.touch_speed_mps"] < 0.1
    store = RecordStore(result.directory.with_name("r.db"))
    found = store.find(at=(0.0, 0.0), radius=0.01)
    store.close()
    assert [r.force_des_n for r in found] == [2.0, 8.0]
    assert all(abs(r.force_n - r.force_des_n) < 0.1 and r.how == "docked" for r in found)
    assert all(abs(r.up_m - 3.0) < 0.02 for r in found)


def test_newton_holds_while_docked(docked: RunResult) -> None:
    """Feet, tip, rotors and weight are in balance in the recording."""
    result = docked
    s = result.samples
    held = np.isin(s["phase"], [i for i, p in enumerate(result.phases) if p.name == "hold 8 N"])
    s = s[held]
    assert len(s) > 50
    pressed = s["f_docking_W"][:, 2] + s["f_contact"][:, 2]
    robot = result.description.robot
    mass = 2.5 * 1.03
    tilt = math.cos(math.radians(20.0)) ** 2
    gains = 1.0 - 0.03
    up = s["rotor_thrust"][:, : len(robot.rotors.azimuth_deg)].sum(axis=1) * tilt * gains
    rest = up + pressed - mass * 9.81
    assert abs(float(np.mean(rest))) < 0.5  # rotors differ by 2 % each


@pytest.mark.parametrize(
    ("sets", "told"),
    [
        ({"mission.task.forces_n": [9.0]}, "95% (mission.task.calm_fraction) of the 8.66 N"),
        ({"world.structure.slope_deg": 10.0, "mission.task.forces_n": [6.0]},
         "80% (mission.task.force_fraction)"),
        ({"world.structure.slope_deg": 40.0, "mission.task.forces_n": [1.0]}, "cannot stay"),
        ({"mission.task.dock": False, "world.structure.slope_deg": 12.0,
          "mission.task.forces_n": [1.0]}, "tilt"),
        ({"mission.task.stand_off_m": 2.5}, "above the ground"),
        ({"mission.task.spots": [{"y_m": 1.6}]}, "come within"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_before_take_off(sets: dict[str, Any], told: str) -> None:
    plan = plan_mission(load_description("bridge-contact", sets=KNOWN | sets))
    assert not plan.feasible and told in str(plan.blocked_by), plan.blocked_by


def test_in_wind_the_robot_leans_less_before_it_docks() -> None:
    """The lateral force that holds against the wind is not there for a tilt in place."""
    sets: dict[str, Any] = KNOWN | {
        "world.structure.slope_deg": 5.2, "mission.task.forces_n": [1.0],
        "mission.task.without_gear": False, "world.wind.kind": "steady",
    }  # fmt: skip
    angles = []
    for speed in (0.1, 3.7):
        d = load_description("bridge-contact", sets=sets | {"world.wind.mean_mps": speed})
        found = plan_mission(d)
        assert found.feasible, found.blocked_by
        for s in found.way.stations:
            lean = math.acos(float(s.R_approach[2, 2]))
            assert lean <= s.tilt_limit
            angles.append(lean)
    assert angles[-1] < 0.9 * angles[0]
    storm = load_description("bridge-contact", sets=sets | {"world.wind.mean_mps": 12.0})
    assert "wind of 12.00 m/s exceeds" in str(plan_mission(storm).blocked_by)


@pytest.mark.parametrize(
    ("sets", "told"),
    [
        ({"mission.law": "push_and_slide"}, "valid: backstepping$"),
        (
            {"mission.law": "direct_force"},
            "controls the measured force with the joints of the arm; mission.law is 'direct_force'",
        ),
        ({"mission.task.spots": [{"x_m": 9.0}]}, "beside the structure"),
        ({"world.structure.facing": "side"}, "dock=false"),
    ],
)
def test_what_is_missing_is_told(sets: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        plan_mission(load_description("bridge-contact", sets=sets))


def test_robots_and_worlds_that_cannot_are_told() -> None:
    with pytest.raises(InputError, match="force_sensor"):
        plan_mission(load_description("bridge-contact", robot="othex"))
    with pytest.raises(InputError, match="no structure"):
        plan_mission(load_description("bridge-contact", world="open"))
    pillar = {"mission.task.spots": [{"x_m": 0.0, "y_m": 2.1}]}  # the pillar is 4 m high
    with pytest.raises(InputError, match=r"structure, which reaches 2 m along y$"):
        plan_mission(load_description("wall-contact", world="pillar", sets=pillar))
    with pytest.raises(InputError, match=r"0\.2 to 16 N"):
        load_description("bridge-contact", sets={"mission.task.forces_n": [0.0]})


@pytest.mark.parametrize("press", [0.0, 4.0, 8.0])
def test_the_docked_balance_is_one(press: float) -> None:
    """Forces and torques add up, feet are loaded as equal springs of a rigid frame would be."""
    robot, _ = load_robot("f550-bridge")
    docked = build_docked(robot)
    stance = find_stance(docked)
    found = compute_docked_balance(docked, stance, press, R_WB=np.eye(3))
    assert found is not None
    total = docked.layout.B @ found.thrust
    total += wrench_at(-stance.mass * 9.81 * np.array([0.0, 0.0, 1.0]), stance.p_BC)
    total += press * wrench_at(np.array([0.0, 0.0, -1.0]), stance.tip)
    total += np.concatenate([found.f_feet, found.t_feet])
    assert total == pytest.approx(np.zeros(6), abs=1e-6)
    plane = np.column_stack([np.ones(4), docked.feet[:, :2]])
    fit, *_ = np.linalg.lstsq(plane, found.foot_load, rcond=None)
    assert plane @ fit == pytest.approx(found.foot_load, abs=1e-9)
    assert np.all(found.foot_load >= docked.docking.foot_load_n - 1e-9)
    assert np.all(found.foot_friction <= docked.docking.friction)


def test_the_bench_presses_its_staircase() -> None:
    result = fly_and_evaluate(load_description("arm-test-bench", sets=["mission.task.hold_s=1.0"]))
    assert result.outcome == "succeeded", result.metrics
    names = [p.name for p in result.phases]
    assert names[:3] == ["start", "rest", "inspection position"]
    q = np.degrees(result.samples["q"][result.samples["phase"] == 2][-1][:2])
    assert q == pytest.approx([61.0 - 90.0, -55.0], abs=1.0)  # but for the encoders' zero
    assert float(np.max(result.samples["rotor_speed"])) == 0.0
    held = result.samples[result.samples["phase"] == names.index("hold 8 N")]
    push = np.mean(held["f_contact"], axis=0)  # of the plate on the tip: it is vertical
    assert push[0] < -7.0 and abs(push[1]) < 0.1 and abs(push[2]) < 0.41 * abs(push[0])


def test_the_platform_tilts_in_place_and_moves_level() -> None:
    result = fly_and_evaluate(load_description("flight-modes"))
    assert result.outcome == "succeeded", result.reason
    m = result.metrics
    assert m["modes.position_error_mm"] < 50.0
    assert m["modes.translate_tilt_deg"] < 2.0
    assert m["modes.tilt_deg"] > 9.0
    assert m["modes.standard_drift_m"] > 10 * m["modes.position_error_mm"] / 1e3


def test_a_bench_refuses_what_its_arm_cannot_hold() -> None:
    """Neighbours of the limit were flown: 9.5 N at 0.375 m, 11.5 N at friction 0.6 were held."""

    def ask(*forces: float, **more: float) -> str:
        sets = {"mission.task.forces_n": list(forces)} | {
            f"world.structure.{k}": v for k, v in more.items()
        }
        return str(plan_mission(load_description("arm-test-bench", sets=sets)).blocked_by)

    assert ask(2.0, 8.0) == ask(2.0, friction=0.2) == "None"
    assert "a press of 8.3 N exceeds 8.1" in ask(2.0, 8.3) and "tip slides away" in ask(9.0, 13.0)
    assert "7.2" in ask(8.0, x_m=0.385) and "5.27" in ask(6.0, x_m=0.385, friction=0.3)
    assert ask(10.0, x_m=0.385, friction=0.6) == "None"  # more friction holds more
    sets = {"mission.law": "backstepping_torque", "mission.task.forces_n": [16.0]}
    found = plan_mission(load_description("arm-test-bench", robot="f550-bridge-torque", sets=sets))
    assert "of the 17.5" in str(found.blocked_by)


def test_a_tilt_beyond_the_limit_is_refused() -> None:
    plan = plan_mission(load_description("flight-modes", sets={"mission.task.tilt_deg": 15.0}))
    assert not plan.feasible and "10.0 deg" in str(plan.blocked_by)
    sets = {"mission.task.tilt_deg": 6.0, "world.wind.mean_mps": 4.0}
    plan = plan_mission(load_description("flight-modes", sets=sets))
    assert not plan.feasible and "of the 4.9 deg" in str(plan.blocked_by)
    for tilt, flies in ((9.0, True), (9.1, False), (10.0, False)):
        plan = plan_mission(load_description("flight-modes", sets={"mission.task.tilt_deg": tilt}))
        assert plan.feasible == flies, plan.blocked_by
    assert "9.01 deg, which is 95% (mission.task.calm_fraction)" in str(plan.blocked_by)
    plan = plan_mission(load_description("flight-modes", robot="hexarotor", sets={
        "mission.law": "backstepping"}))  # fmt: skip
    assert not plan.feasible and "no lateral force" in str(plan.blocked_by)
    plan = plan_mission(load_description("flight-modes", sets={"world.wind.mean_mps": 2.0}))
    assert plan.feasible and plan.way.due == pytest.approx(
        0.75 * plan.way.limit - math.radians(0.5)
    )
    assert plan.way.limit < math.radians(8.0)
    with pytest.raises(InputError, match="backstepping"):
        plan_mission(load_description("flight-modes", sets={"mission.law": "tip_pd"}))


@pytest.mark.parametrize("world", ["tunnel", "pillar", "bridge"])
def test_a_surface_is_pressed_and_slid_along_in_flight(world: str) -> None:
    """Level along tunnel and deck; up and down the pillar the probe leans with the motion."""
    sets: dict[str, Any] = KNOWN | {
        "mission.task.forces_n": [2.0], "mission.task.hold_s": 1.0, "world.localisation": "mocap",
    }  # fmt: skip
    if world == "pillar":  # 0.6 is refused
        sets["world.structure.friction"] = 0.4
    result = fly_and_evaluate(load_description("wall-contact", world=world, sets=sets))
    assert result.outcome == "succeeded", (result.reason, result.metrics)
    assert result.metrics["slide.length_fraction"] >= 0.95
    assert result.metrics["free.rms_error_n"] < 0.5


@pytest.mark.parametrize("slope", [0.0, 6.0])
def test_under_a_deck_the_arm_stands_across_the_slide(slope: float) -> None:
    """In the arm's plane friction turns the robot into the deck, across it the tip stays away."""
    sets: dict[str, Any] = KNOWN | {
        "world.localisation": "mocap", "world.structure.slope_deg": slope,
        "mission.task.forces_n": [2.0],
    }  # fmt: skip
    d = load_description("wall-contact", world="bridge", sets=sets)
    plan = plan_mission(d)
    assert plan.feasible, plan.blocked_by
    station, stance = plan.way.stations[0], plan.way.free
    way = station.R_dock.T @ find_way(d.mission.task, d.world.structure)
    assert np.array([way[0], way[2]]) == pytest.approx(np.zeros(2), abs=1e-9)
    mass, c, inertia = compute_body(build_body_model(d.robot), stance.q)
    lever = stance.tip - c
    about = inertia - mass * (c @ c * np.eye(3) - np.outer(c, c))
    gain = []  # m/s^2 of the tip along -z_B, for 1 N on it that way and friction with it
    for along in (way / np.linalg.norm(way), [1.0, 0.0, 0.0]):
        f = np.array([0.0, 0.0, -1.0]) - 0.6 * np.asarray(along)
        turn = np.linalg.solve(about, np.cross(lever, f))
        gain.append(-(f / mass + np.cross(turn, lever))[2])
    assert gain[1] < 0.25 * gain[0]


@pytest.mark.parametrize(
    ("world", "sets", "told"),
    [
        ("tunnel", {"mission.task.slide_force_n": 2.0},
         "1.47 N, 80% (mission.task.force_fraction) of the 1.84 N"),
        ("tunnel", {"mission.task.slide_force_n": 0.5}, "would lose contact"),
        ("bridge", {}, "with total-station the platform moves"),
        ("tunnel", {"world.wind.kind": "steady", "world.wind.mean_mps": 4.0,
                    "world.wind.toward_deg": 180.0}, "4.0 m/s of wind"),
        ("pillar", {}, "retains 35% of its mobility"),
        ("pillar", {"mission.task.slide_m": -1.9, "world.structure.friction": 0.4},
         "above the ground"),
        ("bridge", {"world.localisation": "mocap", "mission.task.slide_m": 2.5,
                    "world.tubes.pillar left.diameter_m": 3.2}, "on the slide"),
    ],
)  # fmt: skip
def test_a_slide_beyond_reason_is_refused(world: str, sets: dict[str, Any], told: str) -> None:
    plan = plan_mission(load_description("wall-contact", world=world, sets=KNOWN | sets))
    assert not plan.feasible and told in str(plan.blocked_by), plan.blocked_by


def test_a_slide_ends_on_the_structure() -> None:
    with pytest.raises(InputError, match="valid is -3 to 3 m"):
        plan_mission(load_description("wall-contact", sets={"mission.task.slide_m": 4.0}))


@pytest.mark.parametrize("facing", ["down", "side"])
def test_an_arm_of_four_joints_finds_a_stance(facing: str) -> None:
    """A grid of all its postures would take gigabytes."""
    robot, _ = load_robot("tilthex-arm")
    stance = find_free_stance(robot, facing)
    toward = np.array([0.0, 0.0, 1.0] if facing == "down" else [1.0, 0.0, 0.0])
    assert stance.axis @ toward > math.cos(LEAN_MAX) and stance.tip @ toward > 0.4


def test_the_flying_press_counts_the_wind() -> None:
    """At the limit a rotor is at its own with the drag, and a head wind costs what it blows."""
    robot, _ = load_robot("f550-bridge")
    stance, R = find_free_stance(robot, "side"), np.eye(3)
    calm = compute_flying_press(robot, stance, R, 9.81)
    none = compute_flying_press(robot, stance, R, 9.81, wind=np.zeros(3))
    ahead = compute_flying_press(robot, stance, R, 9.81, wind=np.array([-4.0, 0.0, 0.0]))
    assert none == calm and ahead < 0.7 * calm
    drag = 0.5 * 1.2 * robot.platform.drag_area_x_m2 * 16.0  # of the body alone
    assert calm - ahead > drag
    assert math.isnan(compute_flying_press(robot, stance, R, 9.81, wind=np.array([-15.0, 0, 0])))


def test_a_press_whose_arm_meets_its_stop_is_given_up() -> None:
    """Hidden from its station the platform drifts by as much as the arm has, and then further."""
    sets = SHORT | {
        "mission.task.forces_n": [2.0, 4.0, 6.0], "mission.task.without_gear": True,
        "world.total_station.x_m": 9.5, "world.total_station.y_m": -7.0,
        "mission.task.hold_s": 3.0, "mission.task.stand_off_m": 0.4, "plant.spring_spread": 0.0,
    }  # fmt: skip
    result = fly_and_evaluate(load_description("bridge-contact", sets=sets, seed=4))
    assert result.outcome == "succeeded" and "at its stop" in result.reason, result.reason
    names = [p.name for p in result.phases]
    at = names.index("free retreat")
    after = result.samples[result.samples["phase"] > at]
    assert float(np.max(np.linalg.norm(after["f_contact"], axis=1))) == 0.0
    assert names[at + 1 :] == ["free leave", "return", "land"]


def test_a_rigid_stick_has_one_posture() -> None:
    robot = load_robot("f550-bridge")[0]
    stick = {"joint": "fixed", "length_m": 0.35, "mass_kg": 0.12}
    arm = Arm.model_validate({"links": {"stick": stick}, "servos": {}})
    rigid = robot.model_copy(update={"arm": arm})
    assert rigid.probe is not None
    stance = find_free_stance(rigid, "side")
    assert stance.q.shape == (0,) and stance.lean == pytest.approx(0.0, abs=1e-9)
    assert stance.tip == pytest.approx([0.35 + rigid.probe.length_m, 0.0, 0.0])
    with pytest.raises(InputError, match="cannot point its probe up"):
        find_free_stance(rigid, "down")
