"""Comparison of two robots: statics against closed forms, reach, table, page, wrong input."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from playwright.sync_api import Page

from page_checks import check_page
from skywright.analysis.campaign.jobs import fly_jobs
from skywright.analysis.compare.compare import add_flights, compare_robots, list_flights
from skywright.analysis.compare.comparison import Comparison
from skywright.analysis.compare.figures import draw_collisions
from skywright.analysis.compare.flown import WINDS, hover_once
from skywright.analysis.compare.report import render_compare_page
from skywright.analysis.compare.table import build_rows, judge_statements
from skywright.core.rotations import rot_z
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.missions.sensor_install.plan import build_pose
from skywright.models.compliant_arms import find_hands, find_swing
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.reach import PLATFORM_MARGIN, compute_reach
from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.scene import build_scene
from skywright.models.tip_force import Loaded
from skywright.run.versions import collect_versions

FORCES = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


def load_loaded(name: str, gravity: float = 9.81) -> Loaded:
    robot, _ = load_robot(name)
    q = build_pose(robot, "L", 0.1)
    return Loaded(robot, find_swing(build_body_model(robot), q), gravity)


STANDARD, LONG = load_loaded("bimanual"), load_loaded("bimanual-longreach")


@settings(max_examples=40, deadline=None)
@given(FORCES)
def test_rigid_arms_pass_a_force_on_with_its_lever(f: np.ndarray) -> None:
    found = STANDARD.compute_reaction(f)
    assert found is not None
    np.testing.assert_allclose(found.t, np.cross(STANDARD.hand(STANDARD.q)[0], f), atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(FORCES)
def test_a_passive_joint_passes_no_torque_about_its_axis(f: np.ndarray) -> None:
    """What is left about pitch is the force on the joint with the joint's own lever."""
    found = LONG.compute_reaction(f)
    assert found is not None
    assert LONG.robot.pendulum is not None and LONG.robot.pendulum.z_m is not None
    assert found.t[1] == pytest.approx(LONG.robot.pendulum.z_m * f[0], abs=1e-7)


@settings(max_examples=20, deadline=None)
@given(FORCES)
def test_the_link_rests_where_the_potential_is_stationary(f: np.ndarray) -> None:
    """Independent of the torques: energy of weight and force, by finite differences."""
    found = LONG.compute_reaction(f)
    assert found is not None

    def energy(angle: float) -> float:
        q = LONG.q.copy()
        q[0] = angle
        mass, p_BC, _ = compute_body(LONG.model, q)
        return float(mass * 9.81 * p_BC[2] - f @ LONG.hand(q)[0])

    at, step = LONG.q[0] + found.swing, 1e-5
    assert (energy(at + step) - energy(at - step)) / (2 * step) == pytest.approx(0.0, abs=1e-5)


def test_springs_give_way_as_their_compliance_says() -> None:
    """Without weight and within the linear range: J K^-1 J^T f."""
    arms = load_loaded("bimanual", gravity=1e-9)
    _, J, _ = arms.hand(arms.q)
    k = np.array([x.link.flex_stiffness_nm_per_rad for x in arms.joints], dtype=float)
    for f in 0.01 * np.eye(3):
        found = arms.compute_recoil(f)
        assert found is not None
        np.testing.assert_allclose(found.moved, J @ (J.T @ f / k), atol=2e-3 * 0.01)


def test_long_reach_touches_the_underside_and_standard_does_not() -> None:
    for name, below in (("bimanual", False), ("bimanual-longreach", True)):
        d = load_description("sensor-install", robot=name)
        m = compute_reach(d.robot, d.world, step=0.2, places=8)
        bottom = int(np.argmin(np.abs(m.angle - 1.5 * math.pi)))
        assert bool(m.touched[bottom]) is below
        assert m.touched[0] and m.touched[2]  # the side that faces the robot, and the top
    # the same place by hand: level forearm, hand at the underside, everything else clear
    d = load_description("sensor-install", robot="bimanual-longreach")
    q = find_swing(build_body_model(d.robot), build_pose(d.robot, "L", 0.1))
    goal = np.array([3.0, 0.0, 2.5 - 0.1 - 0.1])
    p = goal - find_hands(build_body_model(d.robot), q)[0]
    found = compute_clearance(build_clearance(build_scene(d.robot, d.world)), p, rot_z(0.0), q)
    assert found.distance > 0.0


