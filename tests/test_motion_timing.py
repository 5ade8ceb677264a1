"""Times along a path: limits hold, known minimum times, swing; and the plan file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.description.world.spec import World
from skywright.errors import InfeasibleError, InputError
from skywright.models.planar import build_planar_lrm
from skywright.models.scene import build_scene
from skywright.models.things.box import Box
from skywright.planning.motion.kinematics import fill_motion
from skywright.planning.motion.plan_file import load_plan_file, write_plan_file
from skywright.planning.motion.space import build_scratch
from skywright.planning.motion.swing import add_bar, build_swing, equilibrium
from skywright.planning.motion.timing import (
    ROW,
    Timed,
    TimeLimits,
    assign_times,
    compute_acceleration_limits,
)
from skywright.planning.motion.transport import Transport, build_transport
from skywright.planning.motion.transport_plan import (
    SERVO_SHARE,
    TransportPlan,
    build_swing_model,
    build_time_limits,
    find_hand,
    plan_transport,
)

Array = NDArray[np.float64]

ROBOT = load_robot("ars-lrm")[0]
WORLD = load_world("pipe-structures")[0]
EMPTY = build_transport(ROBOT, World(name="empty", area=WORLD.area))
LIMITS = TimeLimits(speed=1.0, acceleration=0.8, mass=7.0, thrust=118.8)


@pytest.fixture(scope="module")
def plan() -> TransportPlan:
    return plan_transport(ROBOT, build_transport(ROBOT, WORLD), 2, 1.0)


def check_limits(timed: Timed, limits: TimeLimits) -> None:
    flat, vertical = compute_acceleration_limits(limits)
    assert np.hypot(timed.cd[:, 0], timed.cd[:, 1]).max() <= limits.speed * (1 + 1e-6)
    assert np.abs(timed.cd[:, 2:]).max() <= limits.joint_rate * (1 + 1e-6)
    assert np.abs(timed.cdd[:, 0]).max() <= flat * (1 + 1e-3)
    assert np.abs(timed.cdd[:, 1]).max() <= vertical * (1 + 1e-3)
    assert np.abs(timed.cdd[:, 2:]).max() <= limits.joint_acceleration * (1 + 1e-3)
    tilt = np.abs(np.arctan2(timed.cdd[:, 0], limits.gravity + timed.cdd[:, 1]))
    assert tilt.max() <= limits.tilt * (1 + 1e-3)
    thrust = limits.mass * np.hypot(timed.cdd[:, 0], limits.gravity + timed.cdd[:, 1])
    assert thrust.max() <= limits.thrust * (1 + 1e-3)


@pytest.mark.parametrize(
    ("limits", "flat", "vertical"),
    [
        # the acceleration itself: half of it upward, the rest of its circle to the side
        (TimeLimits(acceleration=0.8), 0.8 * math.sqrt(0.75), 0.4),
        # a platform that sinks has less to lean with: tan(tilt) (g - a_z)
        (TimeLimits(acceleration=6.0, tilt=math.radians(15.0)), math.tan(math.radians(15.0)) * 6.81,
         3.0),
        # rotors: sqrt((T / m)^2 - (g + a_z)^2), half of what the weight leaves upward
        (TimeLimits(acceleration=9.0, tilt=1.2, thrust=24.0, mass=2.0),
         math.sqrt(12.0**2 - (9.81 + 1.095) ** 2), 1.095),
    ],
)  # fmt: skip
def test_acceleration_is_limited_by_tilt_rotors_and_itself(
    limits: TimeLimits, flat: float, vertical: float
) -> None:
    assert compute_acceleration_limits(limits) == pytest.approx((flat, vertical))


@settings(max_examples=10, deadline=None)
@given(st.floats(0.2, 9.0))
def test_a_straight_line_takes_the_time_of_a_trapezoid(length: float) -> None:
    goal = EMPTY.start + np.array([length, 0, 0, 0])
    timed = assign_times(EMPTY.space, np.array([EMPTY.start, goal]), LIMITS)
    a, v = compute_acceleration_limits(LIMITS)[0], LIMITS.speed
    exact = length / v + v / a if length >= v * v / a else 2.0 * math.sqrt(length / a)
    assert timed.duration == pytest.approx(exact, rel=0.02)
    check_limits(timed, LIMITS)
    np.testing.assert_allclose(timed.c[[0, -1]], [EMPTY.start, goal], atol=1e-9)


def test_a_path_with_corners_keeps_limits_and_shape() -> None:
    rows = np.array([[0, 2, 0, -1.5], [2, 2.4, -0.5, -1.2], [4, 1.9, 0.2, -1.5], [6, 2, 0, -1.5]])
    timed = assign_times(EMPTY.space, rows, LIMITS)
    check_limits(timed, LIMITS)
    rates = np.gradient(timed.c, timed.t, axis=0)
    np.testing.assert_allclose(rates[2:-2], timed.cd[2:-2], atol=0.02)
    slow = assign_times(EMPTY.space, rows, LIMITS, duration=2 * timed.duration)
    assert slow.duration == pytest.approx(2 * timed.duration)
    np.testing.assert_allclose(np.abs(slow.cd).max(0), np.abs(timed.cd).max(0) / 2, rtol=0.02)
    with pytest.raises(InfeasibleError, match="requires"):
        assign_times(EMPTY.space, rows, LIMITS, duration=0.5 * timed.duration)
    with pytest.raises(InfeasibleError, match="weigh"):
        assign_times(EMPTY.space, rows, LIMITS._replace(thrust=50.0))


def test_a_path_without_length_rests_for_two_rows() -> None:
    still = assign_times(EMPTY.space, np.array([EMPTY.start, EMPTY.start]), LIMITS)
    assert still.t.tolist() == [0.0, ROW] and not still.cd.any() and not still.cdd.any()
    np.testing.assert_array_equal(still.c, [EMPTY.start, EMPTY.start])
    rows = np.array([EMPTY.start, EMPTY.start])
    assert assign_times(EMPTY.space, rows, LIMITS, duration=3.0).t.tolist() == [0.0, 3.0]


def test_averaging_over_the_period_keeps_the_speeds() -> None:
    """A slow arm motion, then a fast flight: the average is fast where the arm still moves."""
    limits = LIMITS._replace(
        speed=2.0, acceleration=4.0, joint_rate=0.1, joint_acceleration=30.0, smooth=2.0
    )
    rows = np.array(
        [[0, 3, 0, -1.57], [0.14, 3, -0.58, -1.57], [2.19, 3, -0.58, -1.47], [2.21, 3, 0, -1.57]]
    )
    timed = assign_times(EMPTY.space, rows, limits)
    assert np.abs(timed.cd[:, 2:]).max() <= limits.joint_rate * (1 + 2e-3)
    assert np.hypot(timed.cd[:, 0], timed.cd[:, 1]).max() <= limits.speed * (1 + 2e-3)


def test_a_plan_is_no_faster_than_the_servos() -> None:
    problem = build_transport(ROBOT, EMPTY.world)
    assert build_time_limits(ROBOT, problem).joint_rate == TimeLimits().joint_rate
    sets = {"robot.arm.elbow_pitch_servo.no_load_speed_rad_s": 0.3}
    slow = load_description("waypoints", "ars-lrm", sets=sets).robot
    assert build_time_limits(slow, problem).joint_rate == pytest.approx(0.3 * SERVO_SHARE)


def test_a_movable_crate_is_no_part_of_the_robot() -> None:
    """Neither its mass nor its body counts; a bar in the hands does."""
    crate = Box(
        x_m=30.0, y_m=0.0, z_m=0.25, size_x_m=0.5, size_y_m=0.5, size_z_m=0.5, moves=True,
        mass_kg=8.0,
    )  # fmt: skip
    problem = build_transport(ROBOT, World(name="crate", area=WORLD.area, things={"crate": crate}))
    assert problem.scene.bodies == EMPTY.scene.bodies
    assert "crate" in " ".join(problem.scene.world_names)
    alone = build_time_limits(ROBOT, EMPTY).mass
    assert build_time_limits(ROBOT, problem).mass == alone
    empty = build_transport(ROBOT, World(name="empty"), Transport(bar_length=0.0))
    bare = build_time_limits(ROBOT, empty).mass
    assert alone == pytest.approx(bare + Transport().bar_mass)


def test_swing_of_a_steady_acceleration_is_the_pendulum_s() -> None:
    """Suddenly accelerated, an undamped pendulum swings to twice the angle of the plumb line."""
    bare = build_planar_lrm(build_scene(ROBOT, WORLD), ROBOT)
    model = add_bar(bare, 0.3, find_hand(EMPTY.scene))
    swing = build_swing(model, 9.81, 0.0)
    t = np.linspace(0, 3, 151)
    a = 0.3
    c = np.tile(EMPTY.start, (len(t), 1))
    cd, cdd = np.zeros_like(c), np.zeros_like(c)
    c[:, 0], cd[:, 0], cdd[:, 0] = 0.5 * a * t**2, a * t, a
    flying = swing(t[:100], c[:100], cd[:100], cdd[:100])
    assert flying >= 2 * math.atan(a / 9.81) * 0.97
    still = np.zeros_like(c)
    assert swing(t, np.tile(EMPTY.start, (len(t), 1)), still, still) < 1e-3


@pytest.mark.parametrize("forearm", [None, 0.45])
def test_both_models_hang_alike(forearm: float | None) -> None:
    """The planner's kinematics and the planar model agree on the equilibrium, bar included."""
    sets = {} if forearm is None else {"robot.arm.elbow_pitch.length_m": forearm}
    robot = load_description("waypoints", "ars-lrm", sets=sets).robot
    problem = build_transport(robot, EMPTY.world)
    model = build_swing_model(robot, problem)
    c = np.array([EMPTY.start, [0.0, 2.0, -0.5, -1.0], [0.0, 2.0, 0.4, -2.0]])
    u = np.zeros((len(c), 4 + len(problem.scene.joints)))
    scratch = build_scratch(problem.space)
    fill_motion(problem.space, scratch, c, np.zeros_like(c), u, np.zeros_like(u))
    for row, (_, _, shoulder, elbow) in zip(u, c, strict=True):
        assert row[4] == pytest.approx(equilibrium(model, shoulder, elbow), abs=1e-9)


