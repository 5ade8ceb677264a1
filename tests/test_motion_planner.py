"""The planners: equations (4) to (6), known optima, the lower bound, repeatability, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.description.world.spec import World
from skywright.errors import InfeasibleError, InputError
from skywright.models.kinematic_tree import build_planning_scene
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.models.things.box import Box
from skywright.planning.motion.angular import (
    blocked_by_circle,
    blocked_by_rectangle,
    build_angular_map,
)
from skywright.planning.motion.bound import choose_slices, compute_lower_bound
from skywright.planning.motion.cost import displacement_cost, rho_arms, rho_uav, time_cost
from skywright.planning.motion.decoupled import plan_decoupled
from skywright.planning.motion.planner import plan_path, sample_reserve
from skywright.planning.motion.rrt_star import RrtStar, plan_rrt_star
from skywright.planning.motion.space import build_scratch
from skywright.planning.motion.transit import Configuration, _build_blend
from skywright.planning.motion.transport import Transport, build_scenario, build_transport
from skywright.planning.motion.transport_plan import plan_transport

Array = NDArray[np.float64]

ROBOT = load_robot("ars-lrm")[0]
WORLD = load_world("pipe-structures")[0]
PAPER = build_transport(ROBOT, WORLD)
EMPTY = build_transport(ROBOT, World(name="empty", area=WORLD.area))
configuration = st.tuples(*[st.floats(-3, 3)] * 4).map(np.array)


def stream(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@settings(max_examples=50, deadline=None)
@given(configuration, configuration, configuration)
def test_metrics_and_costs_are_those_of_the_paper(a: Array, b: Array, c: Array) -> None:
    """(4) to (6) written out over both arms' joints; both costs obey the triangle inequality."""
    space, d = PAPER.space[0], b - a
    move, arms = math.hypot(d[0], d[1]), np.array([d[2], d[3], d[2], d[3]])
    assert rho_uav(space, a, b) == pytest.approx(move)
    assert rho_arms(space, a, b) == pytest.approx(np.max(np.abs(arms)))
    assert time_cost(space, a, b, 0.5, 0.4) == pytest.approx(
        max(move / 0.5, np.max(np.abs(arms)) / 0.4)
    )
    assert displacement_cost(space, a, b) == pytest.approx(move + 0.1 * np.sum(np.abs(arms)))
    for cost in (displacement_cost, lambda s, p, q: time_cost(s, p, q, 0.5, 0.4)):
        assert cost(space, a, c) <= cost(space, a, b) + cost(space, b, c) + 1e-9


@settings(max_examples=300, deadline=None)
@given(
    st.floats(-1, 1), st.floats(-1, 1), st.floats(0.05, 1.5), st.floats(-3.1, 3.1),
    st.floats(0.05, 0.5), st.floats(0.05, 0.5),
)  # fmt: skip
def test_angular_check_is_the_distance_to_the_obstacle(
    cx: float, cz: float, length: float, angle: float, hx: float, hz: float
) -> None:
    """Figure 5's angular condition holds exactly where segment and obstacle meet."""
    t = np.linspace(0, length, 4001)
    points = np.column_stack([t * math.cos(angle), t * math.sin(angle)])
    away = np.hypot(points[:, 0] - cx, points[:, 1] - cz).min() - hx
    if abs(away) > 1e-3:
        assert blocked_by_circle(0.0, 0.0, length, angle, cx, cz, hx) == (away < 0)
    box = np.maximum(np.abs(points - [cx, cz]) - [hx, hz], -1).max(axis=1).min()
    if abs(box) > 1e-3:
        assert blocked_by_rectangle(0.0, 0.0, length, angle, cx, cz, hx, hz) == (box < 0)


