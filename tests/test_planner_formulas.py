"""The formulas of the planners by themselves, on cases with a known answer.

The plans of test_planning.py and test_motion_planner.py show that a robot gets there; a term that
matters little there is seen here.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import njit
from scipy.spatial.transform import Rotation

from skywright.core.arrays import Array
from skywright.core.record import View
from skywright.core.types import MAX_JOINTS
from skywright.description.loader import load_description
from skywright.description.robot.loader import load_robot
from skywright.description.world.loader import load_world
from skywright.description.world.spec import World
from skywright.description.world.surface import Cylinder
from skywright.missions.scan.plan import plan
from skywright.models.body_records import Kinematics
from skywright.models.kinematic_tree import FIXED, HINGE, Tree
from skywright.models.link_motion import build_motion
from skywright.models.rigid_body import (
    build_body_model,
    fill_kinematics,
    posture,
)
from skywright.planning import problem, scan
from skywright.planning.checks import Trace, check_dynamics
from skywright.planning.configurations import (
    compute_manipulability,
    find_configurations,
    halton,
)
from skywright.planning.excitation import Excitation, _build_rows, _from_angles, share_lines
from skywright.planning.inverse_dynamics import Loads, build_loads, compute_thrusts
from skywright.planning.inverse_kinematics import (
    build_state,
    build_target,
    settle_posture,
    step_state,
)
from skywright.planning.local_planner import fill_target
from skywright.planning.motion.angular import ROUND, build_angular_map
from skywright.planning.motion.bound import _spread_angle, compute_lower_bound
from skywright.planning.motion.cost import time_cost
from skywright.planning.motion.kinematics import _rodrigues
from skywright.planning.motion.planner import _check_ends
from skywright.planning.motion.rrt_star import RrtStar, plan_rrt_star
from skywright.planning.motion.space import _first_moments, build_scratch
from skywright.planning.motion.through import compute_places
from skywright.planning.motion.timing import TimeLimits, _fastest, assign_times
from skywright.planning.motion.transport import build_transport
from skywright.planning.patterns import build_pattern
from skywright.planning.via_points import DETOURS, ROOM, STEP, Search
from skywright.run.setup import Setup

ROBOT = load_robot("ars-lrm")[0]
WORLD = load_world("pipe-structures")[0]
PAPER = build_transport(ROBOT, WORLD)
EMPTY = build_transport(ROBOT, World(name="empty", area=WORLD.area))


# Motions of one plan


def test_a_branch_of_the_tree_is_no_longer_than_a_step() -> None:
    """Straight to the goal, the way of T s in (4) takes as many branches as steps of T / 4.5."""
    start, goal = EMPTY.start, EMPTY.goal
    step = float(time_cost(EMPTY.space[0], start, goal, 0.5, 0.5)) / 4.5
    par, world = RrtStar(goal_bias=1.0, step_s=step), build_angular_map(EMPTY.space)
    for iterations, reaches in ((4, False), (5, True)):
        rng = np.random.default_rng(1)
        found = plan_rrt_star(
            EMPTY.space, world, start, goal, rng, 60.0, par, iterations=iterations
        )
        assert found.nodes == iterations + 1 and (len(found.rows) > 0) == reaches


def test_the_tip_s_target_moves_as_its_derivatives_say() -> None:
    """Velocities and accelerations against differences of the place itself."""
    R = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    axes = Rotation.from_rotvec([0.1, 0.4, -0.3]).as_matrix()
    prob: Any = SimpleNamespace(cylinder=Cylinder(np.ones(3), R, 0.2, 1.0), R_WA=axes)

    def find(t: float) -> Any:
        law = [(0.1 + 0.3 * t + 0.2 * t**2, 0.3 + 0.4 * t, 0.4),
               (0.5 - 0.4 * t + 0.3 * t**2, -0.4 + 0.6 * t, 0.6),
               (0.02 + 0.1 * t - 0.2 * t**2, 0.1 - 0.4 * t, -0.4)]  # fmt: skip
        target = build_target()
        fill_target(prob, *map(np.array, law), target)
        return target

    step = 1e-4
    before, now, after = find(0.3 - step), find(0.3), find(0.3 + step)
    for place, rate, change in (("p", "v", "a"), ("z", "zd", "zdd")):
        x, y, z = (getattr(f, place) for f in (before, now, after))
        np.testing.assert_allclose(getattr(now, rate), (z - x) / (2 * step), atol=1e-6)
        np.testing.assert_allclose(getattr(now, change), (z - 2 * y + x) / step**2, atol=1e-5)
    local = R.T @ (now.p - 1.0)
    assert math.hypot(local[0], local[2]) == pytest.approx(0.2 + 0.02 + 0.03 - 0.018)


def test_a_state_moves_at_constant_acceleration() -> None:
    rng, dt, n = np.random.default_rng(2), 0.01, 3
    state = build_state(rng.normal(size=3), np.eye(3), rng.normal(size=n))
    state.v[:], state.qd[:n], u = rng.normal(size=3), rng.normal(size=n), rng.normal(size=6 + n)
    state.w[:], u[3:6] = [0.0, 0.0, 0.4], [0.0, 0.0, 1.5]
    p, v, q, qd = state.p.copy(), state.v.copy(), state.q[:n].copy(), state.qd[:n].copy()
    for _ in range(50):
        step_state(state, u, n, dt)
    T = 50 * dt
    np.testing.assert_allclose(state.p, p + T * v + T**2 / 2 * u[:3])
    np.testing.assert_allclose(state.v, v + T * u[:3])
    np.testing.assert_allclose(state.q[:n], q + T * qd + T**2 / 2 * u[6:])
    np.testing.assert_allclose(state.qd[:n], qd + T * u[6:])
    assert state.w[2] == pytest.approx(0.4 + T * 1.5)
    turn = Rotation.from_matrix(state.R).as_rotvec()
    np.testing.assert_allclose(turn, [0, 0, 0.4 * T + T**2 / 2 * 1.5], atol=1e-9)


@njit
def settle(model: Any, kin: Any, R: Any, q: Any, z: Any) -> float:
    return float(settle_posture(model, kin, R, q, z, 12))


@pytest.mark.parametrize("degrees", [30.0, 100.0, 175.0])
def test_a_posture_turns_its_probe_wherever_it_shall_point(degrees: float) -> None:
    robot = load_robot("othex")[0]
    model, q = build_body_model(robot)[0], np.zeros(MAX_JOINTS)
    home = posture(robot, "working")
    q[: len(home)] = home
    k, R = np.zeros(1, Kinematics.dtype)[0], np.eye(3)
    assert settle(model, k, R, q, np.array([1.0, 0.0, 0.0])) < 1e-6
    turned = math.radians(degrees)
    z = np.array([math.cos(turned), math.sin(turned), 0.0])
    assert settle(model, k, R, q, z) < 1e-6
    np.testing.assert_allclose(R @ k["R_BT"][:, 2], z, atol=1e-6)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"q": 2.1}, problem.JOINT),
        ({"q": -1.1}, problem.JOINT),
        ({"qd": 3.2}, problem.MOTOR),
        ({"v": 0.51}, problem.SPEED),
        ({"u": 0.62}, problem.ACCELERATION),
        ({"tilt": 0.21}, problem.TILT),
    ],
)
def test_what_exceeds_a_limit_is_refused_with_it(changed: dict[str, float], code: int) -> None:
    model = SimpleNamespace(n_joints=2, q_min=[-1.0] * 2, q_max=[2.0] * 2,
                            motor_speed_max=[3.0] * 2, belt_inv=np.eye(2))  # fmt: skip
    limits = problem.Limits(speed=0.5, acceleration=0.6, tilt=0.2)
    prob: Any = SimpleNamespace(model=[model], kinematics=[None], limits=limits)
    state, u, found = build_state(np.zeros(3), np.eye(3), np.zeros(2)), np.zeros(14), np.zeros(5)
    state.q[1], state.qd[1] = changed.get("q", 0.0), changed.get("qd", 0.0)
    state.v[0], u[2] = changed.get("v", 0.0), changed.get("u", 0.0)
    state.R[:] = Rotation.from_rotvec([changed.get("tilt", 0.0), 0.0, 0.0]).as_matrix()
    trace: Any = View(np.zeros(1, Trace.dtype)[0])
    assert check_dynamics(prob, state, u, np.zeros(3), trace, found) == code
    assert abs(found[0]) == pytest.approx(abs(next(iter(changed.values()))))


def test_each_joint_s_acceleration_moves_the_centre_of_mass() -> None:
    """The thrusts carry the weight and accelerate the centre of mass, found by differences."""
    setup = Setup(load_description("pipe-weld-scan", "othex"))
    rotors, home = setup.rotors, posture(setup.robot, "working")
    model: Any = setup.model.view(np.recarray)[0]  # for compiled and plain functions
    k: Any = np.zeros(1, Kinematics.dtype).view(np.recarray)[0]
    q, turn = np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS)
    n = len(home)
    q[:n], turn[:n] = home + 0.3, np.linspace(1.0, -2.0, n)

    def find_moment(q: Array) -> Array:
        fill_kinematics(model, q, k)
        links = range(model.n_links)
        return sum((model.mass[i] * (k.p[i] + k.R[i] @ model.com[i]) for i in links), np.zeros(3))

    step = 1e-5
    moved = (find_moment(q + step * turn) - find_moment(q - step * turn)) / (2.0 * step)
    fill_kinematics(model, q, k)
    limits = problem.Limits(speed=0.5, acceleration=5.0, tilt=0.2, rotor_margin=-math.inf)
    loads = build_loads(setup.allocator, rotors.position, rotors.axis, 0.0)
    prob: Any = SimpleNamespace(
        model=[model], kinematics=[k], limits=limits, loads=loads, motion=build_motion()
    )
    state, u = build_state(np.zeros(3), np.eye(3), q[:n]), np.zeros(6 + MAX_JOINTS)
    u[6:] = turn
    trace: Any = View(np.zeros(1, Trace.dtype)[0])
    assert check_dynamics(prob, state, u, np.zeros(3), trace, np.zeros(5)) == problem.OK
    force = loads.B[:3] @ trace.thrust[: len(rotors.axis)]
    mass = model.mass0 + model.mass[: model.n_links].sum()
    np.testing.assert_allclose(force, moved + [0.0, 0.0, mass * model.gravity], atol=1e-6)


def test_a_configuration_near_the_last_one_is_preferred(monkeypatch: pytest.MonkeyPatch) -> None:
    """The score falls with the square of the rotations of platform and joints, and by no more."""
    kept: list[Search] = []

    def keep(search: Search, *_: object) -> tuple[dict[str, Any], Array, str]:
        kept.append(search)
        return {}, np.zeros((0, 2)), "kept"

    monkeypatch.setattr(scan, "_plan", keep)
    assert plan(Setup(load_description("pipe-weld-scan", "othex"))).blocked_by == "kept"
    (search,) = kept
    corner = search.task.pattern.corners[0]
    tip, n_W = search.tip(*corner)[0], search.axis(corner[1])
    yaw, q_last, pull = 2.9, np.array([0.4, -0.7]), 3.0
    yaws = np.array([0.0, 0.1, math.pi, -3.1])

    def find(last_pull: float) -> dict[tuple[float, ...], float]:
        found = find_configurations(
            search.prob, tip, n_W, search.task.depth, yaws, search.postures, search.q_working,
            q_last, yaw, last_pull, (corner[0], corner[1]),
        )  # fmt: skip
        headings = np.arctan2(found.R[:, 1, 0], found.R[:, 0, 0])
        keys = [(h, *q) for h, q in zip(headings, found.q[:, :2], strict=True)]
        return dict(zip(keys, found.score, strict=True))

    free, pulled = find(0.0), find(pull)
    assert len(free) > 5 and free.keys() == pulled.keys()
    for (heading, *q), score in free.items():
        turn = (heading - yaw + math.pi) % (2.0 * math.pi) - math.pi
        away = turn**2 + np.sum((np.array(q) - q_last) ** 2)
        assert score - pulled[(heading, *q)] == pytest.approx(pull * away, rel=1e-9)


# Wind for which a plan reserves thrust


@pytest.mark.parametrize(
    ("v_W", "air_W"),
    [
        ([0.0, 0.0, 0.0], [-4.0, 0.0, 0.0]),  # it hovers: the wind itself
        ([3.0, 0.0, 0.0], [-7.0, 0.0, 0.0]),  # it flies against the wind
        ([-4.0, 0.0, 0.0], [0.0, 0.0, 0.0]),  # it drifts with the wind
    ],
)
def test_the_rotors_hold_against_the_drag_of_the_wind(v_W: list[float], air_W: list[float]) -> None:
    """Wind of 4 m/s towards -x of W drives the body there: rho / 2 C_D A |v| v along its y."""
    setup = Setup(load_description("pipe-weld-scan", "othex"))
    rotors, area = setup.rotors, np.array([0.02, 0.05, 0.09])
    wind = np.array([-4.0, 0.0, 0.0])
    loads = build_loads(setup.allocator, rotors.position, rotors.axis, 0.0, 1.0, area, 1.2, wind)
    R = Rotation.from_rotvec([0.0, 0.0, math.pi / 2.0]).as_matrix()  # y of B points to -x of W
    f, t, thrust = np.array([0.0, 0.0, 20.0]), np.zeros(3), np.zeros(len(rotors.axis))
    compute_thrusts(loads, R, np.array(v_W), np.zeros(3), f, t, thrust)
    drag = 0.5 * 1.2 * 0.05 * np.linalg.norm(air_W) * np.array(air_W)
    np.testing.assert_allclose(R @ (loads.B[:3] @ thrust), [0.0, 0.0, 20.0] - drag, atol=1e-9)
    np.testing.assert_allclose(loads.B[3:] @ thrust, 0.0, atol=1e-9)


def test_the_rotors_in_the_lee_carry_the_moment_of_the_drag_on_the_hubs() -> None:
    """Hubs at a height h over B: drag D on them in -x is a moment h D that raises the bow.

    A rotor at -r carries h D / 2 r more than its share, one at +r as much less. The platform leans:
    all rotors together lift the root of the squares of weight and drag. The drag on the body, 3 N,
    acts at B.
    """
    r, h, weight, k_f, c, speed = 0.4, 0.1, 40.0, 1e-5, 2e-4, 5.0
    axis = np.tile([0.0, 0.0, 1.0], (4, 1))
    position = np.array([[r, 0.0, h], [0.0, r, h], [-r, 0.0, h], [0.0, -r, h]])
    spin = np.array([1.0, -1.0, 1.0, -1.0])
    B = np.vstack([axis.T, np.cross(position, axis).T + 0.02 * spin * axis.T])
    P = np.zeros((4, 6))
    P[:, 2:] = np.linalg.inv(B[2:])
    loads = Loads(
        B, P, np.zeros(4), np.full(4, 20.0), 0, np.zeros(4), position, axis, k_f, c,
        np.array([0.2, 0.0, 0.0]), 1.2, np.array([-speed, 0.0, 0.0]),
    )  # fmt: skip
    f, t, thrust = np.array([0.0, 0.0, weight]), np.zeros(3), np.zeros(4)
    margin, worst = compute_thrusts(loads, np.eye(3), np.zeros(3), np.zeros(3), f, t, thrust)
    drag = 4.0 * c * math.sqrt(weight / 4.0 / k_f) * speed
    lift, more = math.hypot(weight, drag + 3.0) / 4.0, h * drag / (2.0 * r)
    np.testing.assert_allclose(thrust, [lift - more, lift, lift + more, lift], rtol=1e-12)
    assert worst == 2 and margin == pytest.approx((20.0 - lift - more) / 20.0)


@pytest.mark.parametrize("phi0", [0.0, 3.1, -3.1, -3.5, 4.7, -9.4])  # the angle is periodic
def test_detours_stay_on_the_surface_and_near_the_segment(phi0: float) -> None:
    cylinder, drawn = Cylinder(np.zeros(3), np.eye(3), 0.2, 0.5), list[Array]()
    a, b = np.array([0.45, phi0 - 0.1]), np.array([0.1, phi0 + 0.2])

    def find_nothing(point: Array, *_: object) -> SimpleNamespace:
        drawn.append(point)
        return SimpleNamespace(failure="nothing reaches it")

    search: Any = SimpleNamespace(
        prob=SimpleNamespace(cylinder=cylinder), rng=np.random.default_rng(1), next=find_nothing,
        late=lambda: False,
    )  # fmt: skip
    assert Search.detour(search, None, a, b) == []
    across = ROOM / 0.2
    s, phi = np.array(drawn).T
    assert len(drawn) == DETOURS and s.max() <= 0.5 and s.min() >= 0.1 - ROOM
    assert phi0 - 0.1 - across <= phi.min() < phi0 - 0.1 < phi.max() <= phi0 + 0.2 + across
    assert np.linalg.norm((np.array(drawn) - a) * [1.0, 0.2], axis=1).max() <= STEP + 1e-9


def test_the_manipulability_is_the_volume_that_the_joints_span() -> None:
    J = np.array([[0.3, 0.1, 0.0], [0.0, 0.2, 0.1], [0.0, 0.0, 0.4]])
    k: Any = SimpleNamespace(J_BT=J)
    assert compute_manipulability(k, 3) == pytest.approx(abs(np.linalg.det(J)))
    two = J[:, :2]
    assert compute_manipulability(k, 2) == pytest.approx(math.sqrt(np.linalg.det(two.T @ two)))
    k.J_BT = np.column_stack([J[:, 0], 2.0 * J[:, 0], J[:, 1]])
    assert compute_manipulability(k, 2) == 0.0  # both move the tip the same way
    k.J_BT = np.column_stack([J, J @ [1.0, 1.0, 1.0]])
    assert compute_manipulability(k, 4) > 0.0  # the fourth adds no direction


def test_patterns_lie_about_their_centre() -> None:
    for kind in ("raster", "line", "spiral"):
        corners = build_pattern(kind, 0.2, 0.5, centre_s=0.1, pass_length=0.3).corners
        assert (corners[:, 0].min(), corners[:, 0].max()) == pytest.approx((-0.05, 0.25))


# Excitation


def test_attitudes_are_yaw_after_pitch_after_roll() -> None:
    angles = np.random.default_rng(4).uniform(-1.0, 1.0, (5, 3))
    wanted = Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix()
    np.testing.assert_allclose(_from_angles(angles), wanted, atol=1e-12)


def test_the_lines_are_the_harmonics_within_the_band() -> None:
    e = Excitation(40.0, 0.07, 0.3, 0.4, 0.1, 1.0)
    dealt = share_lines(e, 6)
    lines = np.sort(np.concatenate(dealt))
    base = 1.0 / (e.duration - 2.0 * 2.0)
    np.testing.assert_allclose(np.diff(lines), lines[1] - lines[0])
    assert lines[0] >= 0.1 and lines[-1] <= 1.0 and lines[-1] + base > 1.0
    assert max(map(len, dealt)) - min(map(len, dealt)) <= 1


def test_an_excitation_moves_as_its_rates_say_from_rest_to_rest() -> None:
    robot = load_robot("othex")[0]
    e = Excitation(20.0, 0.07, 0.3, 0.4, 0.2, 1.0)
    rows = _build_rows(
        robot, e, 1.0, np.array([1.0, 2.0, 3.0, 0.5]), posture(robot, "folded"), True
    )
    t = rows["t"]
    assert t[-1] == pytest.approx(20.0) and np.allclose(np.diff(t), 0.02)
    for place, rate in (("p_WB", "v_WB"), ("v_WB", "a_WB")):
        np.testing.assert_allclose(
            np.gradient(rows[place], t, axis=0)[2:-2], rows[rate][2:-2], atol=5e-3
        )
    for end in (0, -1):
        np.testing.assert_allclose(rows["p_WB"][end], [1.0, 2.0, 3.0], atol=1e-9)
        np.testing.assert_allclose(rows["v_WB"][end], 0.0, atol=1e-9)
    angles = Rotation.from_matrix(rows["R_WB"]).as_euler("ZYX")[:, ::-1] - [0.0, 0.0, 0.5]
    peaks = np.abs(angles).max(axis=0)
    assert np.all(peaks > [0.035, 0.035, 0.15]) and np.all(peaks < [0.0701, 0.0701, 0.301])
    spin = np.linalg.norm(rows["w_WB_B"], axis=1)
    steps = [Rotation.from_matrix(a.T @ b).magnitude() for a, b in
             zip(rows["R_WB"][:-2], rows["R_WB"][2:], strict=True)]  # fmt: skip
    np.testing.assert_allclose(spin[1:-1], np.array(steps) / 0.04, atol=5e-3)


# Paths through structures


def test_a_slice_spreads_over_angles_at_their_cost() -> None:
    """Neighbouring cells touch, so the first step is free; against all pairs."""
    V = np.random.default_rng(5).uniform(0.0, 1.0, (2, 7, 6))
    for axis in (1, 2):
        rows, found = np.moveaxis(V, axis, -1), V.copy()
        _spread_angle(found, axis, 0.1)
        k = np.arange(rows.shape[-1])
        apart = np.maximum(np.abs(k[:, None] - k) - 1, 0)
        wanted = np.min(rows[..., None, :] + 0.1 * apart, axis=-1)
        np.testing.assert_allclose(np.moveaxis(found, axis, -1), wanted)


def test_the_bound_of_a_free_way_is_its_cost() -> None:
    space, start, goal = EMPTY.space, EMPTY.start, EMPTY.goal + [0.0, 1.5, 0.2, -0.1]
    w = space[0]["weight"]
    move, turn = w[0] * math.hypot(*(goal - start)[:2]), float(w[2:4] @ np.abs(goal - start)[2:])
    assert compute_lower_bound(space, start, goal, []) == pytest.approx(move + turn)
    # in coarse cells a little is lost at each slice, and never anything gained
    bound = compute_lower_bound(space, start, goal, [4.5], 0.5, 1.0)
    assert 0.9 * move < bound <= move + turn + 1e-9


def test_places_are_told_along_every_way_that_leads_somewhere() -> None:
    goal = PAPER.goal + [0.0, 2.0, 0.0, 0.0]
    found = compute_places(PAPER.space, PAPER.start, goal)
    assert set(found.axis) == {0, 2} and set(found.coordinate) == {0, 1}
    level = compute_places(PAPER.space, PAPER.start, PAPER.goal)
    assert set(level.axis) == {0}  # it climbs nowhere


def test_pipes_across_the_plane_are_circles() -> None:
    world = build_angular_map(PAPER.space)
    rows = world[0]
    round_ = rows[:, 4] == ROUND
    np.testing.assert_allclose(rows[round_, 2], rows[round_, 3])
    assert np.any(round_) and not np.all(round_)


def test_a_transport_may_climb_above_both_ends() -> None:
    low, high = EMPTY.space[0]["low"], EMPTY.space[0]["high"]
    for end in (EMPTY.start, EMPTY.goal):
        assert np.all(low[:4] <= end) and np.all(end <= high[:4])
        assert high[1] > end[1] + 0.5


def test_a_joint_turns_about_any_axis() -> None:
    axis, out = np.array([0.36, -0.48, 0.8]), np.zeros((3, 3))
    _rodrigues(axis, 0.7, out)
    np.testing.assert_allclose(out, Rotation.from_rotvec(0.7 * axis).as_matrix(), atol=1e-12)


def test_first_moments_are_those_of_the_stretched_chain() -> None:
    """Two links in line beyond the first joint: what hangs on it at most, and beyond the second."""
    pos, com = np.zeros((3, 3)), np.zeros((3, 3))
    pos[:, 0], com[:, 0] = [0.0, 0.1, 0.4], [0.0, 0.2, 0.3]
    tree = Tree(
        np.array([-1, 0, 1]), np.array([FIXED, HINGE, HINGE]), np.array([-1, 0, 1]), pos,
        np.tile(np.eye(3), (3, 1, 1)), np.tile([0.0, 1.0, 0.0], (3, 1)), np.array([5.0, 2.0, 3.0]),
        com,
    )  # fmt: skip
    moment, _ = _first_moments(tree, -1)
    np.testing.assert_allclose(moment[1:], [2.0 * 0.2 + 3.0 * (0.4 + 0.3), 3.0 * 0.3])


def test_a_shape_lies_in_its_sphere_which_is_no_larger() -> None:
    r = EMPTY.space[0]
    for s in range(int(r["ns"])):
        if not np.any(r["s_half"][s]):
            ends = np.linalg.norm(r["s_p1"][s] - r["s_p0"][s])
            assert r["bound"][s] == pytest.approx(ends / 2.0 + r["s_radius"][s])


def test_ends_are_checked_with_the_line_between_them() -> None:
    scratch = build_scratch(EMPTY.space)
    blocked, free, cost = _check_ends(EMPTY.space, EMPTY.start, EMPTY.goal, scratch)
    assert (blocked, free) == (-1, True) and cost == pytest.approx(9.0)


def test_the_fastest_motion_keeps_its_limits_at_both_ends_of_every_step() -> None:
    """What the start of a step in a bend allows may be too fast for its end."""
    s = np.linspace(0.0, 1.0, 101)
    d, dd = np.ones((101, 1)), 2.0 * s[:-1, None]
    stop = np.isin(s, (0.0, 1.0))
    x = _fastest(s, d, dd, stop, np.full(101, 4.0), np.array([1.0]))
    change = np.diff(x) / (2.0 * np.diff(s))
    assert x[0] == x[-1] == 0.0 and x.max() > 0.3
    for end in (0, 1):
        there = dd[:, 0] * x[end : 100 + end] + change
        assert np.abs(there).max() <= 1.0 + 1e-6, end


def test_an_averaged_motion_moves_as_its_rates_say() -> None:
    limits = TimeLimits(speed=1.0, acceleration=0.8, mass=7.0, thrust=118.8, smooth=1.2)
    rows = np.array([EMPTY.start, EMPTY.start + [2.0, 0.0, 0.0, 0.0]])
    timed = assign_times(EMPTY.space, rows, limits)
    for place, rate in ((timed.c, timed.cd), (timed.cd, timed.cdd)):
        slope = np.gradient(place, timed.t, axis=0)
        np.testing.assert_allclose(slope[2:-2], rate[2:-2], atol=0.02)
    np.testing.assert_allclose(timed.c[[0, -1]], rows, atol=1e-9)


def test_halton_has_a_prime_for_every_joint() -> None:
    """Van der Corput's sequence in base 23, the ninth prime, begins k / 23."""
    np.testing.assert_allclose(halton(5, MAX_JOINTS)[:, -1], np.arange(1, 6) / 23.0, atol=1e-15)
