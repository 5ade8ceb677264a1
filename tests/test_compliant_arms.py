"""Control of compliant arms on a clamped platform: loops, lines, forces, and what limits them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench import HEIGHT, L_POSE, Bench
from skywright.errors import InputError
from skywright.evidence.force_estimators import measure
from skywright.models.bimanual import (
    Bar,
    compute_bar,
    compute_bar_hands,
    compute_squeeze,
    estimate_platform,
    is_unplugged,
)
from skywright.models.compliant_arms import find_hands
from skywright.models.springs import spring_deflection, spring_torque
from skywright.vehicle.arms.ports import ArmModel, Hands, HandState, Marker, MarkerImage
from skywright.vehicle.arms.servo_profile import update_at_middle
from skywright.vehicle.arms.view import ArmsMemory

HAND = np.array([0.25, 0.15, HEIGHT - 0.11 - 0.25])  # left, in the L pose
UP, FORWARD = np.array([0.0, 0.0, 2.0]), np.array([2.0, 0.0, 0.0])
CEILING = [((HAND[0], HAND[1], HAND[2] + 0.07), (0.3, 0.2, 0.1))]  # 2 cm above the hand
WALL = [((HAND[0] + 0.06, HAND[1], HAND[2]), (0.1, 0.2, 0.3))]  # 1 cm before it
point = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


# --- identities ------------------------------------------------------------------------------


@given(st.floats(-2.0, 2.0), st.floats(-0.2, 0.2), st.floats(-2.0, 2.0))
def test_a_profile_updated_at_its_middle_arrives_after_two_updates(x, w, goal):
    for _ in range(2):
        x, w = update_at_middle(x, w, goal)
    assert x == pytest.approx(goal, abs=1e-12) and w == pytest.approx(0.0, abs=1e-12)


def test_a_moving_goal_is_followed_one_and_a_half_periods_late():
    x, w, step = 0.0, 0.0, 0.01
    for k in range(10):
        goal = step * k
        late = goal - x
        x, w = update_at_middle(x, w, goal)
    assert late == pytest.approx(1.5 * step, abs=1e-15)


@given(st.floats(0.5, 3.0), st.floats(0.0, 0.3), st.floats(1.0, 10.0), st.floats(-3.0, 3.0))
def test_spring_deflection_inverts_the_torque(k, linear, hardening, torque):
    deflection = spring_deflection(k, linear, hardening, torque)
    assert spring_torque(k, linear, hardening, deflection) == pytest.approx(torque, abs=1e-12)


@given(point, point, st.floats(0.05, 1.0))
def test_bar_and_hands_are_inverse(p, n, width):
    if np.linalg.norm(n) < 1e-3:
        return
    left, right = compute_bar_hands(Bar(p, n), width)
    bar = compute_bar(left, right)
    np.testing.assert_allclose(bar.p, p, atol=1e-12)
    np.testing.assert_allclose(bar.n, n / np.linalg.norm(n), atol=1e-9)
    assert np.linalg.norm(left - right) == pytest.approx(width)


def test_squeeze_is_inward_and_balanced():
    left, right = np.array([0.3, 0.2, 0.0]), np.array([0.3, -0.1, 0.1])
    f_left, f_right = compute_squeeze(5.0, left, right)
    np.testing.assert_allclose(f_left + f_right, 0.0, atol=1e-15)
    assert f_left @ (right - left) > 0.0 and np.linalg.norm(f_left) == pytest.approx(5.0)
    with pytest.raises(InputError, match="direction of the bar is undefined"):
        compute_squeeze(5.0, left, left)


def test_unplugging_is_a_distance():
    grasp = np.array([0.3, 0.0, 1.0])
    assert not is_unplugged(grasp, grasp + [0.0, 0.0199, 0.0], 0.02)
    assert is_unplugged(grasp, grasp + [0.0, 0.0, -0.0201], 0.02)


# --- on the bench ----------------------------------------------------------------------------


def test_a_hand_goes_straight_and_stays_where_it_was_sent():
    """(23): on the line from start to goal, at the speed asked for, and exact at its end."""
    b = Bench()
    b.wait(4.0)
    start = b.wait(0.1)["left_p_WH"][-1]
    goal = HAND + [0.06, 0.02, 0.08]
    b.arms.hands_to({"left": goal}, speed=0.05)
    rows = b.wait(7.0)
    p = rows["left_p_WH"]
    assert np.linalg.norm(p[-100:].mean(axis=0) - goal) < 0.004  # encoders of 0.33 and 0.2 deg
    way = (goal - start) / np.linalg.norm(goal - start)
    off = (p - start) - np.outer((p - start) @ way, way)
    assert np.max(np.linalg.norm(off, axis=1)) < 0.012  # the springs ring a little
    middle = (p - start) @ way
    half = 0.5 * np.linalg.norm(goal - start)
    assert rows["t"][np.argmax(middle > half)] - rows["t"][0] == pytest.approx(
        half / 0.05, abs=0.25
    )
    # velocity law (24), both hands with one order
    b.arms.hands_velocity({"left": np.array([0.0, 0.03, 0.0]), "right": np.array([0.0, 0.03, 0.0])})
    before = b.wait(1.0)
    after = b.wait(1.0)
    for side in ("left", "right"):
        moved = after[f"{side}_p_WH"].mean(axis=0) - before[f"{side}_p_WH"].mean(axis=0)
        np.testing.assert_allclose(moved, [0.0, 0.03, 0.0], atol=0.008)


def test_a_hand_comes_to_rest_where_its_lead_ends_out_of_reach():
    """The way in the servos' lag, 13 mm at 0.15 m/s, is more than a bent arm has left here."""
    b = Bench()
    shoulder = np.array([0.0, 0.15, HEIGHT - 0.11])
    goal = shoulder + 0.495 * np.array([math.cos(0.3), 0.0, -math.sin(0.3)])
    b.arms.hands_to({"left": goal}, speed=0.15)
    rows = b.wait(6.0)
    np.testing.assert_allclose(b.v.read(HandState).p_ref[0], goal, atol=1e-9)
    assert np.linalg.norm(rows["left_p_WH"][-50:].mean(axis=0) - goal) < 0.006