def test_in_an_empty_area_the_straight_line_is_found() -> None:
    path = plan_path(EMPTY.space, EMPTY.start, EMPTY.goal, stream(), slices=1)
    assert len(path.rows) == 2 and path.cost == pytest.approx(9.0)
    bound = compute_lower_bound(EMPTY.space, EMPTY.start, EMPTY.goal, [3.0, 6.0], 0.1, 0.3)
    assert bound == pytest.approx(9.0, abs=0.05) and bound <= 9.0


def test_around_one_pipe_the_optimum_is_found() -> None:
    """Without arms' motion the optimum is a tangent, an arc, a tangent; arms make it cheaper."""
    tubes = {"rack": WORLD.tubes["rack front"]}
    world = World(name="one", tubes=tubes, area=WORLD.area.model_copy(update={"z_max_m": 8.0}))
    problem = build_transport(ROBOT, world)
    path = plan_path(problem.space, problem.start, problem.goal, stream(), slices=2500)
    bound = compute_lower_bound(
        problem.space, problem.start, problem.goal, choose_slices(path.rows), 0.03
    )
    assert bound <= path.cost <= 1.025 * bound


def test_the_paper_s_scenario() -> None:
    """Every margin holds at 1 mm; the bound is below; joint planning passes, decoupled does not."""
    path = plan_path(PAPER.space, PAPER.start, PAPER.goal, stream(3), slices=3000)
    scratch = build_scratch(PAPER.space)
    reserve, _ = sample_reserve(PAPER.space, scratch, path.rows, 1e-3)
    assert reserve >= 0.0
    bound = compute_lower_bound(
        PAPER.space, PAPER.start, PAPER.goal, choose_slices(path.rows), 0.04
    )
    assert 9.0 < bound <= path.cost < 1.05 * bound
    assert np.all(np.diff(path.history[:, 1]) < 0)  # any-time: only ever cheaper
    apart = plan_decoupled(PAPER.space, PAPER.start, PAPER.goal, stream(3), 0.5)
    assert not len(apart.rows) and "arms in their initial posture" in apart.reason
    # the bar passes the second structure through its lower gap: below the shelf at 1.6 m
    near = [row for row in path.rows if abs(row[0] - 6.3) < 1.5]
    assert all(row[1] - 0.91 < 1.6 for row in near)


def test_same_seed_same_path() -> None:
    one, two, other = (
        plan_path(PAPER.space, PAPER.start, PAPER.goal, stream(s), slices=60) for s in (1, 1, 2)
    )
    assert np.array_equal(one.rows, two.rows) and not np.array_equal(one.rows, other.rows)


def test_rrt_star_gets_cheaper_and_keeps_its_books() -> None:
    """The reported cost is that of the path; more iterations never cost more; edges are free."""
    world = build_angular_map(PAPER.space)
    costs = []
    for iterations in (1500, 4000):
        result = plan_rrt_star(
            PAPER.space, world, PAPER.start, PAPER.goal, stream(1), 60.0,
            RrtStar(certified=True), iterations=iterations,
        )  # fmt: skip
        space = PAPER.space[0]
        total = sum(
            displacement_cost(space, a, b)
            for a, b in zip(result.rows[:-1], result.rows[1:], strict=True)
        )
        assert result.cost == pytest.approx(total, abs=1e-6)
        assert sample_reserve(PAPER.space, build_scratch(PAPER.space), result.rows, 5e-3)[0] >= 0.0
        costs.append(result.cost)
    assert costs[1] <= costs[0]
    in_time = plan_rrt_star(
        PAPER.space, world, PAPER.start, PAPER.goal, stream(1), 60.0,
        RrtStar(minimise_time=True), iterations=1500,
    )  # fmt: skip
    seconds = sum(
        time_cost(PAPER.space[0], a, b, 0.5, 0.5)
        for a, b in zip(in_time.rows[:-1], in_time.rows[1:], strict=True)
    )
    assert in_time.cost == pytest.approx(seconds, abs=1e-6)


