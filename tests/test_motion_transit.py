"""Transits in three dimensions: any robot, any scene, platform and arms together."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.core.rotations import rot_z
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.world.spec import Area, World
from skywright.errors import InfeasibleError, InputError
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.kinematic_tree import build_planning_scene
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.models.things.box import Box
from skywright.planning.motion.space import Coordinate, build_space
from skywright.planning.motion.transit import Configuration, Transit, plan_transit
from skywright.planning.shapes import Sphere, plan_between

SCAN = load_description("pipe-weld-scan")
BUILT = build_scene(SCAN.robot, SCAN.world)
SCENE, QUERY = build_planning_scene(BUILT, SCAN.robot), build_clearance(BUILT)
FOLDED, WORKING = posture(SCAN.robot, "folded"), posture(SCAN.robot, "working")


def stream(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def measure(way: Transit, step: float = 0.02) -> float:
    """Smallest distance on the way by MuJoCo's own geometry, which planning does not use."""
    least = math.inf
    for i in range(len(way.p_WB) - 1):
        length = float(np.linalg.norm(way.p_WB[i + 1] - way.p_WB[i])) + 0.1
        for u in np.linspace(0.0, 1.0, math.ceil(length / step) + 1):
            p, yaw, q = ((1 - u) * x[i] + u * x[i + 1] for x in (way.p_WB, way.yaw, way.q))
            least = min(least, compute_clearance(QUERY, p, rot_z(float(yaw)), q).distance)
    return least


def test_straight_where_nothing_is_in_the_way() -> None:
    """Platform and arms arrive together; the cost is (6) of the line."""
    a = Configuration(np.array([0.0, 0.0, 1.2]), 0.0, FOLDED)
    b = Configuration(np.array([0.6, 0.0, 1.4]), 0.0, WORKING)
    way = plan_transit(SCENE, a, b, stream())
    assert way.blocked_by is None and len(way.p_WB) == 2
    turned = float(np.sum(np.abs(WORKING - FOLDED)))
    assert way.cost == pytest.approx(math.hypot(0.6, 0.2) + 0.1 * turned)
    np.testing.assert_allclose(way.q, [FOLDED, WORKING], atol=1e-9)