def test_an_arm_at_its_limit_is_held_against_its_weight():
    """The shaft leads the output link by the spring's deflection, beyond the link's limit."""
    pose = np.tile(np.radians([-88.0, 0.0, 0.0, 0.0]), 2)
    rows = Bench(q=pose).wait(3.0)
    assert np.degrees(rows["theta"][-1, 0]) < -98.0
    assert np.degrees(rows["q"][-50:, 0].mean()) == pytest.approx(-88.0, abs=0.8)


@pytest.mark.parametrize("load", [4.0, 8.0])
def test_a_heavy_load_is_known_without_encoders(load):
    """Springs that only the model of the weight tells of; hanging, its stiffness exceeds theirs.

    D = spring^-1(t(theta - D)) taken over whole swings by 0.2 m at 4 N and 0.5 m at 8 N.
    """
    b = Bench(q=np.tile(np.radians([-10.0, 2.0, 0.0, -20.0]), 2))
    row = b.v.reference
    row["load"] = load
    b.v.track(np.array([row]))
    for h in range(2):
        b.v.devices.helper.push(f"hand{h}", np.array([0.0, 0.0, -load]))
    rows = b.wait(6.0)[-100:]
    assert not np.any(b.v.read(ArmModel).sensed[[1, 2, *range(4, 8)]])
    for side in ("left", "right"):
        off = (rows[f"{side}_p_WH"] - rows[f"{side}_est_p_WH"]).mean(axis=0)
        assert np.linalg.norm(off) < 0.008  # zeros of the shafts, a mass 2 % beside the model's
        assert np.ptp(rows[f"{side}_est_p_WH"], axis=0).max() < 0.008