def test_narrow_passages_are_found_within_a_second() -> None:
    for seed in (7, 10):
        problem = build_transport(ROBOT, build_scenario(WORLD, seed, 0.75))
        found = [
            plan_path(problem.space, problem.start, problem.goal, stream(s), slices=400, first=True)
            for s in range(5)
        ]
        assert all(len(p.rows) for p in found)


def build_wall(axis: int, at: float, hole: tuple[float, float], size: float) -> dict[str, Box]:
    """A wall of 12 m across an axis, with a square hole of a size about a point of the others."""
    others = [i for i in range(3) if i != axis]
    boxes = {}
    for name, u, v, du, dv in (
        ("first", hole[0] - size / 2 - 3.0, hole[1], 6.0, 12.0),
        ("second", hole[0] + size / 2 + 3.0, hole[1], 6.0, 12.0),
        ("third", hole[0], hole[1] - size / 2 - 3.0, size, 6.0),
        ("fourth", hole[0], hole[1] + size / 2 + 3.0, size, 6.0),
    ):
        middle, sides = np.full(3, at), np.full(3, 0.1)
        middle[others], sides[others] = (u, v), (du, dv)
        boxes[name] = Box(
            x_m=middle[0], y_m=middle[1], z_m=middle[2],
            size_x_m=sides[0], size_y_m=sides[1], size_z_m=sides[2],
        )  # fmt: skip
    return boxes


@pytest.mark.parametrize("axis", range(3))
def test_narrow_places_are_found_along_every_axis(axis: int) -> None:
    """In three dimensions, by the first or the second slice of work of each of ten seeds.

    A slice is about half a millisecond.
    """
    robot = load_robot("othex")[0]
    folded = posture(robot, "folded")
    ends = np.full((2, 3), 8.0)  # above the ground by more than the wall reaches down
    ends[:, axis] += (-3.0, 3.0)
    size = 1.05 * (1.19 + 0.2)  # of its width, from disc to disc, and two margins
    boxes = build_wall(axis, 8.0, (9.2, 9.2), size)
    scene = build_planning_scene(build_scene(robot, World(name="wall", things=boxes)), robot)
    start, goal = (Configuration(p, 0.0, folded) for p in ends)
    space, (a, b) = _build_blend(scene, start, goal, [], 0.1, 0.02, None, 0.0)
    for seed in range(10):
        path = plan_path(space, a, b, stream(seed), slices=2)
        assert len(path.rows) > 2
        assert sample_reserve(space, build_scratch(space), path.rows, 5e-3)[0] >= 0.0


@pytest.mark.parametrize("x", [0.0, 6.0])
def test_the_bar_is_carried_up_through_a_shaft(x: float) -> None:
    """A floor of 1.5 m with a shaft 1.05 times as wide as the platform with its margins."""
    half, low, high = 0.5 * 1.05 * 1.6, -2.0, 11.0
    boxes = {
        side: Box(
            x_m=(a + b) / 2, y_m=0.0, z_m=4.5, size_x_m=b - a, size_y_m=8.0, size_z_m=1.5
        )
        for side, a, b in (("left", low, 3.0 - half), ("right", 3.0 + half, high))
    }  # fmt: skip
    area = WORLD.area.model_copy(update={"z_max_m": 9.0})
    ends = [(0.0, 2.0, 0.0, -math.pi / 2), (x, 7.4, 0.0, -math.pi / 2)]
    problem = build_transport(ROBOT, World(name="shaft", things=boxes, area=area), Transport(*ends))
    for seed in range(10):
        path = plan_path(problem.space, problem.start, problem.goal, stream(seed), slices=2)
        assert len(path.rows) > 2
        reserve, _ = sample_reserve(problem.space, build_scratch(problem.space), path.rows, 5e-3)
        assert reserve >= 0.0


