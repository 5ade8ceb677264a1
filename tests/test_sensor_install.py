"""sensor-install: a short flight on its requirements, and what it is made of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cut_flights import check_cuts, fly_until
from exact_map import EXACT
from skywright.core.rotations import rot_z
from skywright.description.loader import Description, load_description
from skywright.description.robot.limbs import list_joints, list_servos
from skywright.errors import InputError
from skywright.missions.sensor_install.plan import (
    BEHIND,
    RISE,
    build_pose,
    compute_swing_frequency,
    plan,
)
from skywright.missions.skills.ways import check_line
from skywright.models.compliant_arms import count_command_ticks, find_hands
from skywright.models.geometry import build_clearance
from skywright.models.rigid_body import build_body_model, compute_body
from skywright.models.scene import build_scene
from skywright.models.things.box import Box
from skywright.run.backends import build_vehicle
from skywright.run.metrics import in_phases
from skywright.run.planning import plan_mission
from skywright.run.run import fly_and_evaluate
from skywright.run.setup import Setup

DESCRIPTION = load_description("sensor-install")
CHECKS_OFF = [*EXACT, "mission.task.hover_s=0", "mission.task.swing_deg=0",
              "mission.timestep_ms=2"]  # fmt: skip


def test_the_sensor_is_pressed_on_with_2_n_and_stays() -> None:
    result = fly_and_evaluate(load_description("sensor-install", sets=CHECKS_OFF, seed=4))
    m = result.metrics
    names = [p.name for p in result.phases]
    nine = [
        "take_off", "arms to operation pose", "navigate", "approach", "touch", "force", "retract",
        "return", "land",
    ]  # fmt: skip
    assert [n for n in names if n in nine] == nine
    assert all(p.outcome == "done" for p in result.phases)
    assert m["force.mean_error_n"] < 0.1 and m["force.rms_error_n"] < 0.15
    assert m["platform.excursion_m"] < 0.03
    assert m["contact.collisions"] == 0.0 and m["contact.lost_s"] == 0.0
    assert m["sensor.installed"] == 1.0
    # the force across the push is led to zero: the hand does not walk off
    t, hold = result.samples["t"], result.phases[names.index("force")]
    rows = result.samples[(t >= hold.start_s) & (t < hold.end_s)]
    assert np.max(np.abs(rows["left_f_W"][:, 0])) < 0.5
    assert np.ptp(rows["left_p_WH"][:, 0]) < 0.005
    check_cuts(result)


def test_the_hand_without_the_sensor_finds_the_pipe_first() -> None:
    """At the largest errors: the pipe hangs 3.5 cm from its map, where no press would be square."""
    sets = [*CHECKS_OFF, "plant.map_error_m=0.03", "plant.map_error_deg=3",
            "plant.map_error_size_m=0.005"]  # fmt: skip
    result = fly_until("return", load_description("sensor-install", sets=sets, seed=2))
    m, s = result.metrics, result.samples
    assert m["survey.touches"] == 4.0 and m["survey.map_error_mm"] > 20.0
    assert m["survey.surface_error_mm"] < 4.0  # of which 2 are the arm's own zeros and lengths
    assert m["force.mean_error_n"] < 0.1 and m["force.rms_error_n"] < 0.15
    assert m["sensor.installed"] == 1.0 and m["contact.collisions"] == 0.0
    touching = in_phases(s, result.phases, "survey_touch")
    assert np.max(np.abs(s["left_f_W"][touching])) == 0.0  # the tape meets nothing
    assert 0.5 < np.max(s["right_f_W"][touching]) < 4.0
    # a hand that friction holds leads neither link nor shoulder away, and bends as planned
    swing = np.degrees(s["q"][in_phases(s, result.phases, "survey_touch", "survey_back"), 0])
    assert np.ptp(swing) < 4.0
    assert m["arm.lever_felt_min"] > 0.3
    assert m["sensor.around_mm"] < 6.0


@pytest.mark.parametrize("leave", [True, False])
def test_stretched_the_force_fails_unless_the_platform_leaves(leave: bool) -> None:
    """Suarez 2020's second trial, right after arriving, without a hover that lets all settle."""
    sets = [
        *CHECKS_OFF,
        "mission.timestep_ms=1",
        "robot.arm.encoders=left",  # as in the paper
        "mission.task.pose=stretched",
        f"mission.task.leave_singularity={str(leave).lower()}",
    ]
    m = fly_until("return", load_description("sensor-install", sets=sets, seed=2)).metrics
    assert m["contact.collisions"] == 0.0
    if leave:
        assert m["force.mean_error_n"] < 0.1 and m["force.rms_error_n"] < 0.15
        assert m["platform.excursion_m"] < 0.03
    else:
        assert m["force.rms_error_n"] > 0.3
    assert m["arm.lever_felt_min"] < 0.12  # near the singularity, and asked to be there