@pytest.mark.parametrize(("zero", "longer"), [(0.0, 0.0), (0.4, 0.0), (0.4, 0.004)])
def test_a_hand_is_off_by_zeros_and_lengths_and_by_nothing_else(zero, longer):
    """With the long reach, whose link of 0.8 m makes 6 mm of 0.4 deg."""
    sets = [f"plant.joint_offset_error_deg={zero}", f"plant.link_length_error_m={longer}"]
    b = Bench("bimanual-longreach", sets)
    model, n = b.v.model, b.v.n_joints
    nominal = np.concatenate([[0.0], np.tile(L_POSE, 2)])
    b.arms.hands_to({"left": find_hands(model, nominal)[0] + [0.0, 0.0, HEIGHT]})
    rows = b.wait(8.0)[-300:]
    q = rows["q"][:, :n].mean(axis=0)
    believed, real = (find_hands(model, x)[0] for x in (q + math.radians(zero), q))
    real[2] -= longer  # the upper arm hangs
    off = (rows["left_p_WH"] - rows["left_est_p_WH"]).mean(axis=0)
    expected = real - believed
    np.testing.assert_allclose(off[[0, 2]], expected[[0, 2]], atol=0.0015)
    assert np.linalg.norm(expected) >= 1.1 * math.radians(zero)  # levers of link and arm


def test_a_goal_out_of_reach_is_noticed_and_does_not_wind_up():
    b = Bench()
    b.arms.hands_to({"left": HAND + [0.6, 0.0, 0.0]}, speed=0.15)
    b.wait(3.0)
    assert b.v.read(HandState).saturated[0] == 1.0
    shoulder = np.array([0.0, 0.15, HEIGHT - 0.11])
    # the clamp gives way
    assert (
        np.linalg.norm(b.v.read(HandState).p_ref[0] - shoulder) <= 0.5 + 1e-4
    )  # the clamp gives way
    b.arms.hands_to({"left": HAND}, speed=0.15)
    rows = b.wait(4.0)
    assert b.v.read(HandState).saturated[0] == 0.0
    assert np.linalg.norm(rows["left_p_WH"][-50:].mean(axis=0) - HAND) < 0.01


@pytest.mark.parametrize(("force", "boxes", "within"), [(UP, CEILING, 0.1), (FORWARD, WALL, 0.1)])
def test_the_true_force_comes_to_its_reference(force, boxes, within):
    """Torques less the gravity model: 2 N within the encoders' accuracy (0.2 deg is 0.05 N)."""
    b = Bench(boxes=boxes)
    b.arms.push({"left": force})
    b.wait(4.0)
    rows = b.wait(3.0)
    n = force / 2.0
    true = rows["left_f_W"] @ n
    assert abs(true.mean() - 2.0) < within
    assert np.sqrt(np.mean((true - 2.0) ** 2)) < 0.15
    assert abs((rows["left_est_f_W"] @ n).mean() - 2.0) < 0.02  # what the loop sees is exact


def test_the_estimators_compared_in_one_table():
    """The study's trials: torques are right in the L pose, and said to be unsure when stretched."""
    right = measure("L", "up", "torque", tare=True)
    assert abs(right.true_mean_n - 2.0) < 0.1 and right.rms_error_n < 0.15
    printed = measure("L", "up", "cartesian", tare=False)
    assert abs(printed.estimated_mean_n - 2.0) < 0.05 and printed.rms_error_n > 0.4
    stretched = measure("stretched", "forward", "torque", tare=False)
    assert stretched.lever_m < 0.1  # where the notice comes


def test_the_printed_estimator_reads_the_arm_s_weight_as_a_force():
    """(26) has no gravity term: the loop settles on its reading, the true force falls short."""
    b = Bench(boxes=CEILING, sets=["robot.control.force_estimator=cartesian"])
    b.arms.push({"left": UP})
    b.wait(5.0)
    rows = b.wait(2.0)
    assert abs(rows["left_est_f_W"][:, 2].mean() - 2.0) < 0.05
    assert rows["left_f_W"][:, 2].mean() < 1.5


def test_torque_loop_settles_on_its_reference_without_the_integral():
    """(14)-(22), delta = 0: the printed loop integrates by itself (E000-11)."""
    b = Bench(boxes=CEILING)
    b.arms.push({"left": UP})
    b.wait(5.0)
    arm = b.v.read(ArmModel)
    b.v.assembly.get(ArmsMemory, "arms_law")["ki_torque"] = 0.0
    wanted = np.array([0.0, 0.0, 0.0, -0.6])
    delta = np.array([1.0, 1.0, 1.0, 0.0])
    b.arms.torques("left", wanted, delta)
    b.wait(3.0)
    rows = b.wait(1.0)
    k, linear, hard = (float(x[3]) for x in (arm.k, arm.linear, arm.hardening))
    torque = np.mean([spring_torque(k, linear, hard, x) for x in rows["deflection"][:, 3]])
    lsb = math.radians(0.325) * k * hard
    assert torque == pytest.approx(-0.6, abs=1.5 * lsb + hard * k * math.radians(0.35))