def test_the_plan_of_the_paper_s_scenario_keeps_everything(plan: TransportPlan) -> None:
    # rounded corners, too: certified on chords, from which a curve differs by micrometres
    assert plan.clearance_m >= 0.2 - 1e-5
    assert math.degrees(plan.timed.swing) <= 8.0
    assert plan.lower_bound <= plan.path.cost
    assert plan.file.metrics["plan.cost"] == plan.path.cost


def test_plan_file_comes_back(plan: TransportPlan, tmp_path: Path) -> None:
    files = write_plan_file(tmp_path / "carry", plan.file)
    assert [f.name for f in files] == ["carry.csv", "carry.toml"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["carry.csv", "carry.toml"]
    again = load_plan_file(tmp_path / "carry.csv", "ars-lrm", plan.file.joints)
    for name in ("t", "pose", "rate", "acceleration", "q", "qd"):
        np.testing.assert_allclose(getattr(again, name), getattr(plan.file, name), atol=1e-8)
    assert again.metrics == plan.file.metrics


def test_bad_plan_files_are_refused(plan: TransportPlan, tmp_path: Path) -> None:
    write_plan_file(tmp_path / "p", plan.file)
    table, head = (tmp_path / "p.csv").read_text(), (tmp_path / "p.toml").read_text()

    def refusal(table: str, head: str, robot: str | None = None) -> str:
        (tmp_path / "p.csv").write_text(table)
        (tmp_path / "p.toml").write_text(head)
        with pytest.raises(InputError) as error:
            load_plan_file(tmp_path / "p", robot)
        assert "\n" not in str(error.value)
        return str(error.value)

    assert "'ars-lrm', not 'othex'" in refusal(table, head, "othex")
    lines = table.splitlines()
    number = lines[5].split(",")
    number[2] = "nan"
    assert "line 6, y_m" in refusal("\n".join([*lines[:5], ",".join(number), *lines[6:]]), head)
    assert "times must increase" in refusal("\n".join([*lines[:9], lines[8], *lines[10:]]), head)
    assert "rows" in refusal("\n".join(lines[:-3]), head)
    assert "lacks the column" in refusal(table.replace("vx_mps", "speed", 1), head)
    assert "values, the header" in refusal("\n".join([*lines[:7], "1,2", *lines[8:]]), head)
    jump = lines[20].split(",")
    jump[1] = str(float(jump[1]) + 0.3)
    assert "but its rates give" in refusal(
        "\n".join([*lines[:20], ",".join(jump), *lines[21:]]), head
    )
    assert "format" in refusal(table, head.replace("format = 1", "format = 9"))
    assert "plan lacks robot" in refusal(table, head.replace("robot =", "machine ="))
    assert "malformed TOML" in refusal(table, "[plan")
    (tmp_path / "p.toml").unlink()
    with pytest.raises(InputError, match="belong together"):
        load_plan_file(tmp_path / "p")


def test_a_lighter_load_swings_less_far_from_the_link() -> None:
    """The equilibrium with the forearms forward leans back, more so with the bar."""
    model = build_planar_lrm(build_scene(ROBOT, WORLD), ROBOT)
    empty, loaded = (equilibrium(add_bar(model, m, 0.25), 0.0, -math.pi / 2) for m in (0.0, 0.3))
    assert 0 < empty < loaded < math.radians(10)
    assert Transport().bar_mass == 0.3