@settings(max_examples=6, deadline=None)
@given(st.floats(-0.5, 0.5), st.floats(1.2, 1.8), st.floats(-math.pi, math.pi), st.integers(0, 99))
def test_around_the_pipe_every_margin_holds(y: float, z: float, yaw: float, seed: int) -> None:
    """From before the pipe to behind it, arms unfolding: measured by another geometry."""
    a = Configuration(np.array([0.0, 0.0, 1.2]), 0.0, FOLDED)
    b = Configuration(np.array([3.9, y, z]), yaw, WORKING)
    way = plan_transit(SCENE, a, b, stream(seed), 0.1, wanted=0.2)
    assert way.blocked_by is None and len(way.p_WB) > 2
    assert way.clearance >= 0.1 - 1e-9
    # the planner's shapes enclose the scene's; MuJoCo's distances are good to some 10 um
    assert measure(way) >= way.clearance - 1e-4
    assert np.linalg.norm(way.p_WB[-1] - b.p_WB) < 1e-9
    assert math.remainder(way.yaw[-1] - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_corners_are_not_cut_below_the_room_that_there_is(seed: int) -> None:
    """0.3 m are wanted and there: a corner is dropped only where 80 % of them remain."""
    a = Configuration(np.array([0.0, 0.0, 1.2]), 0.0, FOLDED)
    b = Configuration(np.array([4.2, 0.2, 1.3]), 0.0, FOLDED)
    way = plan_transit(SCENE, a, b, stream(seed), 0.05, wanted=0.3)
    assert way.blocked_by is None and way.clearance >= 0.24 - 1e-9


def test_blocked_ends_are_named() -> None:
    free = Configuration(np.array([0.0, 0.0, 1.2]), 0.0, FOLDED)
    inside = Configuration(np.array([2.0, 0.0, 1.5]), 0.0, FOLDED)
    low = Configuration(np.array([0.0, 0.0, 0.05]), 0.0, FOLDED)
    into = plan_transit(SCENE, free, inside, stream())
    assert into.blocked_by is not None and into.blocked_by.startswith("goal: ")
    assert "pipe" in into.blocked_by and not len(into.p_WB)
    out_of = plan_transit(SCENE, inside, free, stream())
    assert out_of.blocked_by is not None and out_of.blocked_by.startswith("start: ")
    ground = plan_transit(SCENE, free, low, stream())
    assert ground.blocked_by is not None and "the ground" in ground.blocked_by


def test_long_reach_dual_arm_unfolds_on_its_way() -> None:
    """Nine joints, one of them passive, to below the pipe where a sensor is installed."""
    d = load_description("sensor-install")
    scene = build_planning_scene(build_scene(d.robot, d.world), d.robot)
    folded, working = posture(d.robot, "folded"), posture(d.robot, "working")
    a = Configuration(np.array([0.0, 0.0, 2.2]), 0.0, folded)
    b = Configuration(np.array([5.5, 0.0, 2.6]), 1.0, working)
    way = plan_transit(scene, a, b, stream(), 0.1, passive="pendulum")
    assert way.blocked_by is None and way.clearance >= 0.1 - 1e-9
    np.testing.assert_allclose(way.q[-1][1:], working[1:], atol=1e-9)
    same = plan_transit(scene, a, b, stream(), 0.1, passive="pendulum")
    assert np.array_equal(way.p_WB, same.p_WB)


def test_crossing_limits_and_unknown_coordinates_are_refused() -> None:
    crossed = [Coordinate("x", ("x",), 2.0, 1.0)]
    with pytest.raises(InputError, match="coordinate x: lower limit 2 is not below upper limit 1"):
        build_space(SCENE, crossed, {}, margin=0.1)
    with pytest.raises(InputError, match="unknown coordinate or joint 'elbow'; valid: x, y, z"):
        build_space(SCENE, [Coordinate("a", ("elbow",), 0.0, 1.0)], {}, margin=0.1)


def test_a_path_stays_in_the_area_of_the_world() -> None:
    """A sphere is in the way; the shortest path goes over it, and out of this area."""
    robot = load_robot("hexarotor")[0]
    world = World(name="low", area=Area(y_min_m=-0.7, z_max_m=3.2))
    sphere = [Sphere((2.0, 0.3, 2.6), 0.5)]
    way = plan_between(robot, world, (0, 0, 3, 0), (4, 0, 3, 0), sphere, 0.1, 1)
    assert way.p_WB[:, 2].max() < 3.1 and way.p_WB[:, 1].min() > -0.05
    with pytest.raises(InfeasibleError, match=r"goal: .* and the area's limit in z .* 0.1 m"):
        plan_between(robot, world, (0, 0, 3, 0), (4, 0, 3.2, 0), sphere, 0.1, 1)


def test_where_there_is_no_way_the_search_ends_and_names_what_is_in_it() -> None:
    """A goal in a shaft of four walls that nothing as wide as the robot can enter."""
    walls = {
        name: Box(x_m=3.9 + x, y_m=y, z_m=2.0, size_x_m=sx, size_y_m=sy, size_z_m=4.0)
        for name, x, y, sx, sy in (
            ("wall 1", -1.5, 0.0, 0.1, 3.1), ("wall 2", 1.5, 0.0, 0.1, 3.1),
            ("wall 3", 0.0, -1.5, 3.1, 0.1), ("wall 4", 0.0, 1.5, 3.1, 0.1),
        )
    }  # fmt: skip
    walls["lid"] = Box(x_m=3.9, y_m=0.0, z_m=4.0, size_x_m=3.1, size_y_m=3.1, size_z_m=0.1)
    world = SCAN.world.model_copy(update={"things": walls})
    scene = build_planning_scene(build_scene(SCAN.robot, world), SCAN.robot)
    a = Configuration(np.array([0.0, 0.0, 1.2]), 0.0, FOLDED)
    b = Configuration(np.array([3.9, 0.0, 1.4]), 0.0, FOLDED)
    way = plan_transit(scene, a, b, stream(), slices=4)
    assert way.blocked_by is not None and not len(way.p_WB) and math.isnan(way.clearance)
    assert way.blocked_by.startswith("no path found") and "closer than" in way.blocked_by