def test_position_loop_brings_the_output_link_back():
    """(20)-(22), delta = 1: a weight winds the springs, the output links return to their place."""
    b = Bench()
    b.arms.torques("left", np.zeros(4), np.ones(4))
    b.wait(2.0)
    before = b.wait(0.5)
    b.v.devices.helper.push("hand0", np.array([0.0, 0.0, -1.0]))
    sagged = b.wait(1.0)
    b.wait(10.0)
    after = b.wait(0.5)

    def change(rows, field):
        mean = [part[field][:, [0, 3]].mean(axis=0) for part in (before, rows)]
        return np.degrees(mean[1] - mean[0])

    assert np.all(np.abs(change(sagged, "q")) > 2.0)
    assert np.all(np.abs(change(after, "deflection")) > 2.0)  # the weight is still there
    assert np.all(np.abs(change(after, "q")) < 1.5)  # commands and readings of 0.33 deg


def test_integrals_stop_where_a_limit_holds_the_command():
    """4 N m that nothing resists drive the elbow to its end: the integral of (19) does not grow."""
    b = Bench()
    delta = np.array([1.0, 1.0, 1.0, 0.0])
    b.arms.torques("left", np.array([0.0, 0.0, 0.0, -4.0]), delta)
    b.wait(2.0)
    wound = float(b.v.read(ArmsMemory, "arms_law").i_torque[3])
    b.wait(2.0)
    law = b.v.read(ArmsMemory, "arms_law")
    growth = float(law.ki_torque / b.v.read(ArmModel).k[3] * 4.0 * 2.0)  # rad, unbounded
    assert abs(float(law.i_torque[3]) - wound) < 0.02 * growth


def test_a_force_that_nothing_resists_ends_at_the_limits():
    """Without a contact the springs are wound no further than shafts may lead their links."""
    b = Bench()
    b.arms.push({"left": UP})
    b.wait(12.0)
    wound = b.v.read(ArmsMemory, "arms_law").wind.copy()
    assert b.v.read(HandState).saturated[0] == 1.0
    b.wait(2.0)
    assert np.max(np.abs(b.v.read(ArmsMemory, "arms_law").wind - wound)) < math.radians(3.0)
    b.arms.hands_to({"left": HAND})  # the springs are let out, nothing leaps
    b.wait(6.0)
    assert np.max(np.abs(b.v.read(ArmsMemory, "arms_law").wind)) < 1e-3
    assert np.linalg.norm(b.wait(0.5)["left_p_WH"].mean(axis=0) - HAND) < 0.01


def test_position_and_force_together():
    """(31): the hand slides along the ceiling to its goal while it presses."""
    b = Bench(boxes=CEILING, sets=["robot.arm.hand.friction=0.1"])
    b.arms.push({"left": UP})
    b.wait(3.0)
    goal = np.array([HAND[0] + 0.05, HAND[1], HAND[2] + 0.005])  # the pad is 15 mm thick
    b.arms.push({"left": UP}, at={"left": goal}, gamma=0.5)
    b.wait(5.0)
    rows = b.wait(2.0)
    assert abs(rows["left_p_WH"][:, 0].mean() - goal[0]) < 0.006
    assert abs(rows["left_f_W"][:, 2].mean() - 2.0) < 0.35


def test_the_singularity_is_noticed_and_the_platform_told_where_to_go():
    b = Bench()
    assert np.all(b.arms.platform_shift("left") == 0.0)
    b.arms.hands_to({"left": np.array([0.49, 0.15, HEIGHT - 0.11])}, speed=0.2)
    b.wait(5.0)
    assert b.v.read(HandState).singular[0] == 1.0
    shift = b.arms.platform_shift("left")
    # along the arm, by what brings the elbow to a right angle
    np.testing.assert_allclose(shift, [0.49 - 0.25 * math.sqrt(2.0), 0.0, 0.0], atol=0.02)
    b.v.devices.bench.move(np.array([0.0, 0.0, HEIGHT]) + shift)
    b.wait(3.0)
    assert b.v.read(HandState).singular[0] == 0.0
    elbow = b.wait(0.5)["q"][-1][3]
    assert abs(abs(elbow) - math.pi / 2) < math.radians(15)


