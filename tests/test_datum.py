"""Registration by a datum mark: its table, the geometry, the camera, and flights that use it."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from skywright.core.rotations import rot_x, rot_y, rot_z
from skywright.description.loader import load_description
from skywright.description.map_error import displace_world
from skywright.description.world.datum import find_datum, locate_datum
from skywright.description.world.loader import load_world
from skywright.description.world.spec import Pipe
from skywright.description.world.structure import Structure, build_surface, find_place, locate_point
from skywright.description.world.surface import (
    Cylinder,
    build_cylinder,
    level_axes,
    roll_points,
    unroll_points,
)
from skywright.errors import InputError
from skywright.inspection.history.entries import Entries
from skywright.inspection.touches import MapError, fit_cylinder_touches
from skywright.missions.crack_scan import judge
from skywright.missions.scan.entries import build_entries
from skywright.missions.scan.metrics import find_survey
from skywright.missions.sensor_install.metrics import find_place as find_pressed
from skywright.missions.skills.datum import (
    SeenMark,
    explain_view,
    get_datum,
    judge_datum,
    register_cylinder,
    register_surface,
    spread_over_pipe,
)
from skywright.missions.skills.surveyed import move_pipe
from skywright.missions.skills.surveyed_structure import move_structure
from skywright.missions.tool_install.plan import find_places
from skywright.models.things.datum import Datum
from skywright.planning.scan import choose_axes
from skywright.planning.survey import choose_points
from skywright.run.backends import build_vehicle
from skywright.run.flight import Flown
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup
from skywright.run.supervisor import Supervisor

MARK: dict[str, Any] = {
    "world.things.mark.kind": "datum", "world.things.mark.s_m": 0.12,
    "world.things.mark.around_deg": 5.0, "robot.probe.camera.rate_hz": 30.0,
}  # fmt: skip
SHORT: dict[str, Any] = {
    **MARK, "mission.task.passes": 2, "mission.task.arc_deg": 20.0,
    "mission.task.pass_length_m": 0.1, "mission.task.speed_mps": 0.03,
    "plant.map_error_m": 0.015, "plant.map_error_deg": 1.5,
}  # fmt: skip
PIPE = Pipe(diameter_m=0.4, length_m=1.0, x_m=2.0, y_m=0.1, z_m=1.5)


@pytest.mark.parametrize("keys", [
    {}, {"s_m": 0.1}, {"x_m": 0.1}, {"s_m": 0.1, "around_deg": 0.0, "x_m": 0.1, "y_m": 0.0},
])  # fmt: skip
def test_a_datum_needs_one_place(keys: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="needs its place: s_m and around_deg on the pipe, or"):
        Datum(**keys)


def test_a_datum_that_does_not_fit_its_world_is_refused() -> None:
    on_deck = {"kind": "datum", "x_m": 0.0, "y_m": 0.0}
    sets = {f"world.things.mark.{k}": v for k, v in on_deck.items()}
    with pytest.raises(InputError, match=r"world.things.mark: world 'pipe' has no structure.*s_m"):
        find_datum(load_description("pipe-weld-scan", sets=sets).world)
    two = {**MARK, **{k.replace("mark", "other"): v for k, v in MARK.items()}}
    with pytest.raises(InputError, match="mark, other are datums; valid: at most one"):
        find_datum(load_description("pipe-weld-scan", sets=two).world)


def test_roll_turns_where_phi_counts_from() -> None:
    """At roll r the place phi is where phi + r was; in the middle of the side that faces -x."""
    rolled = build_cylinder(PIPE.model_copy(update={"roll_deg": 30.0}))
    p, n = roll_points(rolled, 0.2, 0.0)
    np.testing.assert_allclose(n[0], [-math.cos(math.pi / 6), 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(p[0], [2.0 - 0.2 * math.cos(math.pi / 6), 0.3, 1.6], atol=1e-12)


@pytest.mark.parametrize("inclination", [0.0, -20.0, 60.0, 90.0])
def test_a_rolled_pipe_is_written_as_a_table(inclination: float) -> None:
    told = PIPE.model_copy(update={"yaw_deg": 35.0, "inclination_deg": inclination})
    R = rot_z(math.radians(50.0)) @ rot_x(math.radians(inclination)) @ rot_y(math.radians(-12.0))
    found = Cylinder(np.array([1.0, 2.0, 3.0]), np.ascontiguousarray(R), 0.21, 0.5)
    again = build_cylinder(move_pipe(told, found))
    np.testing.assert_allclose(again.R_WP, found.R_WP, atol=1e-9)
    np.testing.assert_allclose(again.p_WP, found.p_WP)


def test_the_map_errs_about_the_axis_too_and_as_before_elsewhere() -> None:
    d = load_description("pipe-weld-scan", sets={"plant.map_error_deg": 2.0})
    rolls = [displace_world(d.world, d.plant, seed) for seed in range(40)]
    roll = np.array([w.pipe.roll_deg for w in rolls if w.pipe is not None])
    yaw = np.array([w.pipe.yaw_deg for w in rolls if w.pipe is not None])
    assert 1.5 < np.max(np.abs(roll)) <= 2.0 and abs(np.corrcoef(roll, yaw)[0, 1]) < 0.5


def test_a_mark_registers_a_pipe_exactly() -> None:
    """A survey that knows the surface, but not where along and around it is."""
    true = build_cylinder(PIPE.model_copy(update={"yaw_deg": 20.0, "roll_deg": 3.0}))
    found = Cylinder(
        true.p_WP + 0.013 * true.R_WP[:, 1],
        np.ascontiguousarray(true.R_WP @ rot_y(math.radians(-4.0))), true.radius, true.half_length,
    )  # fmt: skip
    datum = Datum(s_m=0.2, around_deg=170.0)
    p, _ = roll_points(true, 0.2, true.radius * math.radians(170.0))
    again = register_cylinder(found, datum, SeenMark(p[0], 0.001, 60))
    np.testing.assert_allclose(again.p_WP, true.p_WP, atol=1e-12)
    np.testing.assert_allclose(again.R_WP, true.R_WP, atol=1e-12)


@pytest.mark.parametrize("keys", [
    {"facing": "side", "slope_deg": 3.0}, {"facing": "down", "slope_deg": 4.0},
    {"facing": "side", "shape": "cylinder", "radius_m": 0.3},
    {"facing": "down", "shape": "cylinder", "radius_m": 0.5},
])  # fmt: skip
def test_a_mark_registers_a_structure(keys: dict[str, Any]) -> None:
    """S moves over the surface; the mark and what lies near it have their places again."""
    true = Structure(x_m=2.0, y_m=0.2, z_m=2.0, yaw_deg=25.0, **keys)
    surface = build_surface(true)
    p, R = locate_point(surface, np.array([0.02, -0.015]))  # where a survey has S
    found = move_structure(true, p, R[:, 2], surface.R_WS[:, 0])
    mark = locate_point(surface, np.array([0.1, 0.2]))[0]
    p, n = register_surface(build_surface(found), Datum(x_m=0.1, y_m=0.2), SeenMark(mark, 0.0, 60))
    again = build_surface(move_structure(found, p, n, build_surface(found).R_WS[:, 0]))
    np.testing.assert_allclose(find_place(again, mark), [0.1, 0.2, 0.0], atol=1e-4)
    spot = locate_point(surface, np.array([-0.1, 0.1]))[0]
    np.testing.assert_allclose(find_place(again, spot), [-0.1, 0.1, 0.0], atol=5e-4)


def test_the_datum_is_judged_along_the_surface() -> None:
    setup = Setup(load_description("pipe-weld-scan", sets=MARK))
    true, datum = setup.true.cylinder, find_datum(setup.world)
    assert true is not None and datum is not None
    p, n = roll_points(true, 0.123, true.radius * math.radians(5.0) - 0.004)
    mark = SeenMark(p[0] + 0.01 * n[0], 0.0007, 42)
    tips = np.zeros(4, [("est_p_WT", float, 3), ("p_WT", float, 3)])
    m = judge_datum(setup, mark, tips, np.zeros(4, bool), 0.0011)
    assert m["datum.place_std_mm"] == pytest.approx(1.1)
    assert m["datum.error_mm"] == pytest.approx(5.0, abs=0.01)
    tips["est_p_WT"][2:] = 0.003 * true.R_WP[:, 1]  # the tip is off by as much at work
    shared = judge_datum(setup, mark, tips, np.array([False, False, True, True]), 0.0)
    assert shared["datum.error_mm"] == pytest.approx(4.0, abs=0.01)
    assert m["datum.std_mm"] == pytest.approx(0.7) and m["datum.images"] == 42.0
    at = locate_datum(setup.true.world, datum)
    s, c, off = unroll_points(true, at.p[None])
    assert (s[0], c[0], off[0]) == pytest.approx((0.12, true.radius * math.radians(5.0), 0.0))


@pytest.mark.parametrize(("keys", "message"), [
    ({"s_m": 0.3, "around_deg": 0.0}, r"mark.s_m = 0.3 lies beside the pipe.*valid: -0.25 to 0.25"),
    ({"x_m": 5.0, "y_m": 0.0}, r"mark.x_m = 5 lies beside the structure.*valid: -1.5 to 1.5"),
])  # fmt: skip
def test_a_mark_beside_its_surface_is_refused(keys: dict[str, float], message: str) -> None:
    world = load_description("pipe-weld-scan" if "s_m" in keys else "thickness-survey").world
    world = world.model_copy(update={"things": {"mark": Datum(**keys)}})
    with pytest.raises(InputError, match=message):
        find_datum(world)


def test_a_mark_on_an_upright_pillar_is_between_its_ends() -> None:
    """It is `width_m` = 4 m high; `length_m` = 6 m does not shape it."""
    world = load_world("pillar")[0]
    mark = Datum(x_m=0.0, y_m=1.9)
    assert find_datum(world.model_copy(update={"things": {"mark": mark}})) == mark
    above = world.model_copy(update={"things": {"mark": Datum(x_m=0.0, y_m=2.1)}})
    with pytest.raises(InputError, match=r"mark.y_m = 2.1 lies beside .*valid: -2 to 2"):
        find_datum(above)


def test_far_from_the_mark_the_pipes_direction_counts() -> None:
    """Against surveys with an exact mark: deviations of places, and what is stated of them."""
    setup = Setup(load_description("pipe-weld-scan", sets=MARK))
    true, datum, map_ = setup.cylinder, find_datum(setup.world), MapError(0.01, 0.017, 0.002)
    assert true is not None and datum is not None
    points = choose_points(np.array([[-0.1, -0.2], [0.02, 0.2]]))
    p, n = roll_points(true, points[:, 0], true.radius * points[:, 1])
    s, phi = datum.get_place()
    mark = SeenMark(roll_points(true, s, true.radius * phi)[0][0], 0.0, 60)
    far = np.array([[-0.15, 0.3]])
    x, _ = roll_points(true, far[:, 0], true.radius * far[:, 1])
    rng, off, stated = np.random.default_rng(1), [], []
    for _ in range(60):
        turned = true._replace(
            p_WP=true.p_WP + true.R_WP @ (rng.uniform(-0.01, 0.01, 3) * [1.0, 0.0, 1.0]),
            R_WP=true.R_WP @ rot_z(rng.uniform(-0.017, 0.017)) @ rot_x(rng.uniform(-0.017, 0.017)),
            radius=true.radius + rng.uniform(-0.002, 0.002),
        )  # the map
        touches = p + (0.004 + rng.normal(0.0, 5e-4, len(p)))[:, None] * n
        found = fit_cylinder_touches(turned, map_, touches, 0.004, 5e-4)
        found = found._replace(cylinder=register_cylinder(found.cylinder, datum, mark))
        at, c, _ = unroll_points(found.cylinder, x, near=true.radius * 0.3)
        off.append([at[0] + 0.15, c[0] / found.cylinder.radius * true.radius - true.radius * 0.3])
        stated.append(spread_over_pipe(setup, found, datum, mark, far))
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.max(rms) > 1e-3  # none of it is in the deviation at the mark
    assert 0.7 * np.max(rms) < np.mean(stated) < 1.5 * np.max(rms)


def test_a_mark_that_may_be_out_of_view_is_refused() -> None:
    setup = Setup(load_description("pipe-weld-scan", sets=MARK))
    assert explain_view(setup, 0.08, 0.01, 0.03) == ""
    assert "the datum may be 230 mm aside" in explain_view(setup, 0.08, 0.01, 0.2)
    near = {**MARK, "robot.probe.camera.range_max_m": 0.1}
    assert "range_max_m = 0.1: the datum may be 0.17 m away" in explain_view(
        Setup(load_description("pipe-weld-scan", sets=near)), 0.08, 0.01, 0.03
    )
    rare = {**MARK, "robot.probe.camera.rate_hz": 2.0}
    assert "rate_hz = 2 gives 4 images of the datum in 2 s, 10 are needed" in explain_view(
        Setup(load_description("pipe-weld-scan", sets=rare)), 0.08, 0.01, 0.03
    )
    flat = {**MARK, "robot.probe.camera.slant_max_deg": 15.0}
    assert "the datum may be seen at 23 deg from its normal" in explain_view(
        Setup(load_description("pipe-weld-scan", sets=flat)), 0.08, 0.01, 0.03
    )
    behind = plan_mission(load_description("pipe-weld-scan", sets={
        **MARK, "world.things.mark.around_deg": -170.0, "plant.map_error_m": 0.01,
    }))  # fmt: skip
    assert not behind.feasible and behind.blocked_by is not None
    assert "cannot look at the datum at s = 0.12 m, phi = -170 deg" in behind.blocked_by
    assert behind.blocked_by.endswith("or set mission.task.datum=false")
    without = {**MARK, "world.things.mark.around_deg": -170.0, "mission.task.datum": False}
    assert get_datum(Setup(load_description("pipe-weld-scan", sets=without))) is None


def test_gravity_has_axes_of_its_own() -> None:
    """Seats and presses from below do not turn with a pipe whose map errs about its axis."""
    told = PIPE.model_copy(update={"yaw_deg": 30.0, "inclination_deg": 10.0})
    rolled = build_cylinder(told.model_copy(update={"roll_deg": 25.0}))
    np.testing.assert_allclose(level_axes(rolled.R_WP), build_cylinder(told).R_WP, atol=1e-12)
    upright = build_cylinder(told.model_copy(update={"inclination_deg": 90.0, "roll_deg": 5.0}))
    np.testing.assert_array_equal(level_axes(upright.R_WP), upright.R_WP)
    d = load_description("tool-install")
    assert d.world.pipe is not None
    seats = [
        find_places(d.world.model_copy(update={
            "pipe": d.world.pipe.model_copy(update={"roll_deg": roll})
        }), d.mission.task)[1]
        for roll in (0.0, 8.0)
    ]  # fmt: skip
    np.testing.assert_allclose(seats[0].p_WO, seats[1].p_WO, atol=1e-12)


def test_the_probe_follows_a_rolled_pipe_as_it_does_a_level_one() -> None:
    """Near the top of a pipe that leans by 2 deg, phi counts from the roll for the axes as well."""
    told = PIPE.model_copy(update={"inclination_deg": 2.0})
    phi, roll = np.radians([[0.0, 80.0], [0.0, 100.0]]), math.radians(6.0)
    flat = choose_axes(build_cylinder(told), phi)
    turned = choose_axes(
        build_cylinder(told.model_copy(update={"roll_deg": 6.0})), phi - [[0.0, roll], [0.0, roll]]
    )
    assert abs(flat[2, 1]) < 1e-12  # level
    np.testing.assert_allclose(turned, flat @ rot_y(roll), atol=1e-3)


def test_a_press_from_below_is_judged_by_gravity() -> None:
    """A pipe whose map errs about its axis has its lowest line where it had it."""
    for roll in (0.0, 20.0):
        pipe = build_cylinder(PIPE.model_copy(update={"roll_deg": roll, "yaw_deg": 30.0}))
        below = pipe.p_WP + 0.05 * pipe.R_WP[:, 1] - [0.0, 0.0, 0.23]
        around, along = find_pressed(below[None], pipe)
        assert around == pytest.approx(0.0, abs=1e-9) and along == pytest.approx(0.05)


def test_a_scan_counts_from_the_mark() -> None:
    """What a survey leaves open along and around the pipe is within three deviations."""
    run = fly_and_evaluate(load_description("pipe-weld-scan", sets=SHORT, seed=3))
    m, setup = run.metrics, Setup(run.description)
    assert run.outcome == "succeeded", run.reason
    assert m["datum.images"] >= 50.0
    assert m["datum.error_mm"] < 3.0 * m["datum.std_mm"] < 3.0
    flown = Flown(setup, run.plan, run.samples, run.phases)
    surveyed, true = find_survey(flown), setup.true.cylinder
    assert surveyed is not None and surveyed.mark is not None and true is not None
    known, mapped = surveyed.found.cylinder, setup.cylinder
    assert mapped is not None
    place = [0.03, 0.02]
    p, _ = roll_points(true, place[0], place[1])
    by_datum, by_map = (np.array(unroll_points(x, p)[:2])[:, 0] for x in (known, mapped))
    assert np.linalg.norm(by_datum - place) < 0.004 < np.linalg.norm(by_map - place)
    names = [p.name for p in run.phases]
    assert names.index("look") < names.index("survey_touch")
    entries: Entries = build_entries(flown)
    assert entries.registration_std_m == pytest.approx(1e-3 * m["datum.place_std_mm"])
    assert m["datum.place_std_mm"] > m["datum.std_mm"]
    stored = np.array([[i.x_m, i.y_m, i.z_m] for _, i in entries.indications])
    s, c, off = unroll_points(mapped, stored)
    assert len(stored) == 2 and np.max(np.abs(off)) < 1e-6
    world = run.description.world
    assert world.weld is not None
    slope = math.tan(math.radians(world.weld.angle_deg))
    line = world.weld.offset_m + mapped.radius * slope * np.sin(c / mapped.radius)
    assert np.max(np.abs(s - line)) < 0.005  # where the asset has its weld, not where the map is


def test_a_mark_that_is_not_there_sends_the_robot_home() -> None:
    d = load_description("pipe-weld-scan", sets=SHORT, seed=3)
    setup = Setup(d)
    things = dict(setup.true.world.things)
    things["mark"] = Datum(s_m=-0.2, around_deg=5.0)
    setup.true.world = setup.true.world.model_copy(update={"things": things})
    plan, vehicle = plan_mission(d, setup), build_vehicle(d, setup=setup)
    flight = Supervisor(vehicle, d.mission, plan, d.robot.platform.gear_height_m).fly()
    assert not flight.completed
    assert flight.reason.startswith("datum: its mark was seen 0 times in 2 s, at least 10")


@pytest.mark.parametrize("seen", [True, False])
def test_cracks_are_judged_from_the_datum(monkeypatch: pytest.MonkeyPatch, seen: bool) -> None:
    """With a mark, what the found pipe is off along itself is an error of an indication's place."""
    setup = Setup(load_description("crack-scan"))
    true = setup.true.cylinder
    assert true is not None
    known = true._replace(p_WP=true.p_WP + 0.006 * true.R_WP[:, 1])
    surveyed = SimpleNamespace(mark=SeenMark(np.zeros(3), 0.001, 60) if seen else None)
    monkeypatch.setattr(judge, "get_surface", lambda run: known)
    monkeypatch.setattr(judge, "find_survey", lambda run: surveyed)
    monkeypatch.setattr(judge, "as_scan", lambda run: run)
    run: Any = SimpleNamespace(setup=setup, task=setup.task)
    flaws = {f.name: f for f in judge.list_flaws(run)[0]}
    assert flaws["crack1"].s == pytest.approx(0.064)  # where it is, for signal and detection
    around = true.radius * math.radians(5.0)
    assert flaws["crack1"].wanted == pytest.approx((0.07 if seen else 0.064, around))
