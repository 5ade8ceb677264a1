"""Capability: closed forms against linear programmes, printed numbers, and physics."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skywright.description.robot.loader import load_robot
from skywright.description.robot.spec import Robot
from skywright.errors import InputError
from skywright.models.capability import (
    Capability,
    check_can_fly,
    compute_capability,
    compute_force_limit,
    compute_least_wind_limit,
    compute_wind_limit,
)
from skywright.models.hover_tilt import compute_hover_tilt
from skywright.models.rigid_body import posture
from skywright.models.rotors import build_rotors, compute_rotor_drag
from skywright.models.statics import (
    UP,
    build_layout,
    compute_lateral_forces,
    compute_ray,
    compute_ray_lp,
    compute_thrust,
    compute_tilt_limit,
    wrench_at,
)
from skywright.models.sweep import strip_robot
from skywright.models.wind import compute_body_drag, compute_drag, compute_hold
from skywright.reports.capability import write_capability_figure

GF = 9.81e-3


def changed(robot: Robot, **tables: dict[str, Any]) -> Robot:
    """Return a robot with values of its tables replaced."""
    data = robot.model_dump()
    for name, values in tables.items():
        data[name].update(values)
    return Robot(**data)


@pytest.fixture(scope="module")
def othex() -> Robot:
    return load_robot("othex")[0]


@pytest.fixture(scope="module")
def f550() -> Robot:
    """The platform alone, 2.0 kg, as the paper's Table 2 has it."""
    return strip_robot(load_robot("f550-bridge")[0])


@pytest.fixture(scope="module")
def hexarotor() -> Robot:
    return load_robot("hexarotor")[0]


@pytest.fixture(scope="module")
def othex_capability(othex: Robot) -> Capability:
    return compute_capability(othex)


@pytest.fixture(scope="module")
def f550_capability(f550: Robot) -> Capability:
    rotors = {"thrust_min_n": 90 * GF, "thrust_max_n": 850 * GF, "thrust_fraction": 0.9}
    return compute_capability(changed(f550, rotors=rotors))


# --- Sanchez-Cuevas et al. 2020 ---


def test_f550_allocation_matrix_of_the_paper(f550: Robot) -> None:
    """Blocks A, G, H of equation (20), with the printed sign errors corrected."""
    s, c, h = math.sin(math.radians(20)), math.cos(math.radians(20)), math.sqrt(3) / 2
    A = np.array(
        [
            [h * s - s * c / 2, s * c, -h * s - s * c / 2] * 2,
            [s / 2 + h * s * c, -s, s / 2 - h * s * c] * 2,
            [c * c] * 6,
        ]
    )
    G = np.array(
        [
            c * c * np.array([0.5, 1, 0.5, -0.5, -1, -0.5]),
            c * c * np.array([-h, 0, h, h, 0, -h]),
            s * c * np.array([1, -1, 1, -1, 1, -1]),
        ]
    )
    H = A * np.array([-1, 1, -1, 1, -1, 1])
    r = build_rotors(f550.rotors)
    assert np.allclose(r.B[:3], A, atol=1e-12)
    assert np.allclose(r.B[3:], 0.275 * G + r.torque_per_thrust * H, atol=1e-12)


def test_f550_lateral_force_and_tilt_of_the_paper(f550_capability: Capability) -> None:
    """Table 2 prints 415 and 555 gf; +x, +y, -x, -y at 2.0 kg, minimum thrust 90 gf."""
    force = f550_capability.lateral_force[[0, 18, 36, 54]] / GF
    assert force == pytest.approx([416, 555, 560, 423], abs=1.0)
    tilt = np.degrees(f550_capability.hover_tilt)
    assert tilt == pytest.approx([11.8, 11.6], abs=0.15)


def test_f550_without_minimum_thrust(f550: Robot) -> None:
    rotors = {"thrust_min_n": 0.0, "thrust_max_n": 739 * GF, "thrust_fraction": 0.9}
    force = compute_capability(changed(f550, rotors=rotors)).lateral_force[[0, 18, 36, 54]] / GF
    assert force == pytest.approx([546, 423, 415, 555], abs=1.0)


# --- closed forms against linear programmes ---


def test_lateral_force_equals_the_linear_programme(othex_capability: Capability) -> None:
    c = othex_capability
    level = wrench_at(c.body.mass * 9.81 * UP, c.body.p_BC)
    for i in range(0, 72, 5):
        d = np.array([math.cos(c.directions[i]), math.sin(c.directions[i]), 0.0])
        lp = compute_ray_lp(c.layout, level, wrench_at(d, c.body.p_BC))
        assert c.lateral_force[i] == pytest.approx(lp.hi, abs=1e-5)