@given(radius=st.floats(0.05, 0.2))
def test_the_forearm_rises_to_the_hand_and_the_arms_stay_behind_the_pipe(radius: float) -> None:
    q = build_pose(DESCRIPTION.robot, "L", radius)
    mine = [j for j, limb in enumerate(list_joints(DESCRIPTION.robot)) if limb.side == 0]
    pitch, elbow = q[mine[0]], q[mine[-1]]
    assert pitch + elbow == pytest.approx(-math.pi / 2 - RISE)
    q[0] = 0.0
    model = build_body_model(DESCRIPTION.robot)
    assert find_hands(model, q)[0][0] > min(radius + BEHIND, 0.24) - 1e-9


def test_every_pipe_of_the_range_has_a_way() -> None:
    for diameter in (0.1, 0.4):
        for height in (2.2, 3.5):
            sets = [f"world.pipe.diameter_m={diameter}", f"world.pipe.z_m={height}"]
            assert plan(Setup(load_description("sensor-install", sets=sets))).feasible


@pytest.mark.parametrize("pose", ["L", "stretched"])
def test_a_force_at_which_a_servo_stalls_is_refused(pose: str) -> None:
    """Virtual work by finite differences of height and potential, not by the Jacobian."""
    sets = [f"mission.task.pose={pose}", "mission.task.force_n=2"]
    d = load_description("sensor-install", sets=sets)
    way = plan(Setup(d)).way
    model, servos = build_body_model(d.robot), list_servos(d.robot)
    joints, step = list_joints(d.robot), 1e-6

    def height_and_potential(q: np.ndarray) -> tuple[float, float]:
        mass, p, _ = compute_body(model, q)
        return find_hands(model, q)[0][2], 9.81 * mass * p[2]

    limit = math.inf
    for j, limb in enumerate(joints):
        if limb.side != 0:
            continue
        a, b = (height_and_potential(way.q + s * step * np.eye(len(joints))[j]) for s in (-1, 1))
        lever, hold = (b[0] - a[0]) / (2 * step), (b[1] - a[1]) / (2 * step)
        stall = servos[limb.servo][1].stall_torque_nm
        if abs(lever) > 1e-6:
            limit = min(limit, (stall - math.copysign(1.0, lever) * hold) / abs(lever))
    assert 2.0 < limit < 10.0
    asked = {"mission.task.pose": pose, "mission.task.force_n": limit + 0.02}
    refused = plan(Setup(load_description("sensor-install", sets=asked)))
    assert not refused.feasible and f"at {limit:.2g} N the servo of left_" in str(
        refused.blocked_by
    )
    asked["mission.task.force_n"] = limit - 0.02
    assert plan(Setup(load_description("sensor-install", sets=asked))).feasible


