"""`skywright run --plan FILE`: a plan file of any planner, checked and flown."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from skywright.cli import main
from skywright.core.rotations import rot_z
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.errors import InputError
from skywright.missions.skills import plan_flight
from skywright.missions.skills.plan_flight import (
    PRECISION,
    RESOLUTION,
    find_closest,
    load_checked_plan,
    load_plan_description,
)
from skywright.missions.skills.plan_table import LEAD_S, build_plan_table
from skywright.models.geometry import compute_clearance
from skywright.models.rigid_body import build_body_model, joint_names
from skywright.models.self_contact import find_self_contact
from skywright.planning.motion.plan_file import PlanFile, write_plan_file
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup
from skywright.vehicle.rest_to_rest import quintic


def build_line(robot: str, length: float = 1.0, duration: float = 4.0) -> PlanFile:
    """A straight flight forward at 2 m, from rest to rest, joints at work."""
    joints = tuple(joint_names(load_robot(robot)[0]))
    t = np.linspace(0.0, duration, round(duration / 0.02) + 1)
    s, ds, dds = quintic(t / duration)
    pose, rate, acceleration = (np.zeros((len(t), 4)) for _ in range(3))
    pose[:, 0], pose[:, 2] = length * s, 2.0
    rate[:, 0], acceleration[:, 0] = length * ds / duration, length * dds / duration**2
    q = np.zeros((len(t), len(joints)))
    return PlanFile(
        robot, "open", 1, joints, t, pose, rate, acceleration, q, np.zeros_like(q), {}
    )  # fmt: skip


def test_a_plan_flies_by_itself(tmp_path: Path) -> None:
    write_plan_file(tmp_path / "line", build_line("hexarotor"))
    result = fly_and_evaluate(load_plan_description(tmp_path / "line.csv"))
    assert result.outcome == "succeeded", result.reason
    assert result.samples["p_WB"][-1, 0] == pytest.approx(1.0, abs=0.05)


def test_the_platform_leads_what_hangs_on_it() -> None:
    plan = build_line("ars-lrm")
    model = build_body_model(load_robot("ars-lrm")[0])
    table = build_plan_table(plan, model)
    assert table["t"][-1] == pytest.approx(plan.t[-1] + LEAD_S, abs=0.03)
    np.testing.assert_allclose(table["p_WB"][[0, -1], 0], plan.pose[[0, -1], 0], atol=1e-12)
    # by z a / g at the largest acceleration, rounded over a second
    lead = table["p_WB"][:, 0] - np.interp(table["t"] - 0.5 * LEAD_S, plan.t, plan.pose[:, 0])
    below = float(table["p_WB"][0, 2] - table["p_WT"][0, 2])
    assert lead.max() == pytest.approx(below * plan.acceleration[:, 0].max() / 9.81, rel=0.1)
    # and its velocity and acceleration belong to its place
    v = np.gradient(table["p_WB"][:, 0], table["t"])
    np.testing.assert_allclose(table["v_WB"][:, 0], v, atol=2e-3)
    np.testing.assert_allclose(table["a_WB"][:, 0], np.gradient(v, table["t"]), atol=1e-2)


def test_what_a_robot_cannot_fly_is_refused(tmp_path: Path) -> None:
    fast = build_line("hexarotor", length=4.0)
    write_plan_file(tmp_path / "fast", fast)
    with pytest.raises(
        InputError, match=r"speed of the plan is 1.8. m/s; robot 'hexarotor' flies at most 1 m/s"
    ):
        plan_mission(load_plan_description(tmp_path / "fast"))
    bent = build_line("ars-lrm")
    bent.q[:, 2] = 0.5  # elbow
    write_plan_file(tmp_path / "bent", bent)
    with pytest.raises(
        InputError, match=r"left_elbow_pitch goes to 28.6\d* deg; its range is -150"
    ):
        plan_mission(load_plan_description(tmp_path / "bent"))
    write_plan_file(tmp_path / "carry", build_line("ars-lrm"))
    with pytest.raises(InputError, match="the plan begins at"):
        plan_mission(
            load_plan_description(
                tmp_path / "carry", "bar-transport", sets={"mission.start_x_m": 0.5}
            )
        )
    # through the rack
    low = build_line("ars-lrm", length=3.0, duration=8.0)._replace(world="pipe-structures")
    write_plan_file(tmp_path / "low", low)
    plan = plan_mission(load_plan_description(tmp_path / "low"))
    assert not plan.feasible
    assert "touch" in str(plan.blocked_by)


def build_fast(what: str) -> PlanFile:
    """A plan that exceeds one limit of its robot."""
    if what == "speed":
        return build_line("hexarotor", 2.4)
    if what == "acceleration":
        return build_line("hexarotor", 0.6, 1.2)
    plan = build_line("ars-lrm" if what == "servo" else "hexarotor", 0.0, 0.2)
    s, ds, dds = quintic(plan.t / 0.2)
    if what == "yaw":
        plan.pose[:, 3], plan.rate[:, 3], plan.acceleration[:, 3] = s, ds / 0.2, dds / 0.04
    elif what == "servo":
        plan.q[:, 1], plan.qd[:, 1] = -s, -ds / 0.2
    else:  # a step of the velocity, with an acceleration of one row that is twice the mean
        plan.rate[1:, 0], plan.acceleration[1, 0] = 0.02, 2.0
        plan.pose[1:, 0] = 0.02 * plan.t[1:]
    return plan


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("speed", r"line 102, the speed of the plan is 1\.1"),
        ("acceleration", r"the acceleration by its columns is 2\.4. m/s\^2; .* at most 0\.8"),
        ("step", r"line 3, the acceleration by its columns is 2\.00 m/s\^2"),
        ("yaw", r"line 7, yaw_rate_rad_s is 9\.38 rad/s; valid: at most 0\.8 rad/s"),
        ("servo", r"the servo of left_shoulder_pitch moves at 9\.38 rad/s; without load .* 7\.1"),
    ],
)
def test_motions_faster_than_the_robot_are_refused(tmp_path: Path, what: str, message: str) -> None:
    write_plan_file(tmp_path / "fast", build_fast(what))
    with pytest.raises(InputError, match=message):
        plan_mission(load_plan_description(tmp_path / "fast"))


def test_a_step_of_the_velocity_is_an_acceleration(tmp_path: Path) -> None:
    """0.1 m/s within one row are 5 m/s^2, which acceleration columns of 0.7 m/s^2 hide."""
    plan = build_line("hexarotor", 0.0, 0.2)
    plan.rate[5:, 0], plan.pose[5:, 0] = 0.02, 0.02 * (plan.t[5:] - plan.t[4])
    plan.acceleration[4:6, 0] = 0.7
    write_plan_file(tmp_path / "step", plan)
    with pytest.raises(InputError, match=r"line 7, the acceleration by the step of its velocity"):
        plan_mission(load_plan_description(tmp_path / "step"))


def test_a_plan_in_few_rows_is_checked_between_them(tmp_path: Path) -> None:
    """Four rows, all beside the rack of the world, pass through it."""
    t = np.array([0.0, 10 / 3, 20 / 3, 10.0])
    pose, rate, none = np.zeros((4, 4)), np.zeros((4, 4)), np.zeros((4, 0))
    pose[:, 0], pose[:, 2], rate[:, 0] = (0.0, 1.5, 4.5, 6.0), 1.2, (0.0, 0.9, 0.9, 0.0)
    plan = PlanFile(
        "hexarotor", "pipe-structures", 1, (), t, pose, rate, np.zeros((4, 4)), none, none, {}
    )
    setup = Setup(load_description("waypoints", "hexarotor", "pipe-structures"))
    query = setup.clearance
    rows = [compute_clearance(query, p[:3], np.eye(3), np.zeros(0)).distance for p in pose]
    assert min(rows) > 0.05
    distance, what = find_closest(plan, setup)
    assert distance < 0.0 and "tube rack" in what
    write_plan_file(tmp_path / "coarse", plan)
    found = plan_mission(load_plan_description(tmp_path / "coarse"))
    assert not found.feasible and "tube rack" in str(found.blocked_by)


def test_a_plan_in_which_parts_of_the_robot_touch_is_refused(tmp_path: Path) -> None:
    """Both ends are free; between them an elbow goes through a propeller."""
    setup = Setup(load_description("follow-plan", "tilthex-arm", "open"))
    t, still = np.linspace(0.0, 4.0, 5), np.zeros((5, 4))
    pose = np.tile([0.0, 0.0, 3.0, 0.0], (5, 1))
    a, b = np.radians([[13.0, -24.0, 6.0, -82.0], [-5.0, 37.0, 94.0, -23.0]])
    q, qd = a + np.outer(t / 4.0, b - a), np.tile((b - a) / 4.0, (5, 1))
    plan = PlanFile(
        "tilthex-arm", "open", 1, setup.planning_scene.joints, t, pose, still, still, q, qd, {}
    )
    assert not find_self_contact(setup.planning_scene.contacts, q[[0, -1]])
    assert compute_clearance(setup.clearance, pose[0, :3], np.eye(3), q[0]).distance > 1.0
    write_plan_file(tmp_path / "through", plan)
    found = plan_mission(load_plan_description(tmp_path / "through"))
    assert not found.feasible and "propeller" in str(found.blocked_by)
    when = float(str(found.blocked_by).split(" s touch")[0].split("t = ")[1])
    assert find_self_contact(setup.planning_scene.contacts, a[None] + (when + 0.01) / 4 * (b - a))


def test_the_closest_pose_is_that_of_a_dense_search() -> None:
    """A turn beside the rack, in two rows; 2,000 poses between them are the reference."""
    setup = Setup(load_description("waypoints", "ars-lrm", "pipe-structures"))
    plan = build_line("ars-lrm", 0.0, 4.0)
    plan = plan._replace(**{n: getattr(plan, n)[[0, -1]] for n in ("t", "pose", "rate", "q")})
    plan.pose[:] = [[1.2, 0.0, 2.5, -0.5], [1.9, 0.3, 2.4, 1.0]]
    plan.q[1, 1:] = -0.6
    dense = math.inf
    for u in np.linspace(0.0, 1.0, 2001):
        p = (1 - u) * plan.pose[0] + u * plan.pose[1]
        q = (1 - u) * plan.q[0] + u * plan.q[1]
        dense = min(dense, compute_clearance(setup.clearance, p[:3], rot_z(p[3]), q).distance)
    assert find_closest(plan, setup)[0] == pytest.approx(dense, abs=RESOLUTION / 2)


@pytest.mark.parametrize("seed", [None, 1])
def test_the_check_of_a_level_plan_takes_few_queries(
    monkeypatch: pytest.MonkeyPatch, seed: int | None
) -> None:
    """100 m in 51 rows at a constant distance; random structures are drawn once."""
    t = np.linspace(0.0, 200.0, 51)
    pose, none = np.zeros((51, 4)), np.zeros((51, 0))
    pose[:, 0], pose[:, 2] = np.linspace(20.0, 120.0, 51), 2.0
    zeros = np.zeros((51, 4))
    plan = PlanFile("hexarotor", "open", 1, (), t, pose, zeros, zeros, none, none, {})
    setup = Setup(load_description("waypoints", sets={"world.scenario_seed": seed} if seed else {}))
    assert setup.planning_scene and setup.clearance  # built before the calls are counted
    calls = {"compute_clearance": 0, "get_limits": 0}

    def count(name: str) -> None:
        real = getattr(plan_flight, name)

        def counted(*values: object) -> object:
            calls[name] += 1
            return real(*values)

        monkeypatch.setattr(plan_flight, name, counted)

    for name in calls:
        count(name)
    distance, _ = find_closest(plan, setup)
    assert calls["get_limits"] == 1
    if seed is None:
        foot = compute_clearance(setup.clearance, pose[0, :3], np.eye(3), none[0]).distance
        assert distance == pytest.approx(foot) and foot > 0.5
        assert calls["compute_clearance"] <= 51 + 2 * 100.0 / (2.0 * PRECISION * foot)


def test_a_plan_stays_in_the_area_of_the_world(tmp_path: Path) -> None:
    plan = build_line("hexarotor", -3.0, 8.0)._replace(world="pipe-structures")
    write_plan_file(tmp_path / "back", plan)
    found = plan_mission(load_plan_description(tmp_path / "back"))
    assert not found.feasible and "the limits of world.area" in str(found.blocked_by)


def test_a_plan_begins_with_the_mission_s_heading(tmp_path: Path) -> None:
    plan = build_line("hexarotor")
    plan.pose[:, 3] = math.radians(350.0)
    write_plan_file(tmp_path / "turned", plan)
    file = str(tmp_path / "turned.csv")
    d = load_plan_description(file, sets={"mission.start_yaw_deg": -10.0})
    assert load_checked_plan(file, d).pose[0, 3] == pytest.approx(math.radians(350.0))
    d = load_plan_description(file, sets={"mission.start_yaw_deg": 45.0})
    with pytest.raises(InputError, match=r"heading of 350\.0 deg, the mission with 45 deg"):
        load_checked_plan(file, d)


def test_a_plan_is_flown_in_the_random_structures_of_its_planning(tmp_path: Path) -> None:
    drawn = build_line("hexarotor")._replace(
        world="pipe-structures", scenario_seed=1, difficulty=0.75
    )
    file = write_plan_file(tmp_path / "drawn", drawn)[0]
    world = load_plan_description(file).world
    assert (world.scenario_seed, world.difficulty) == (1, 0.75)
    assert load_plan_description(file, sets={"world.scenario_seed": 3}).world.scenario_seed == 3
    world = load_plan_description(file, "bar-transport").world
    assert (world.scenario_seed, world.difficulty) == (1, 0.75)
    assert load_plan_description(file, "bar-transport", world="open").world.scenario_seed is None
    assert load_plan_description(file, world="open").world.scenario_seed is None


def test_the_command_refuses_what_is_no_plan(tmp_path: Path) -> None:
    files = write_plan_file(tmp_path / "line", build_line("hexarotor"))
    files[0].write_text("\n".join(files[0].read_text().splitlines()[:50]))
    for arguments, message in (
        (["run"], "--plan FILE"),
        (["run", "--plan", str(tmp_path / "none")], "no plan file"),
        (["run", "--plan", str(files[0])], "truncated"),
        (["run", "--plan", str(files[0]), "--robot", "ars-lrm"], "truncated"),
        (["run", "waypoints", "--plan", str(files[0])], "truncated"),
        (["run", "follow-plan"], "plan_file is empty"),
    ):
        found = CliRunner().invoke(main, arguments)
        assert found.exit_code == 2, (arguments, found.output)
        assert message in found.output + str(found.stderr)
    assert not list(tmp_path.glob("*.partial"))


def test_a_plan_of_another_robot_or_for_another_mission_is_refused(tmp_path: Path) -> None:
    files = write_plan_file(tmp_path / "line", build_line("hexarotor"))
    for arguments, message in (
        (["--robot", "othex"], "the plan is for robot 'hexarotor', not 'othex'"),
        (["bar-transport"], "the plan is for robot 'hexarotor', not 'ars-lrm'"),
        (["waypoints"], "mission 'waypoints' cannot fly a plan file; valid: bar-transport"),
    ):
        found = CliRunner().invoke(main, ["run", *arguments, "--plan", str(files[0])])
        assert found.exit_code == 2, (arguments, found.output)
        assert message in found.output + str(found.stderr)
