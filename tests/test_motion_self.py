"""Parts of the robot on planned paths: two arms, ends that touch; and paths of many rows."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import skywright
from skywright.core.user_code import njit
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.models.kinematic_tree import build_planning_scene, build_shapes
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.models.self_contact import find_self_contact
from skywright.planning.motion.connect import TREE_SIZE, connect
from skywright.planning.motion.improve import MAX_ROWS
from skywright.planning.motion.pairs import PAIR_SELF
from skywright.planning.motion.rng import build_state
from skywright.planning.motion.space import build_scratch
from skywright.planning.motion.transit import Configuration, Transit, _build_blend, plan_transit
from skywright.planning.motion.transport import build_transport
from skywright.planning.shapes import Sphere, _build_row

ROBOT = load_robot("bimanual")[0]
OPEN = load_world("open")[0]
BUILT = build_scene(ROBOT, OPEN)
SCENE = build_planning_scene(BUILT, ROBOT)
HERE = np.array([0.0, 0.0, 3.0])


def find_arms_apart(q: np.ndarray) -> float:
    """Smallest distance (m) of left and right arm by MuJoCo, which the planner does not use."""
    model, data = BUILT.model, mujoco.MjData(BUILT.model)
    data.qpos[BUILT.places.joint_qpos] = q
    mujoco.mj_kinematics(model, data)
    names = {int(g): model.geom(int(g)).name for g in BUILT.places.robot_geoms}
    left = [g for g, n in names.items() if n.startswith("left") or n.startswith("hand0")]
    right = [g for g, n in names.items() if n.startswith("right") or n.startswith("hand1")]
    return min(mujoco.mj_geomDistance(model, data, a, b, 1.0, None) for a in left for b in right)


def measure_arms(way: Transit) -> float:
    return min(
        find_arms_apart((1 - u) * a + u * b)
        for a, b in zip(way.q, way.q[1:], strict=False)
        for u in np.linspace(0.0, 1.0, 60)
    )


CROSSING = (
    ((-0.45, 0.19, -0.3, 2.23, -1.57, -0.52, -1.53, 2.18),
     (-1.57, -0.17, 1.57, 1.56, -1.05, 0.17, -0.79, 1.75)),
    ((1.57, 0.22, -1.57, -1.94, 0.59, 0.17, 1.24, -1.18),
     (0.02, 0.11, -0.16, -2.04, 0.97, -0.21, 0.89, -2.36)),
)  # fmt: skip
"""Postures with the arms apart; halfway between two of them one arm is inside the other."""


@pytest.mark.parametrize("postures", CROSSING)
def test_one_arm_does_not_pass_through_the_other(postures: tuple[tuple[float, ...], ...]) -> None:
    a, b = (np.array(q) for q in postures)
    assert min(find_arms_apart(a), find_arms_apart(b)) > 0.03
    assert min(find_arms_apart(a + u * (b - a)) for u in np.linspace(0, 1, 20)) < -0.005
    way = plan_transit(
        SCENE, Configuration(HERE, 0.0, a), Configuration(HERE + [1.0, 0.0, 0.0], 0.0, b),
        np.random.default_rng(1), 0.1,
    )  # fmt: skip
    assert way.blocked_by is None
    assert measure_arms(way) >= 0.02 - 1e-4
    assert not find_self_contact(SCENE.contacts, way.q)


def test_ends_at_which_parts_touch_are_refused() -> None:
    """An elbow in a propeller, and one hand inside the other arm."""
    rng = np.random.default_rng(0)
    good = posture(ROBOT, "folded")
    for _ in range(2000):
        q = rng.uniform(np.maximum(SCENE.q_min, -2.0), np.minimum(SCENE.q_max, 2.0))
        touch = find_self_contact(SCENE.contacts, q[None])
        if touch:
            break
    ends = Configuration(HERE, 0.0, good), Configuration(HERE, 0.0, q)
    for name, (a, b) in (("goal", ends), ("start", ends[::-1])):
        way = plan_transit(SCENE, a, b, np.random.default_rng(1), 0.1)
        assert way.blocked_by == f"{name}: {touch} of the robot touch"
        assert not len(way.p_WB) and way.q.shape == (0, len(good))


@pytest.mark.parametrize("name", ["folded", "working", "landed"])
def test_regular_postures_touch_nothing(name: str) -> None:
    for robot in ("bimanual", "ars-lrm", "othex", "tilthex-arm", "f550-scan"):
        r = load_robot(robot)[0]
        scene = build_planning_scene(build_scene(r, OPEN), r)
        assert not find_self_contact(scene.contacts, posture(r, name)[None])


def test_parts_that_are_close_at_an_end_come_no_closer() -> None:
    """The margin of a close pair is its own distance, not none at all."""
    folded, working = posture(ROBOT, "folded"), posture(ROBOT, "working")
    ends = Configuration(HERE, 0.0, folded), Configuration(HERE, 0.0, working)
    space, _ = _build_blend(SCENE, *ends, list(range(len(folded))), 0.1, 0.5, None, 0.0)
    count = int(space[0]["n_pairs"])
    own = space[0]["pairs"][:count, 2] == PAIR_SELF
    margins = space[0]["margin"][:count][own]
    assert np.any(margins < 0.5) and np.all(margins > -0.1)


def test_a_bar_in_both_hands_is_no_obstacle_for_the_second_arm() -> None:
    robot = load_robot("ars-lrm")[0]
    problem = build_transport(robot, OPEN)
    names = [*problem.scene.names, "bar"]
    pairs = problem.space[0]["pairs"][: int(problem.space[0]["n_pairs"])]
    met = [{names[a], names[b]} for a, b, kind in pairs if kind == PAIR_SELF]
    assert not any("bar" in pair and any("right" in n for n in pair) for pair in met)
    # the arms move in two parallel planes
    assert not any({"left", "right"} == {n.split("_")[0] for n in pair} for pair in met)


@njit
def _search(space, start, goal, state, trees, parents, counts, path, scratch, hits):  # type: ignore[no-untyped-def]
    return connect(
        space[0], start, goal, state, 0, trees, parents, counts, 100, path, scratch[0], hits
    )


def test_a_path_of_too_many_rows_is_discarded() -> None:
    """The rows behind the buffer stay as they are: 40 searches with room for 20 rows."""
    robot = load_robot("hexarotor")[0]
    scene = build_planning_scene(build_scene(robot, OPEN), robot)
    row = _build_row(0, Sphere((94.0, 0.0, 5.0), 2.0))
    scene = scene._replace(world=build_shapes([row]), world_names=("sphere",))
    q = np.zeros(0)
    space, ends = _build_blend(
        scene, Configuration(np.array([0.0, 0.0, 5.0]), 0.0, q),
        Configuration(np.array([100.0, 0.0, 5.0]), 0.0, q), [], 0.2, 0.02, None, 0.0,
    )  # fmt: skip
    n, canary, lengths = int(space["n"][0]), 7.75, set()
    for seed in range(40):
        memory = np.full((2000, n), canary)
        lengths.add(
            _search(
                space,
                ends[0],
                ends[1],
                build_state(np.random.default_rng(seed)),
                np.empty((2, TREE_SIZE, n)),
                np.empty((2, TREE_SIZE), np.int64),
                np.zeros(2, np.int64),
                memory[:20],
                build_scratch(space),
                np.zeros(4096, np.int64),
            )
        )
        assert np.all(memory[20:] == canary)
    assert 0 in lengths and max(lengths) <= 20 < MAX_ROWS


def test_a_transit_of_a_kilometre_is_planned() -> None:
    for seed in range(3):
        way = skywright.plan_motion(
            "hexarotor", (0, 0, 5, 0), (950, 0, 5, 0), [Sphere((944, 0, 5), 2.0)], margin=0.2,
            seed=seed,
        )  # fmt: skip
        assert len(way.p_WB) > 2 and way.clearance >= 0.2 - 1e-9
        assert way.cost < 955.0