@settings(max_examples=25)
@given(
    st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.floats(0.5, 3.5), st.floats(-0.05, 0.05)
)
def test_ray_equals_the_linear_programme(ray: list[float], mass: float, offset: float) -> None:
    layout = build_layout(build_rotors(load_robot("othex")[0].rotors), 0.9)
    w0 = wrench_at(mass * 9.81 * UP, np.array([offset, 0.5 * offset, 0.0]))
    direction = np.array(ray) * np.array([1, 1, 1, 0.3, 0.3, 0.3])
    if np.abs(layout.P @ direction).max() < 1e-3:
        return
    closed, lp = compute_ray(layout, w0, direction), compute_ray_lp(layout, w0, direction)
    assert np.isnan(closed.lo) == np.isnan(lp.lo)
    if not math.isnan(closed.lo):
        assert closed == pytest.approx(lp, abs=1e-3)


EIGHT = {
    "azimuth_deg": [22.5 + 45 * i for i in range(8)],
    "alpha_deg": [25, -25] * 4,
    "beta_deg": [10, 10, -10, -10] * 2,
    "spin": ["ccw", "cw"] * 4,
}


def test_redundant_rotors_use_the_linear_programme(othex: Robot) -> None:
    """Eight tilted rotors: every limit is feasible, and one newton more is not."""
    layout = build_layout(build_rotors(changed(othex, rotors=EIGHT).rotors), 0.9)
    assert layout.full and not layout.exact
    weight, com = 22.0, np.array([0.05, 0.0, 0.0])
    angles = np.radians([0.0, 50.0, 200.0])
    for angle, force in zip(
        angles, compute_lateral_forces(layout, weight, com, angles), strict=True
    ):
        d = np.array([math.cos(angle), math.sin(angle), 0.0])
        for extra, feasible in ((-0.01, True), (0.01, False)):
            wrench = wrench_at(weight * UP + (force + extra) * d, com)
            assert (compute_thrust(layout, wrench) is not None) == feasible


@pytest.mark.parametrize(("weight", "least", "most"), [(8.0, 9, 16), (22.0, 11, 19), (55.0, 1, 5)])
def test_redundant_rotors_tilt_up_to_the_first_infeasible_wrench(
    othex: Robot, weight: float, least: float, most: float
) -> None:
    layout = build_layout(build_rotors(changed(othex, rotors=EIGHT).rotors), 0.9)
    com = np.array([0.02, -0.01, 0.03])
    for angle in np.radians([0.0, 70.0, 135.0, 260.0]):
        axis = np.array([math.cos(angle), math.sin(angle), 0.0])
        limit = compute_tilt_limit(layout, weight, com, axis)
        assert math.radians(least) < limit <= math.radians(most)
        inside = [(tilt, True) for tilt in np.linspace(0.0, limit - 1e-5, 5)]
        for tilt, feasible in (*inside, (limit + 1e-4, False)):
            up_B = math.cos(tilt) * UP - math.sin(tilt) * np.cross(axis, UP)
            found = compute_thrust(layout, wrench_at(weight * up_B, com))
            assert (found is not None) == feasible


def test_redundant_rotors_at_their_limit_do_not_tilt(othex: Robot) -> None:
    """The weight is the largest that they hold level: a lean needs more, in every direction."""
    layout = build_layout(build_rotors(changed(othex, rotors=EIGHT).rotors), 0.9)
    com = np.zeros(3)
    weight = compute_ray_lp(layout, np.zeros(6), wrench_at(UP, com)).hi
    for angle in np.radians([0.0, 70.0, 135.0, 260.0]):
        axis = np.array([math.cos(angle), math.sin(angle), 0.0])
        for less in (0.0, 1e-7):
            assert 0.0 <= compute_tilt_limit(layout, weight - less, com, axis) < math.radians(0.1)


def test_wind_from_every_side_is_the_least_of_the_limits(othex: Robot, hexarotor: Robot) -> None:
    for robot in (othex, hexarotor):
        c = compute_capability(robot)
        assert compute_least_wind_limit(robot, 9.81, 1.2) == np.nanmin(c.wind_limit)
        assert compute_least_wind_limit(robot, 9.81, 0.6) > np.nanmin(c.wind_limit)


