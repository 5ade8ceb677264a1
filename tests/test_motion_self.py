"""Parts of the robot on planned paths: two arms, ends that touch; and paths of many rows."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import skywright
from side_arm import build_side_arm
from skywright.core.user_code import njit
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.errors import InfeasibleError
from skywright.models.kinematic_tree import build_planning_scene, build_shapes
from skywright.models.rigid_body import posture
from skywright.models.scene import build_scene
from skywright.models.self_contact import build_self_contacts, find_self_contact
from skywright.planning.motion import transit
from skywright.planning.motion.connect import TREE_SIZE, connect
from skywright.planning.motion.edges import pair_distance, place_shapes
from skywright.planning.motion.improve import MAX_ROWS
from skywright.planning.motion.pairs import PAIR_SELF
from skywright.planning.motion.rng import build_state
from skywright.planning.motion.space import build_scratch
from skywright.planning.motion.transit import (
    SLACK,
    UNCHECKED,
    Configuration,
    Transit,
    _build_blend,
    describe_pair,
    plan_transit,
)
from skywright.planning.motion.transport import build_transport
from skywright.planning.shapes import Sphere, _build_row, plan_between

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


def test_a_first_link_does_not_swing_through_a_propeller() -> None:
    """Both ends are free; the joint's range contains no way around the propeller."""
    robot = build_side_arm()
    a, b = (Configuration(HERE, 0.0, np.radians([deg])) for deg in (90.0, -60.0))
    contacts = build_self_contacts(build_scene(robot, OPEN).model, robot)
    with pytest.raises(InfeasibleError, match="propeller0 and link1 shell of the robot touch"):
        plan_between(robot, OPEN, a, b, [], 0.1, 1)
    way = plan_between(robot, OPEN, a, b._replace(q=np.radians([40.0])), [], 0.1, 1)
    assert not find_self_contact(contacts, way.q)


@pytest.mark.parametrize("name", ["folded", "working", "landed"])
def test_regular_postures_touch_nothing(name: str) -> None:
    for robot in ("bimanual", "ars-lrm", "othex", "tilthex-arm", "f550-scan"):
        r = load_robot(robot)[0]
        scene = build_planning_scene(build_scene(r, OPEN), r)
        assert not find_self_contact(scene.contacts, posture(r, name)[None])


def find_margins(postures: tuple[Configuration, Configuration], keep: float) -> np.ndarray:
    """(k, 2) m, least distance at the ends and margin of the pairs of parts closer than `keep`."""
    moving = list(range(len(postures[0].q)))
    space, ends = _build_blend(SCENE, *postures, moving, 0.1, keep, None, 0.0)
    scratch, out = build_scratch(space), []
    distances = np.minimum(*(_measure_pairs(space, scratch, end) for end in ends))
    for i in range(int(space[0]["n_pairs"])):
        margin = float(space[0]["margin"][i])
        if space[0]["pairs"][i, 2] == PAIR_SELF and margin < keep:
            out.append((distances[i], margin))
    return np.array(out)


@njit
def _measure_pairs(spaces, scratch, c):  # type: ignore[no-untyped-def]
    space, k = spaces[0], scratch[0]
    k.d[:] = 0.0
    place_shapes(space, c, k.d, k)
    out = np.zeros(space.n_pairs)
    for i in range(space.n_pairs):
        out[i] = pair_distance(space, k, i)
    return out


def test_parts_that_are_close_at_an_end_come_no_closer() -> None:
    """The margin of a close pair is its own distance and `SLACK`.

    Pairs without a margin have the axis of a link in the platform's box: they cannot come closer.
    """
    folded, working = posture(ROBOT, "folded"), posture(ROBOT, "working")
    ends = Configuration(HERE, 0.0, folded), Configuration(HERE, 0.0, working)
    least, margins = find_margins(ends, 0.5).T
    checked = margins > UNCHECKED
    assert np.any(checked)
    assert np.all(margins[checked] >= least[checked] - SLACK - 1e-12)
    assert np.all(margins[checked] < least[checked]) and np.all(least[~checked] < 0.0)


def test_parts_that_overlap_at_both_ends_are_planned_with_room_to_move() -> None:
    """A folded arm reaches into the platform's box; the arm's shapes themselves are apart.

    No margin is within less than `SLACK` of the distance: edges would be divided finely.
    """
    folded = posture(ROBOT, "folded")
    bent = folded + 0.05
    a, b = Configuration(HERE, 0.0, folded), Configuration(HERE + [2.0, 0.0, 0.0], 0.0, bent)
    margins = find_margins((a, b), 0.02)
    assert np.any(margins[:, 0] < 0.0)
    assert np.all(margins[:, 1] <= margins[:, 0] - SLACK + 1e-12) and SLACK >= 0.01
    way = plan_transit(SCENE, a, b, np.random.default_rng(1), 0.1)
    assert way.blocked_by is None and len(way.q) == 2


def test_a_lowered_margin_is_reported_by_its_meaning() -> None:
    folded = posture(ROBOT, "folded")
    ends = Configuration(HERE, 0.0, folded), Configuration(HERE, 0.0, folded + 0.05)
    space, _ = _build_blend(SCENE, *ends, list(range(len(folded))), 0.1, 0.3, None, 0.0)
    own = [i for i in range(int(space[0]["n_pairs"])) if space[0]["pairs"][i, 2] == PAIR_SELF]
    lowered = [i for i in own if space[0]["margin"][i] < 0.3]
    rest = [i for i in own if space[0]["margin"][i] >= 0.3]
    for i in lowered:
        found = describe_pair(space, SCENE, i, "mission.clearance_m", 0.3)
        assert found.endswith(" more than 1 cm closer than at the start or the goal")
    assert lowered and rest
    assert "closer than 0.3 m (twice mission.self_clearance_m" in describe_pair(
        space, SCENE, rest[0], "mission.clearance_m", 0.3
    )


def test_corners_stay_where_parts_touch_without_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """The path before its corners are removed is free; its own cost and clearance belong to it."""
    robot = load_robot("othex")[0]
    scene = build_planning_scene(build_scene(robot, OPEN), robot)
    row = _build_row(0, Sphere((3.0, 0.0, 3.0), 1.0))
    scene = scene._replace(world=build_shapes([row]), world_names=("sphere",))
    q = posture(robot, "folded")
    ends = Configuration(HERE, 0.0, q), Configuration(HERE + [6.0, 0.0, 0.0], 0.0, q)
    monkeypatch.setattr(transit, "_drop", lambda _space, _scratch, rows: (2, 6.0))
    monkeypatch.setattr(transit, "_find_touch", lambda *a: "a and b" * (len(a[2]) == 2))
    way = plan_transit(scene, *ends, np.random.default_rng(1), 0.1)
    assert way.blocked_by is None and len(way.p_WB) > 2
    assert way.cost > 6.0 and way.clearance >= 0.1 - 1e-9
    monkeypatch.setattr(transit, "_find_touch", lambda *a: "a and b" * (len(a[2]) > 1))
    way = plan_transit(scene, *ends, np.random.default_rng(1), 0.1)
    assert str(way.blocked_by).endswith("obstacle: a and b of the robot touch")


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