@pytest.fixture(scope="module")
def pair() -> Comparison:
    return compare_robots("bimanual", "bimanual-longreach", fly=False)


def test_the_table_has_the_physics(pair: Comparison) -> None:
    rows = {r.name: r for r in pair.rows}
    mass = rows["mass_kg"].values
    assert mass[1] - mass[0] == pytest.approx(0.52)  # the link of the long reach
    near = rows["clearance.propellers_m"]
    assert near.values[0] < 0.0 < PLATFORM_MARGIN < near.values[1]
    assert "no plan" in near.notes[0] and not near.notes[1]
    # the longer lever about roll against the free joint about pitch
    assert rows["reaction.pitch_m"].winner == 1 and rows["reaction.roll_m"].winner == 0
    assert rows["reaction.pitch_m"].values[1] == pytest.approx(0.11, abs=1e-6)
    assert rows["access.depth_m"].values[1] - rows["access.depth_m"].values[0] > 0.7
    assert all("impact" not in name and "accuracy" not in name for name in rows)


def test_statements_are_judged_by_numbers(pair: Comparison) -> None:
    told = {(s.about, s.text): s.verdict for s in pair.statements}
    assert told["long reach", "heavier"] == "holds"
    assert told["long reach", "larger workspace"] == "holds"
    assert told["standard", "propellers and landing gear may collide"] == "holds"
    assert told["long reach", "safer"] == "partly"  # not about roll
    # rotors near surfaces are not simulated
    assert told["standard", "ground and airflow effects near surfaces"] == "not measured"
    swapped = (pair.sides[1], pair.sides[0])
    turned = judge_statements(swapped, build_rows(*swapped))
    assert {(s.about, s.text): s.verdict for s in turned} == told
    json.dumps(pair.to_json(), allow_nan=False)


@pytest.fixture(scope="module")
def page(pair: Comparison) -> str:
    pipe = load_description("sensor-install").world.pipe
    assert pipe is not None
    return render_compare_page(pair, pipe, collect_versions())


def test_nothing_of_the_page_is_cut_off(
    page: str, tmp_path: Path, show_page: Callable[..., Page]
) -> None:
    (tmp_path / "compare.html").write_text(page, encoding="utf-8")
    check_page(show_page, tmp_path / "compare.html", has_plots=False)


def test_the_page_is_complete_in_itself(page: str) -> None:
    assert page.count("<img") == 5  # pipe, way, reach, torque, recoil; nothing was flown
    assert "http:" not in page.replace("http://www.w3.org", "") and "https:" not in page
    for text in (
        "bimanual-longreach",
        "harder take-off and landing",
        "--no-fly",
        "8 hold, 2 partly",
    ):
        assert text in page