def test_wind_takes_from_the_hover_tilt_until_level_is_all() -> None:
    """No wind: the closed form. At the wind limit of the level robot nothing is left."""
    robot, _ = load_robot("f550-bridge")
    q = posture(robot, "folded")
    calm = compute_hover_tilt(robot, q, 9.81)
    breath = compute_hover_tilt(robot, q, 9.81, wind=np.array([1e-6, 0.0, 0.0]))
    assert breath == pytest.approx(calm, abs=1e-5)
    found = [compute_hover_tilt(robot, q, 9.81, wind=np.array([v, 0.0, 0.0])) for v in (2.0, 4.0)]
    assert calm > found[0] > found[1] > 0.0
    limit = compute_wind_limit(compute_capability(robot, posture="folded"), 0.0)
    near = [compute_hover_tilt(robot, q, 9.81, wind=np.array([limit + d, 0.0, 0.0]))
            for d in (-0.01, 0.01)]  # fmt: skip
    assert 0.0 <= near[0] < math.radians(0.1) and math.isnan(near[1])


def test_tilt_limit_is_where_a_rotor_meets_its_limit(othex_capability: Capability) -> None:
    c = othex_capability
    for axis in np.array([[1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0], [0.6, 0.8, 0]]):
        limit = compute_tilt_limit(c.layout, c.body.mass * 9.81, c.body.p_BC, axis)
        for tilt, feasible in ((limit - 1e-4, True), (limit + 1e-4, False)):
            # up seen from B after a rotation about the axis (Rodrigues, transposed)
            up_B = math.cos(tilt) * UP - math.sin(tilt) * np.cross(axis, UP)
            wrench = wrench_at(c.body.mass * 9.81 * up_B, c.body.p_BC)
            assert (compute_thrust(c.layout, wrench) is not None) == feasible


def test_polytopes_lie_on_the_limits(othex_capability: Capability) -> None:
    c = othex_capability
    for force in c.force_polytope:
        thrust = c.layout.P @ wrench_at(force, c.body.p_BC)
        room = np.minimum(thrust - c.layout.t_min, c.layout.t_max - thrust)
        assert room.min() > -1e-6
        assert np.sort(np.abs(room))[:3].max() < 1e-5  # a vertex of a 3-D cut: three limits
    level = wrench_at(c.body.mass * 9.81 * UP, c.body.p_BC)
    for torque in c.torque_polytope:
        thrust = c.layout.P @ (level + np.concatenate([np.zeros(3), torque]))
        assert np.all(thrust > c.layout.t_min - 1e-6) and np.all(thrust < c.layout.t_max + 1e-6)


# --- OTHex ---


def test_othex_alternation_suits_the_extended_arm(othex: Robot) -> None:
    """The other alternation of the tilt signs is worse in the weakest direction and forward."""
    here = compute_capability(othex)
    other = compute_capability(
        changed(
            othex,
            rotors={
                "alpha_deg": [-a for a in othex.rotors.alpha_deg],
                "spin": ["cw" if s == "ccw" else "ccw" for s in othex.rotors.spin],
            },
        )
    )
    assert here.lateral_force.min() > 1.1 * other.lateral_force.min()
    assert compute_force_limit(here, [1, 0, 0]) > 1.1 * compute_force_limit(other, [1, 0, 0])
    assert here.wind_limit.min() > other.wind_limit.min()


def test_hover_balances_weight_and_arm(othex_capability: Capability) -> None:
    c = othex_capability
    made = c.layout.B @ c.hover_thrust
    assert made == pytest.approx(wrench_at(c.body.mass * 9.81 * UP, c.body.p_BC), abs=1e-9)
    assert c.body.mass == pytest.approx(2.25)
    assert c.body.p_BC[0] > 0.02  # the arm reaches forward
    usable = 74.0 * 3600 * 0.8
    assert c.endurance == pytest.approx(usable / c.hover_power)


def test_worst_posture_is_not_better(othex: Robot, othex_capability: Capability) -> None:
    worst = compute_capability(othex, posture="worst")
    assert worst.lateral_force.min() <= othex_capability.lateral_force.min()
    assert worst.posture == "worst"


def test_payload_is_where_hover_ends(othex: Robot, othex_capability: Capability) -> None:
    c = othex_capability
    level = wrench_at(c.body.mass * 9.81 * UP, c.body.p_BC)
    for extra, feasible in ((-0.01, True), (0.01, False)):
        added = np.concatenate([(c.payload + extra) * 9.81 * UP, np.zeros(3)])
        assert (compute_thrust(c.layout, level + added) is not None) == feasible