def test_a_way_around_a_corner_is_narrow_along_two_axes() -> None:
    """Through a window, arms lifted, then up a shaft; each 1.25 times what the robot needs."""
    shaft, top = 0.5 * 1.25 * 1.6, 1.0 + 1.25 * 1.4
    boxes = {
        name: Box(
            x_m=(x0 + x1) / 2, y_m=0.0, z_m=(z0 + z1) / 2,
            size_x_m=x1 - x0, size_y_m=8.0, size_z_m=z1 - z0,
        )
        for name, x0, x1, z0, z1 in (
            ("sill", 2.95, 3.05, 0.0, 1.0), ("wall", 2.95, 3.05, top, 9.0),
            ("floor", 3.0, 7.0 - shaft, 4.55, 4.65), ("end", 7.0 + shaft, 11.0, 4.55, 4.65),
        )
    }  # fmt: skip
    world = World(name="corner", things=boxes, area=WORLD.area.model_copy(update={"z_max_m": 9.5}))
    ends = [(0.0, 2.0, 0.0, -math.pi / 2), (8.5, 7.6, 0.0, -math.pi / 2)]
    problem = build_transport(ROBOT, world, Transport(*ends))
    for seed in range(5):
        path = plan_path(
            problem.space, problem.start, problem.goal, stream(seed), first=True, slices=1000
        )
        assert len(path.rows) > 2


def test_a_bar_longer_than_the_gap_is_refused_with_the_passage_s_name() -> None:
    """The search ends with its time."""
    problem = build_transport(ROBOT, WORLD, Transport(bar_length=2.4))
    with pytest.raises(InfeasibleError, match=r"no path within 0\.3\d* s; ") as error:
        plan_transport(ROBOT, problem, time_s=0.3)
    assert "'lower gap'" in str(error.value) and "2.80 m" in str(error.value)
    assert "0.2 m on each side (mission.task.margin_m): it does not fit" in str(error.value)


def test_the_bound_is_infinite_where_a_slice_is_closed() -> None:
    """Under a lower ceiling no posture fits over the rack."""
    low = WORLD.area.model_copy(update={"z_max_m": 2.5})
    problem = build_transport(ROBOT, WORLD.model_copy(update={"area": low}))
    bound = compute_lower_bound(problem.space, problem.start, problem.goal, [2.7])
    assert bound == np.inf


def test_blocked_ends_and_wrong_robots_are_told() -> None:
    start = (2.7, 2.0, 0.0, -math.pi / 2)
    with pytest.raises(InputError, match=r"start: .* and rack"):
        plan_transport(ROBOT, build_transport(ROBOT, WORLD, Transport(start=start)))
    goal = (9.0, 0.9, 0.0, -math.pi / 2)
    with pytest.raises(InputError, match=r"goal: .* the ground"):
        plan_transport(ROBOT, build_transport(ROBOT, WORLD, Transport(goal=goal)))
    with pytest.raises(InputError, match="cannot carry a bar"):
        build_transport(load_robot("hexarotor")[0], WORLD)


def test_ends_beyond_the_range_of_a_joint_are_refused() -> None:
    for end, joints in (("start", (2.8, -1.5)), ("goal", (0.0, -2.7))):
        transport = Transport(**{end: (4.0, 2.0, *joints)})
        joint, at = ("shoulder", 160.428) if end == "start" else ("elbow", -154.699)
        with pytest.raises(InputError, match=f"{end}: joint left_{joint}_pitch at {at} deg; valid"):
            build_transport(ROBOT, EMPTY.world, transport)


@pytest.mark.parametrize("at", [(45.0, 2.0), (80.0, 2.0), (-70.0, 120.0)])
def test_a_world_without_an_area_has_no_limits(at: tuple[float, float]) -> None:
    ends = [(at[0] + x, at[1], 0.0, -math.pi / 2) for x in (0.0, 10.0)]
    problem = build_transport(ROBOT, World(name="open"), Transport(*ends))
    path = plan_path(problem.space, problem.start, problem.goal, stream(), slices=1)
    np.testing.assert_allclose(path.rows, ends)