def test_an_arm_tells_where_the_platform_is():
    """Section V-E: FK of a hand that holds a fixed point gives the platform's position."""
    b = Bench()
    rows = b.wait(3.0)
    p = estimate_platform(rows["left_p_WH"][-1], np.eye(3), b.v.read(Hands).p_BH[0])
    np.testing.assert_allclose(p, [0.0, 0.0, HEIGHT], atol=0.006)


def test_orders_that_cannot_be():
    b = Bench(q=np.tile(L_POSE, 2))
    with pytest.raises(InputError, match="'middle' is unknown; valid: left, right"):
        b.arms.hands_to({"middle": HAND})
    with pytest.raises(InputError, match="3 finite numbers"):
        b.arms.push({"left": np.array([0.0, np.inf, 0.0])})
    b.v.assembly.get(ArmModel)["sensed"] = 0.0
    with pytest.raises(InputError, match="cannot control a force"):
        b.arms.push({"right": UP})


MARKER = "[world.things.marker]\nkind = 'marker'\nx_m = 0.6\ny_m = 0.0\nz_m = 1.1\n"
CAMERA = ["robot.camera.x_m=0.1", "robot.camera.z_m=-0.1", "robot.camera.pitch_deg=30"]
PLACE = np.array([-0.1, 0.0, 0.25])  # 25 cm before the marker, to the left of it


@pytest.mark.parametrize("sets", [CAMERA, []])
def test_a_hand_is_led_to_a_marker(sets):
    """Visual servoing by the camera, and by motion capture where there is none."""
    b = Bench(sets=sets, more=MARKER)
    b.wait(0.5)
    b.arms.hands_to_marker({"left": PLACE}, speed=0.1)
    b.wait(4.0)
    rows = b.wait(2.0)
    assert b.v.read(Marker).age < 0.2
    goal = [0.6 - 0.25, 0.1, 1.1]
    assert np.linalg.norm(rows["left_p_WH"].mean(axis=0) - goal) < 0.006


def test_a_marker_out_of_sight_moves_no_hand():
    b = Bench(sets=[*CAMERA, "robot.camera.yaw_deg=120"], more=MARKER)
    b.wait(1.0)
    before = b.wait(0.5)["left_p_WH"].mean(axis=0)
    b.arms.hands_to_marker({"left": PLACE}, speed=0.1)
    b.wait(1.0)
    assert b.v.read(Marker).age > 100.0
    assert np.linalg.norm(b.wait(0.5)["left_p_WH"].mean(axis=0) - before) < 0.004


def test_the_camera_s_noise_is_what_its_keys_say():
    sets = [
        "robot.camera.range_noise_fraction=0.01", "robot.camera.attitude_noise_rad=0.02",
        "plant.sensor_noise_error=0",
    ]  # fmt: skip
    b = Bench(sets=[*CAMERA, *sets], more=MARKER)
    p, R = [], []
    for _ in range(400):
        b.v.tick()
        p.append(b.v.read(MarkerImage).p_BM)
        R.append(b.v.read(MarkerImage).R_BM)
    p, fresh = np.array(p), np.diff(np.array(p)[:, 0], prepend=-1.0) != 0.0
    p = p[fresh] - [0.1, 0.0, -0.1]  # from the camera
    assert 150 < len(p) < 260  # 30 Hz over 8 s
    true = np.array([0.5, 0.0, 1.1 - HEIGHT + 0.1])
    distance = np.linalg.norm(true)
    assert np.std(np.linalg.norm(p, axis=1)) == pytest.approx(0.01 * distance, rel=0.2)
    assert np.std(p[:, 1]) == pytest.approx(0.001 * distance, rel=0.25)
    np.testing.assert_allclose(p.mean(axis=0), true, atol=0.002)
    with pytest.raises(
        InputError, match=r"marker.on = 'box' is not a thing of this world; valid: bench"
    ):
        Bench(more=MARKER + 'on = "box"\n')