# --- wind and push ---


def test_wind_limit_is_where_a_rotor_meets_its_limit(othex_capability: Capability) -> None:
    """Drag by the compiled functions that the plant's formulas share; speeds iterated."""
    c = othex_capability
    r = c.layout.rotors
    for i in range(0, 72, 9):
        d = np.array([math.cos(c.directions[i]), math.sin(c.directions[i]), 0.0])
        for factor, feasible in ((0.998, True), (1.005, False)):
            wind = factor * c.wind_limit[i] * d
            thrust = c.hover_thrust
            for _ in range(20):
                f, t, body = np.zeros(3), np.zeros(3), np.zeros(3)
                speed = np.sqrt(np.maximum(thrust, 0) / r.k_f)
                compute_rotor_drag(
                    r.position, r.axis, speed, r.drag_coefficient, -wind, np.zeros(3), f, t
                )
                compute_body_drag(c.body.drag_area, c.body.air_density, -wind, body)
                load = wrench_at(c.body.mass * 9.81 * UP, c.body.p_BC)
                thrust = c.layout.P @ (load - np.concatenate([f + body, t]))
            inside = np.all(thrust >= c.layout.t_min) and np.all(thrust <= c.layout.t_max)
            assert inside == feasible
        assert compute_wind_limit(c, math.degrees(c.directions[i])) == pytest.approx(
            c.wind_limit[i], abs=1e-3
        )


def test_drag_forms_agree(othex_capability: Capability) -> None:
    c = othex_capability
    r = c.layout.rotors
    wind, thrust = np.array([3.0, -4.0, 1.0]), np.array([6.0, 5, 3, 3, 5, 6])
    f, t, body = np.zeros(3), np.zeros(3), np.zeros(3)
    compute_rotor_drag(
        r.position, r.axis, np.sqrt(thrust / r.k_f), r.drag_coefficient, -wind, np.zeros(3), f, t
    )
    compute_body_drag(c.body.drag_area, c.body.air_density, -wind, body)
    force, torque = compute_drag(c.layout, c.body, wind[None, :], thrust[None, :])
    assert force[0] == pytest.approx(f + body)
    assert torque[0] == pytest.approx(t)
    assert force[0] @ wind > 0.0  # drag pushes downwind


def test_leaning_into_the_wind_helps(
    othex_capability: Capability, f550_capability: Capability
) -> None:
    for c in (othex_capability, f550_capability):
        assert np.all(c.wind_limit_tilted >= c.wind_limit - 1e-9)
        assert c.wind_limit_tilted.min() > 1.2 * c.wind_limit.min()
        rows = c.lateral_force_tilted
        assert np.all(rows[:, 5] > rows[:, 0])


def test_coplanar_robot_leans_by_the_tangent(hexarotor: Robot) -> None:
    """Level: no lateral force. Tilted: m g tan(tilt). Wind: where drag reaches that."""
    c = compute_capability(hexarotor)
    assert np.all(c.lateral_force == 0.0)
    assert c.hover_tilt == (0.0, 0.0)
    weight = c.body.mass * 9.81
    assert c.lateral_force_tilted[0] == pytest.approx(weight * np.tan(c.tilts), nan_ok=True)
    wind = c.wind_limit[[7]][:, None] * np.array([[math.cos(c.directions[7]), 0.0, 0.0]])
    wind[0, 1] = c.wind_limit[7] * math.sin(c.directions[7])
    thrust, tilt = compute_hold(c.layout, c.body, wind)
    assert tilt[0] == pytest.approx(c.tilt_max, abs=1e-3)
    lifted = np.linalg.norm((c.layout.B @ thrust[0])[:3])
    assert lifted > weight / math.cos(tilt[0]) * 0.9
    push = compute_force_limit(c, [0.0, 1.0, 0.0])
    assert push == pytest.approx(weight * math.tan(c.tilt_max), rel=1e-3)


def test_push_is_less_against_a_head_wind(othex_capability: Capability) -> None:
    c = othex_capability
    calm = compute_force_limit(c, [1, 0, 0])
    head = compute_force_limit(c, [1, 0, 0], [-4.0, 0, 0])
    assert 1.0 < head < calm
    assert math.isnan(compute_force_limit(c, [1, 0, 0], [0.0, 30.0, 0]))
    # at the limit the rotors balance weight and reaction with the tip's lever
    wrench = wrench_at(c.body.mass * 9.81 * UP, c.body.p_BC)
    for extra, feasible in ((-0.01, True), (0.01, False)):
        push = wrench_at(np.array([calm + extra, 0.0, 0.0]), c.p_BT)
        assert (compute_thrust(c.layout, wrench + push) is not None) == feasible