def test_collisions_of_hand_and_link_become_rows_and_bars(
    pair: Comparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[dict[str, object]] = []

    def load(mission: str, robot: str, sets: dict[str, object]) -> dict[str, object]:
        assert mission == "impact"
        return sets

    def fly(sets: dict[str, object]) -> SimpleNamespace:
        flown.append(sets)
        if sets["mission.task.part"] == "link":
            raise InputError("no way to the pad")
        hard = sets["mission.task.joints"] == "stiff"
        return SimpleNamespace(metrics={"impact.peak_torque_nm": 8.0 if hard else 3.0}, reason="")

    monkeypatch.setattr("skywright.analysis.compare.flown.load_description", load)
    monkeypatch.setattr("skywright.analysis.compare.flown.fly_and_evaluate", fly)
    monkeypatch.setattr(
        "skywright.analysis.compare.compare.hover_once",
        lambda robot, q, wind, seed: (0.01, math.nan if wind == WINDS[-1] else 0.02),
    )
    d = load_description("sensor-install", "bimanual")  # has no plan: is not flown
    sides = [side._replace(way=pair.sides[0].way) for side in pair.sides]
    a, b = (add_flights(x, fly_jobs(list_flights(x, d, x.name, 1))) for x in sides)
    assert [c.what for c in b.collisions] == ["hand, stiff joints", "hand", "passive link"]
    assert len(flown) == 5
    rows = {r.name: r for r in build_rows(a, b)}
    assert rows["impact.stiff_torque_nm"].values == (8.0, 8.0)
    assert rows["impact.peak_torque_nm"].values == (3.0, 3.0)
    assert rows["impact.link_torque_nm"].notes == ("has no passive link", "no way to the pad")
    assert rows["install.tip_mm"].notes[0].startswith("not flown")
    assert "lost in 1 of 1" in rows["accuracy.platform_wind_mm"].notes[0]
    c = pair._replace(sides=(a, b))
    figure = draw_collisions(c)
    assert figure is not None and len(figure.axes[0].patches) == 4


def test_robots_without_hands_are_compared_where_it_applies() -> None:
    found = compare_robots("othex", "f550-bridge", fly=False)
    rows = {r.name: r for r in found.rows}
    assert all("does not apply" in n for n in rows["clearance.propellers_m"].notes)
    assert math.isfinite(rows["recoil.tip_mm"].values[0])  # OTHex's links bend in their joints
    assert "no springs" in rows["recoil.tip_mm"].notes[1]
    assert all(math.isfinite(v) for v in rows["power.endurance_min"].values)
    assert {s.verdict for s in found.statements} == {"does not apply"}


def test_variants_of_one_robot_are_told_apart(tmp_path: Path) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(
        '[robot]\nname = "bimanual"\nextends = "bimanual"\n[robot.platform]\nmass_kg = 6.0\n'
    )
    found = compare_robots("bimanual", str(file), fly=False)
    mass = next(r for r in found.rows if r.name == "mass_kg").values
    assert mass[1] - mass[0] > 0.5
    assert list(found.to_json()["maps"]) == ["bimanual", str(file)]


def test_a_calm_hover_keeps_the_tip_near() -> None:
    robot, _ = load_robot("bimanual")
    tip, platform = hover_once("bimanual", build_pose(robot, "L", 0.1), 0.0, 1)
    assert 0.0 < tip < 0.05 and 0.0 < platform < 0.05


@pytest.mark.parametrize(
    ("args", "found"),
    [
        (["bimanual", "bimanual"], "same robot"),
        (["bimanual", "hexarotor"], "has no links"),
        (["bimanual", "bimanul"], "bimanual"),
        (["bimanual", "othex", "--set", "robot.mass=1"], "world"),
        (["bimanual", "othex", "--set", "world.pipe.radius=1"], "radius"),
        (["bimanual", "othex", "--seeds", "0"], "at least 1"),
        (["bimanual", "othex", "--out", "page.pdf"], "unknown format"),
        (["bimanual", "othex", "--out", "/dev/null/page.html"], "cannot be written"),
        (["bimanual", "othex", "--set", "world.pipe=none"], "world.pipe"),
        (["bimanual"], "Missing argument 'B'"),
    ],
)
def test_wrong_input_is_told(args: list[str], found: str, tmp_path: Path) -> None:
    from skywright.cli import main

    code = subprocess_free(main, ["compare", *args], tmp_path)
    assert code[0] == 2 and found in code[1]
    assert not list(tmp_path.iterdir())  # nothing half-written


def subprocess_free(main: object, args: list[str], folder: Path) -> tuple[int, str]:
    """Run the command line in this process; returns exit code and stderr."""
    import contextlib
    import io
    import os

    error, here = io.StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stderr(error), contextlib.suppress(SystemExit):
            try:
                main.main(args)  # type: ignore[attr-defined]
            except SystemExit as stop:
                return int(stop.code or 0), error.getvalue()
    finally:
        os.chdir(here)
    return 0, error.getvalue()


def test_seeds_and_sets_are_checked_in_python_too() -> None:
    with pytest.raises(InputError, match="world"):
        compare_robots("bimanual", "othex", sets=["mission.seed=3"])
