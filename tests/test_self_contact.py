"""Parts of the robot collide with each other, but for neighbours by design."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from side_arm import build_side_arm
from skywright.description.loader import load_description
from skywright.description.world.loader import load_world
from skywright.description.world.surface import Cylinder
from skywright.models.deviation import Deviation
from skywright.models.geometry import build_clearance, compute_self_clearance
from skywright.models.rigid_body import posture
from skywright.models.scene import Scene, build_scene, set_pose
from skywright.models.self_contact import POSTURES, build_self_contacts, find_self_contact
from skywright.planning.inverse_kinematics import build_state
from skywright.planning.local_planner import Edge, plan_free_edge
from skywright.planning.patterns import build_time_law
from skywright.planning.problem import (
    CLEARANCE,
    JOINT,
    Failure,
    Limits,
    build_problem,
    describe_failure,
)
from skywright.run.setup import Setup

SETUP = Setup(load_description("waypoints", robot="tilthex-arm"))
JOINTS = len(SETUP.planning_scene.joints)
HERE = np.array([0.0, 0.0, 3.0])
"""Nothing is near, so the distance to the world permits large steps."""
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
MISSIONS = ("pipe-weld-scan", "bridge-contact", "sensor-install", "tool-install", "bar-transport")


def list_own_contacts(scene: Scene, q: np.ndarray) -> set[tuple[str, str]]:
    """Names of the robot's geoms that touch each other, 5 m above the ground."""
    model, data = scene.model, mujoco.MjData(scene.model)
    set_pose(scene, data, np.array([-3.0, 0.0, 5.0]), LEVEL, q)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    root = model.body("platform").id
    return {
        (model.geom(int(g)).name, model.geom(int(h)).name)
        for g, h in data.contact.geom
        if model.body_rootid[model.geom_bodyid[g]]
        == model.body_rootid[model.geom_bodyid[h]]
        == root
    }


@pytest.mark.parametrize("mission", MISSIONS)
def test_no_part_touches_another_in_the_postures_of_every_day(mission: str) -> None:
    d = load_description(mission)
    scene = build_scene(d.robot, d.world, Deviation())
    for which in POSTURES:
        assert not list_own_contacts(scene, posture(d.robot, which))


def test_an_arm_meets_propellers_and_gear_where_the_planner_sees_it() -> None:
    """MuJoCo's contacts against our own distances, over postures within the joints' limits."""
    d = load_description("tool-install")
    scene = build_scene(d.robot, d.world, Deviation())
    query = build_clearance(build_scene(d.robot, d.world))
    rng, met, free = np.random.default_rng(0), 0, 0
    for _ in range(300):
        q = rng.uniform(-np.pi, np.pi, scene.n_joints)
        seen = compute_self_clearance(query, q)
        parts = {n for pair in list_own_contacts(scene, q) for n in pair}
        if seen.distance > 1e-3:
            free += 1
            assert not any(name.startswith("propeller") for name in parts)
        # the folded elbow touches a leg of the gear: neighbours
        elif seen.distance < -1e-3 and query.names[seen.other_geom].startswith("propeller"):
            met += 1
            assert {query.names[seen.robot_geom], query.names[seen.other_geom]} <= parts
    assert met > 20 and free > 20


@pytest.mark.parametrize("deviation", [None, Deviation()])
def test_a_first_link_meets_propellers(deviation: Deviation | None) -> None:
    robot, world = build_side_arm(), load_world("open")[0]
    query, q = build_clearance(build_scene(robot, world)), np.radians([-25.0])
    seen = compute_self_clearance(query, q)
    assert (query.names[seen.robot_geom], seen.distance) == (
        "link1 shell", pytest.approx(-0.069, abs=1e-3)
    )  # fmt: skip
    scene = build_scene(robot, world, deviation)
    met = {frozenset(pair) for pair in list_own_contacts(scene, q)}
    assert frozenset(("propeller0", "link1 shell")) in met
    assert not list_own_contacts(scene, np.radians([90.0]))


def test_a_first_link_folded_through_a_propeller_is_its_neighbour() -> None:
    """The plant has no contact with this propeller, but with the others."""
    world = load_world("open")[0]
    scene = build_scene(build_side_arm(folded_deg=-25.0), world, Deviation())
    assert not list_own_contacts(scene, np.radians([-25.0]))
    met = {name for pair in list_own_contacts(scene, np.radians([-150.0])) for name in pair}
    assert "propeller2" in met


def test_two_arms_meet_each_other() -> None:
    d = load_description("tool-install")
    scene = build_scene(d.robot, d.world, Deviation())
    rng, both = np.random.default_rng(1), 0
    for _ in range(200):
        q = posture(d.robot, "working") + rng.uniform(-1.0, 1.0, scene.n_joints)
        for g, h in list_own_contacts(scene, q):
            both += {g.split("_")[0], h.split("_")[0]} == {"left", "right"}
    assert both > 5


def move(a: np.ndarray, b: np.ndarray) -> Edge:
    """Move the arm from a to b at rest, with the platform still."""
    limits = Limits()
    prob = build_problem(
        SETUP.model, SETUP.loads, SETUP.clearance, Cylinder(HERE, np.eye(3), 1.0, 1.0), limits, 0.0
    )
    law = build_time_law(float(np.max(np.abs(b - a))), limits.joint_rate, limits.joint_acceleration)
    return plan_free_edge(
        prob, build_state(HERE, np.eye(3), a), HERE, np.eye(3), b, law, limits.margin_transit
    )


def test_an_arm_does_not_pass_through_a_propeller_far_from_the_world() -> None:
    a, b = np.radians([13.0, -24.0, 6.0, -82.0]), np.radians([-5.0, 37.0, 94.0, -23.0])
    edge = move(a, b)
    assert edge.failure is not None and edge.failure.code == CLEARANCE
    assert "propeller" in describe_failure(edge.failure, SETUP.clearance, ())
    assert "mission.self_clearance_m" in describe_failure(edge.failure, SETUP.clearance, ())


def test_a_slide_beyond_its_limit_is_told_in_metres() -> None:
    """1 cm beyond a limit of a slide was told as 1 deg."""
    failure = Failure(JOINT, -0.01, 0.0, 0, math.nan, math.nan, HERE, "")
    model = SETUP.model.copy()
    assert "a at -1 deg" in describe_failure(failure, SETUP.clearance, ("a",), model)
    model[0]["slide"][model[0]["joint"] == 0] = 1
    said = describe_failure(failure, SETUP.clearance, ("a",), model)
    assert "joint a at -0.0100 m exceeds its limit of 0.0000 m" in said


def test_accepted_moves_of_an_arm_keep_their_distance() -> None:
    """Random moves between free postures; between rows a distance may be 1 mm less."""
    scene, rng = SETUP.planning_scene, np.random.default_rng(0)
    contacts, least = build_self_contacts(SETUP.scene.model, SETUP.robot), Limits().margin_self

    def measure(q: np.ndarray) -> float:
        return compute_self_clearance(SETUP.clearance, q).distance

    accepted = 0
    while accepted < 40:
        a, b = rng.uniform(scene.q_min, scene.q_max, (2, JOINTS))
        if min(measure(a), measure(b)) < least or move(a, b).failure is not None:
            continue
        accepted += 1
        ways = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
        assert min(measure(q) for q in ways) > least - 0.001
        touch = find_self_contact(contacts, ways)
        assert "propeller" not in touch, touch