# --- what the command line prints, and refusals ---


def test_json_has_the_contract_keys_and_no_nan(
    othex_capability: Capability, hexarotor: Robot
) -> None:
    keys = {
        "robot",
        "mass_kg",
        "thrust_fraction",
        "directions_deg",
        "lateral_force_n",
        "wind_limit_mps",
        "hover_tilt_deg",
        "hover_power_w",
        "endurance_s",
        "rotors",
    }
    for c in (othex_capability, compute_capability(hexarotor)):
        data = json.loads(json.dumps(c.to_json(), allow_nan=False))
        assert keys <= set(data)
        assert set(data["hover_tilt_deg"]) == {"roll", "pitch"}
        assert len(data["directions_deg"]) == len(data["lateral_force_n"]) == 72
        assert data["directions_deg"][18] == 90.0


def test_json_rotors_rebuild_the_wrench_map(othex_capability: Capability) -> None:
    data = othex_capability.to_json()
    columns = []
    for rotor in data["rotors"]:
        axis, position = np.array(rotor["axis"]), np.array(rotor["position_m"])
        torque = np.cross(position, axis) + rotor["torque_per_thrust_m"] * axis
        columns.append(np.concatenate([axis, torque]))
    assert np.allclose(np.array(columns).T, othex_capability.layout.B)


def test_figure_is_written_as_png_and_svg(
    tmp_path: Path, othex_capability: Capability, hexarotor: Robot
) -> None:
    png = write_capability_figure(othex_capability, tmp_path / "othex.png")
    svg = write_capability_figure(compute_capability(hexarotor), tmp_path / "hexarotor.svg")
    assert png.read_bytes().startswith(b"\x89PNG") and png.stat().st_size > 20_000
    assert "<svg" in svg.read_text()


def test_too_heavy_robot_is_refused_with_numbers(othex: Robot) -> None:
    with pytest.raises(InputError, match=r"cannot lift its weight: it weighs .* N .* lift at most"):
        check_can_fly(changed(othex, platform={"mass_kg": 6.0}))


def test_a_larger_tilt_never_reduces_the_wind_that_is_held() -> None:
    robot = load_robot("f550-bridge")[0]
    limits = [
        compute_capability(changed(robot, control={"tilt_max_deg": tilt})).wind_limit_tilted
        for tilt in (9.5, 20.0)
    ]
    assert np.all(limits[1] > limits[0] - 0.05) and np.max(limits[1] - limits[0]) > 1.0


def test_wind_does_not_end_the_tilt_of_an_omnidirectional_robot() -> None:
    robot = load_robot("omnicopter")[0]
    breath = compute_hover_tilt(robot, np.zeros(0), 9.81, wind=np.array([0.5, 0.0, 0.0]))
    assert math.degrees(breath) > 85.0


def test_the_lift_of_rotors_that_push_both_ways_is_stated() -> None:
    robot = changed(load_robot("omnicopter")[0], platform={"mass_kg": 20.0})
    with pytest.raises(InputError, match=r"weighs 196\.2 N .* at most (\S+) N at 95 %") as error:
        check_can_fly(robot)
    lift = float(str(error.value).split("at most ")[1].split()[0])
    assert 30.0 < lift < 196.0


def test_unbalanced_robot_is_refused_with_the_rotor(othex: Robot) -> None:
    with pytest.raises(InputError, match=r"centre of mass .* rotor \d would need"):
        check_can_fly(changed(othex, platform={"com_x_m": 0.3}))


def test_bad_arguments_are_refused(othex: Robot, othex_capability: Capability) -> None:
    with pytest.raises(InputError, match="valid: extended, folded, worst"):
        compute_capability(othex, posture="stretched")
    with pytest.raises(InputError, match="2 joints"):
        compute_capability(othex, posture=[0.1])
    with pytest.raises(InputError, match=r"^posture\[1\] is nan; valid: a finite angle"):
        compute_capability(othex, posture=[0.1, math.nan])
    with pytest.raises(InputError, match="thrust_fraction"):
        compute_capability(othex, thrust_fraction=0.0)
    with pytest.raises(InputError, match="finite, non-zero"):
        compute_force_limit(othex_capability, [0.0, 0.0, 0.0])