def test_what_is_in_the_way_is_flown_around_or_named() -> None:
    """A lamp that hangs on the way to the pipe; a crate that leaves no room at the start."""
    way = plan(Setup(DESCRIPTION)).way
    assert len(way.to_far.p_WB) == 2 == len(way.to_below.p_WB)  # straight where that is free

    def put(p: np.ndarray, size: float) -> Description:
        x, y, z = (float(v) for v in p)
        box = Box(x_m=x, y_m=y, z_m=z, size_x_m=size, size_y_m=size, size_z_m=size)
        world = DESCRIPTION.world.add_thing("lamp", box)
        return DESCRIPTION._replace(world=world)

    d = put((way.p_far + way.p_below) / 2 + [0.0, 0.0, 0.15], 0.08)
    found = plan(Setup(d))
    there = found.way.to_below
    assert found.feasible and len(there.p_WB) > 2
    np.testing.assert_allclose(there.p_WB[[0, -1]], [way.p_far, way.p_below], atol=1e-9)
    query = build_clearance(build_scene(d.robot, d.world), with_ground=True)
    for a, b, yaw, q in zip(there.p_WB, there.p_WB[1:], there.yaw[1:], there.q[1:], strict=False):
        room, _ = check_line(query, a, b, rot_z(yaw), q)  # by other code than the planner's
        assert room > DESCRIPTION.mission.task.way_clearance_m - 0.005
    refused = plan(Setup(put(way.home, 0.3)))
    assert not refused.feasible and " and lamp overlap; required" in str(refused.blocked_by)


def test_the_swing_frequency_is_that_of_the_hanging_link() -> None:
    """Against the mass matrix: the pinned pendulum's w^2 = m g l / I."""
    d = DESCRIPTION
    model = build_body_model(d.robot)
    q = build_pose(d.robot, "L", 0.1)
    slow, fast = (compute_swing_frequency(model, q, g) for g in (9.81, 4.0 * 9.81))
    assert 2.5 < slow < 4.0 and fast == pytest.approx(2.0 * slow)
    other = load_description("waypoints", robot="bimanual").robot
    assert compute_swing_frequency(build_body_model(other), q[1:], 9.81) == 0.0


@given(rate=st.sampled_from([100.0, 125.0, 200.0, 250.0, 500.0, 1000.0]))
def test_the_servos_period_is_the_nearest_and_of_two_the_longer(rate: float) -> None:
    control = DESCRIPTION.robot.control.model_copy(update={"rate_hz": rate})
    n = count_command_ticks(DESCRIPTION.robot.model_copy(update={"control": control}))
    misses = {k: abs(k / rate - 0.02) for k in range(1, 30)}
    assert misses[n] == pytest.approx(min(misses.values()))
    assert misses[n + 1] > misses[n] + 1e-9


@pytest.mark.parametrize("late", ["world.link.delay_s=0.01", "robot.control.rate_hz=125"])
def test_a_roll_loop_too_slow_to_balance_on_the_link_is_refused(late: str) -> None:
    with pytest.raises(InputError, match=r"to take off from the end of its link .* requires 3\.2"):
        build_vehicle(load_description("sensor-install", sets=[late]), lambda _: None)
    told = plan_mission(load_description("sensor-install", sets=[late]))
    assert not told.feasible and "requires 3.2" in str(told.blocked_by)


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("mission.task.hover_s=1e9", "at most 3600"),
        ("mission.task.hand_speed_mps=9", "at most 0.5"),
        ("mission.task.pose=bent", "'stretched'"),
        ("robot.pendulum.z_m=1e9", "at most 100"),
        ("robot.pendulum.length_m=1e-9", "at least 1e-06"),
        ("robot.pendulum.parent=gear", "cannot have a parent"),
        ("robot.pendulum.flex_stiffness_nm_per_rad=100", "no joint spring"),
        ("robot.control.position_bandwidth_rad_s=1e-9", "at least 0.001"),
        ("robot.arm.elbow_pitch_servo.command_period_s=9", "at most 1"),
        ("world.things.tape.hand=third", "'right'"),
    ],
)
def test_sizes_that_no_robot_has_are_refused(key: str, told: str) -> None:
    """Some would end in an array of gigabytes, or in MuJoCo's own error."""
    with pytest.raises(InputError, match=told):
        load_description("sensor-install", sets=[key])
