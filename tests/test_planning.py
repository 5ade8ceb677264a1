"""The planner: its dynamics against MuJoCo, its rows against themselves, its refusals."""

from __future__ import annotations

import itertools
import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exact_map import EXACT
from skywright.core.rotations import exp_so3, quat_from_rot
from skywright.core.types import MAX_JOINTS, REFERENCE
from skywright.description.loader import load_description
from skywright.description.world.spec import Area, World
from skywright.description.world.surface import build_cylinder, unroll_points
from skywright.errors import InputError
from skywright.missions.bar_transport.plan import drop_bar
from skywright.missions.scan import plan as scan_kind
from skywright.models.body_records import Kinematics
from skywright.models.geometry import build_clearance, compute_clearance
from skywright.models.link_motion import build_motion
from skywright.models.rigid_body import build_body_model, compute_tip, fill_kinematics
from skywright.models.scene import build_scene, set_pose
from skywright.models.things.box import Box
from skywright.planning.inverse_dynamics import compute_wrench
from skywright.planning.motion import transport_plan
from skywright.planning.motion.planner import plan_path
from skywright.planning.motion.swing import compute_period as compute_swing_period
from skywright.planning.motion.timing import TimeLimits
from skywright.planning.motion.transport import Transport, build_transport
from skywright.planning.motion.transport_plan import build_swing_model, plan_transport
from skywright.planning.patterns import build_pattern, build_time_law, eval_time_law
from skywright.planning.scan import ScanPlan
from skywright.run.flight import Flight, Flown
from skywright.run.localisation_limit import compute_longest_period
from skywright.run.planning import MissionPlan, plan_mission
from skywright.run.run import _evaluate
from skywright.run.setup import Setup
from skywright.vehicle.sensor_flight import CALIBRATION_SPEED

SCAN_SEGMENTS = ["approach", "unfold", "close_in", "touch", "scan", "leave", "fold", "return"]


def plan(
    *sets: str, seed: int | None = None, mission: str = "pipe-weld-scan", robot: str | None = None
) -> MissionPlan:
    exact = EXACT if mission == "pipe-weld-scan" else ()
    return plan_mission(load_description(mission, robot, sets=[*exact, *sets], seed=seed))


@pytest.fixture(scope="module")
def default() -> MissionPlan:
    return plan()


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> list[ScanPlan]:
    """What the planner of scans returned, call by call: a mission keeps only a part of it."""
    kept: list[ScanPlan] = []
    search = scan_kind.plan_scan

    def keep(*args: Any, **kwargs: Any) -> ScanPlan:
        kept.append(search(*args, **kwargs))
        return kept[-1]

    monkeypatch.setattr(scan_kind, "plan_scan", keep)
    return kept


# patterns and time law ---------------------------------------------------------------------------


def test_raster_has_two_corners_a_pass() -> None:
    corners = build_pattern("raster", 0.2, 0.25).corners
    assert corners.shape == (8, 2)
    assert np.ptp(corners[:, 0]) == pytest.approx(0.2)
    assert np.degrees(np.ptp(corners[:, 1])) == pytest.approx(40.0)
    moves = np.diff(corners, axis=0)
    assert np.all((moves == 0).sum(axis=1) == 1)  # along the axis or along the arc, never both


@pytest.mark.parametrize(("kind", "count"), [("line", 2), ("spiral", 5)])
def test_other_patterns(kind: str, count: int) -> None:
    found = build_pattern(kind, 0.2, 0.25, centre_phi=1.0)
    assert found.blocked_by is None and len(found.corners) == count
    assert found.corners[:, 1].mean() == pytest.approx(1.0, abs=0.2)


def test_impossible_patterns_are_refused_with_numbers() -> None:
    thin = build_pattern("raster", 0.025, 0.25)
    assert thin.blocked_by is not None and "5.8 mm apart" in thin.blocked_by
    long = build_pattern("raster", 0.2, 0.25, pass_length=0.6)
    assert long.blocked_by is not None and "reach" in long.blocked_by


@given(
    st.floats(1e-4, 5.0), st.floats(0.005, 1.0), st.floats(0.05, 2.0), st.sampled_from([0.0, 1.0])
)
@settings(max_examples=80)
def test_time_law_rests_at_both_ends_within_limits(length, speed, acceleration, ramp) -> None:
    law = build_time_law(length, speed, acceleration, ramp)
    assert law.duration / 0.02 == pytest.approx(round(law.duration / 0.02), abs=1e-6)
    t = np.linspace(0.0, law.duration, 400)
    x, v, a = (np.array(c) for c in zip(*(eval_time_law(law, ti) for ti in t), strict=True))
    assert x[0] == v[0] == a[0] == 0.0
    assert x[-1] == pytest.approx(length) and v[-1] == a[-1] == 0.0
    assert v.max() <= speed * (1 + 1e-9) and np.abs(a).max() <= acceleration * (1 + 1e-6)
    step = t[1] - t[0]
    curvature = 30.0 * law.speed / law.ramp**2  # bound of the third derivative
    assert np.abs(np.gradient(x, step) - v)[1:-1].max() < curvature * step**2
    assert np.all(np.diff(x) >= -1e-12)


# dynamics ----------------------------------------------------------------------------------------


@given(st.integers(0, 10_000))
@settings(max_examples=40)
def test_wrench_is_mujoco_inverse_dynamics(nominal, seed: int) -> None:
    """Force and torque about B of a random motion with a force at the tip."""
    scene, model = nominal
    rng = np.random.default_rng(seed)
    data = mujoco.MjData(scene.model)
    R = np.empty((3, 3))
    exp_so3(rng.normal(size=3), R)
    q, qd, qdd = rng.normal(size=(3, 2))
    w, wd, a, f_tip = rng.normal(size=(4, 3))
    set_pose(scene, data, rng.normal(size=3), quat_from_rot(R), q)
    data.qvel[:3], data.qvel[3:6] = rng.normal(size=3), w  # free joint: angular velocity in B
    data.qvel[scene.places.joint_dof] = qd
    data.qacc[:3], data.qacc[3:6] = a, wd
    data.qacc[scene.places.joint_dof] = qdd
    mujoco.mj_inverse(scene.model, data)
    J = np.zeros((3, scene.model.nv))
    mujoco.mj_jacSite(scene.model, data, J, None, scene.places.tip_site)
    needed = data.qfrc_inverse - J.T @ f_tip
    k, f, t = np.zeros(1, Kinematics.dtype), np.zeros(3), np.zeros(3)
    full = np.zeros((3, MAX_JOINTS))
    full[:, :2] = q, qd, qdd
    fill_kinematics(model[0], full[0], k[0])
    compute_wrench(model[0], k[0], R, w, wd, a, full[1], full[2], f_tip, build_motion(), f, t)
    np.testing.assert_allclose(R @ f, needed[:3], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(t, needed[3:6], rtol=1e-6, atol=1e-6)


@pytest.fixture(scope="module")
def nominal():
    d = load_description("pipe-weld-scan")
    scene = build_scene(d.robot, d.world)
    scene.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # random poses
    gear = scene.model.body("gear").id  # its feet weigh a few grams in the scene only
    scene.model.body_mass[gear] = 0.0
    scene.model.body_inertia[gear] = 0.0
    mujoco.mj_setConst(scene.model, mujoco.MjData(scene.model))
    return scene, build_body_model(d.robot)


# the plan ----------------------------------------------------------------------------------------


def test_default_plan_has_all_segments_and_about_110_s_of_contact(default: MissionPlan) -> None:
    assert default.feasible and default.blocked_by is None
    assert list(default.segments) == SCAN_SEGMENTS
    contact = default.segments["scan"]["t"][-1] + default.segments["touch"]["t"][-1]
    assert 100.0 < contact < 120.0
    assert default.duration_s == pytest.approx(
        sum(rows["t"][-1] for rows in default.segments.values())
    )
    assert set(default.to_json()) == {
        "feasible", "blocked_by", "plan_s", "duration_s", "flight_s", "min_clearance_m",
        "min_rotor_margin", "need",
        "metrics",
    }  # fmt: skip


def test_segments_rest_at_their_ends_and_join(default: MissionPlan) -> None:
    last = None
    for name, rows in default.segments.items():
        assert rows.dtype == REFERENCE
        np.testing.assert_allclose(np.diff(rows["t"]), 0.02, atol=1e-9, err_msg=name)
        assert rows["t"][0] == 0.0
        for end in (rows[0], rows[-1]):
            for field in ("v_WB", "w_WB_B", "qd", "v_WT"):
                np.testing.assert_allclose(end[field], 0.0, atol=1e-4, err_msg=name)
        if last is not None:
            for field in ("p_WB", "R_WB", "q", "p_WT", "R_WT"):
                np.testing.assert_allclose(rows[0][field], last[field], atol=2e-5, err_msg=name)
        last = rows[-1]
        assert all(np.isfinite(rows[f]).all() for f in REFERENCE.names)
        assert np.all(rows["active"] == 1.0)


def test_rates_are_the_derivatives_of_positions(default: MissionPlan) -> None:
    for name, rows in default.segments.items():
        for x, v in (("p_WB", "v_WB"), ("q", "qd"), ("p_WT", "v_WT"), ("v_WB", "a_WB")):
            slope = (rows[x][2:] - rows[x][:-2]) / 0.04
            away = np.abs(slope - rows[v][1:-1]).max()
            assert away < 0.01 + 0.02 * np.abs(rows[v]).max(), (name, x)
        # dR/dt = R [w]
        dR = (rows["R_WB"][2:] - rows["R_WB"][:-2]) / 0.04
        W = np.einsum("nji,njk->nik", rows["R_WB"][1:-1], dR)
        w = np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=1)
        np.testing.assert_allclose(w, rows["w_WB_B"][1:-1], atol=2e-3, err_msg=name)


def test_tip_is_that_of_the_nominal_kinematics(default: MissionPlan) -> None:
    model = build_body_model(load_description("pipe-weld-scan").robot)
    for rows in default.segments.values():
        for row in rows[::97]:
            p_BT, R_BT = compute_tip(model, row["q"][:2])
            np.testing.assert_allclose(row["R_WT"], row["R_WB"] @ R_BT, atol=1e-9)
            np.testing.assert_allclose(row["p_WT"], row["p_WB"] + row["R_WB"] @ p_BT, atol=1e-9)


@pytest.mark.parametrize("sets", [(), ("world.pipe.inclination_deg=-30", "world.pipe.yaw_deg=200")])
def test_tip_stays_on_its_surface_while_scanning(
    sets: tuple[str, ...], searches: list[ScanPlan]
) -> None:
    found = plan(*sets)
    assert found.feasible and found.way is not None
    way, corners = found.get_way(), searches[-1].corners_sphi
    cyl = build_cylinder(load_description("pipe-weld-scan", sets=sets).world.pipe)
    rows = found.segments["scan"]
    for row, (s, phi) in zip(rows[::53], way.path_sphi[::53], strict=True):
        along, around, gap = (float(x[0]) for x in unroll_points(cyl, row["p_WT"][None]))
        assert gap == pytest.approx(-way.depth_m, abs=2e-4)
        assert (along, around / cyl.radius) == pytest.approx((s, phi), abs=1e-9)
        assert row["R_WT"][:, 2] @ row["R_WS"][:, 2] == pytest.approx(-1.0, abs=1e-5)
        assert row["dead_zone"] > way.depth_m and row["track_tip"] == 1.0
    # every via-point is visited
    assert len(corners) == 8
    for s, phi in corners:
        away = np.hypot(way.path_sphi[:, 0] - s, 0.2 * (way.path_sphi[:, 1] - phi))
        assert away.min() < 2e-4
    touch = found.segments["touch"]
    outside = unroll_points(cyl, touch["p_WT"])[2] > 1e-4
    assert np.all(touch["dead_zone"][outside] == 0.0) and touch["dead_zone"][-1] > 0.0
    assert np.linalg.norm(touch["v_WT"], axis=1).max() <= 0.02
    for name in ("approach", "unfold", "fold", "return"):
        assert np.all(found.segments[name]["track_tip"] == 0.0)
        assert np.all(found.segments[name]["R_WS"] == np.eye(3))


@pytest.mark.parametrize("sets", [(), ("world.pipe.yaw_deg=180", "world.pipe.inclination_deg=30")])
def test_limits_hold_along_the_whole_plan(sets: tuple[str, ...]) -> None:
    """Clearance, joints, speed and rotors, checked again row by row with other code."""
    d = load_description("pipe-weld-scan", sets=sets)
    found = plan_mission(d)
    assert found.feasible and found.way is not None
    scene = build_scene(d.robot, d.world)
    query, loads = build_clearance(scene), Setup(d).loads
    data = mujoco.MjData(scene.model)
    joints = [d.robot.arm.links[n] for n in ("link1", "link2")]
    for name, rows in found.segments.items():
        assert np.linalg.norm(rows["v_WB"], axis=1).max() <= d.robot.control.speed_max_mps * 1.01
        for j, link in enumerate(joints):
            angle = np.degrees(rows["q"][:, j])
            assert link.joint_min_deg - 0.01 <= angle.min()
            assert angle.max() <= link.joint_max_deg + 0.01
        near = name in ("close_in", "touch", "scan", "leave")
        for row in rows[::11]:
            gap = compute_clearance(query, row["p_WB"], row["R_WB"], row["q"][:2], near).distance
            assert gap > (0.028 if near else 0.048), name
            set_pose(scene, data, row["p_WB"], quat_from_rot(row["R_WB"]), row["q"][:2])
            data.qvel[:3], data.qvel[3:6] = row["v_WB"], row["w_WB_B"]
            data.qvel[scene.places.joint_dof] = row["qd"][:2]
            data.qacc[:] = 0.0
            data.qacc[:3], data.qacc[3:6] = row["a_WB"], row["wd_WB_B"]
            mujoco.mj_inverse(scene.model, data)
            J = np.zeros((3, scene.model.nv))
            mujoco.mj_jacSite(scene.model, data, J, None, scene.places.tip_site)
            push = found.get_way().push_force_n * row["R_WS"][:, 2] * (row["dead_zone"] > 0)
            need = data.qfrc_inverse - J.T @ push
            thrust = loads.P @ np.concatenate([row["R_WB"].T @ need[:3], need[3:6]])
            # the joints' accelerations are left out here: a little room
            assert np.all(thrust > loads.t_min - 0.3) and np.all(thrust < loads.t_max + 0.3), name


def test_twenty_seeds_find_a_plan() -> None:
    """Behind the pipe, where free flight needs the random tree."""
    sets = ("world.pipe.yaw_deg=180",)
    d = [load_description("pipe-weld-scan", sets=sets, seed=s) for s in range(20)]
    found = [plan_mission(x) for x in d]
    assert all(p.feasible for p in found), [p.blocked_by for p in found]
    again = plan_mission(d[3])
    for name, rows in again.segments.items():
        assert rows.tobytes() == found[3].segments[name].tobytes()  # same seed, same plan


@pytest.mark.parametrize(
    "sets",
    [
        ("world.pipe.diameter_m=0.3", "world.pipe.yaw_deg=90"),
        ("world.pipe.diameter_m=0.6", "world.pipe.yaw_deg=-120", "world.pipe.inclination_deg=30"),
        ("world.pipe.inclination_deg=90",),
        ('mission.task.side="top"',),
        ('mission.task.side="top"', "world.pipe.inclination_deg=30"),
        ('mission.task.side="underside"', "world.pipe.supports=false"),
        ('mission.task.pattern="line"',),
        ('mission.task.pattern="spiral"',),
        ('world.wind.kind="steady"', "world.wind.mean_mps=4", "world.wind.toward_deg=90"),
        ("world.pipe.z_m=0.7",),  # the arm is folded higher up: it would swing into the ground
        ("world.pipe.z_m=0.42",),  # it leaves level: away from the lower side lies the ground
    ],
)
def test_plans_over_the_promised_range(sets: tuple[str, ...]) -> None:
    found = plan(*sets)
    assert found.feasible, found.blocked_by
    lowest = min(float(rows["p_WB"][:, 2].min()) for rows in found.segments.values())
    assert lowest > 0.2 + 0.03  # the landing gear clears the ground
    assert found.min_clearance_m >= 0.03 and found.min_rotor_margin > 0.0


def test_a_localisation_slower_than_the_rules_bear_is_refused() -> None:
    def ask(mission: str, *sets: str) -> str:
        return str(plan_mission(load_description(mission, sets=[*sets])).blocked_by)

    slow = ask("wall-contact", "world.mocap.rate_hz=1")
    assert "every 1 s; the period must be below 0.2 s" in slow
    assert "(mission.faults.localisation_stale.limit), a rate above 5 Hz" in slow
    assert ask("wall-contact", "world.mocap.rate_hz=6") == "None"
    assert ask("waypoints", "world.mocap.rate_hz=1") == "None"  # nothing is touched
    rare = ask("waypoints", "world.mocap.rate_hz=0.5")
    assert "below 2 s (mission.faults.localisation_lost.limit)" in rare
    more = "mission.faults.localisation_lost.limit=3"
    assert ask("waypoints", "world.mocap.rate_hz=0.5", more) == "None"


def test_a_station_slower_than_the_clearance_bears_is_refused() -> None:
    """The longest period beside the variance of a filter that is stepped from fix to fix."""

    def ask(*sets: str) -> str:
        return str(plan_mission(load_description("bridge-contact", sets=[*sets])).blocked_by)

    d = load_description("bridge-contact")
    station, camera = d.world.total_station, d.robot.tracking_camera
    assert camera is not None
    period = compute_longest_period(station, camera, 0.01)
    walk = CALIBRATION_SPEED * camera.walk_m_per_sqrt_m**2 + camera.jump_m**2 / 60.0
    p, r = 1.0, station.range_noise_m**2
    for _ in range(1000):
        p = p * r / (p + r) + walk * period
    assert math.sqrt(p + walk * station.latency_mean_s) == pytest.approx(0.01, rel=1e-6)

    slow = ask("world.total_station.rate_mean_hz=1")
    assert "rate_mean_hz = 1 gives a position every 1 s" in slow
    assert "0.03 m (mission.surface_clearance_m): set a rate of at least 2 Hz" in slow
    assert ask(f"world.total_station.rate_mean_hz={1.01 / period}") == "None"
    late = ask("world.total_station.latency_mean_s=0.9")
    assert "set a shorter latency_mean_s" in late
    exact = ("world.total_station.range_noise_m=0", "world.total_station.pointing_noise_m=0")
    assert ask("world.total_station.latency_mean_s=0.9", *exact) == late


def test_a_noisy_gyroscope_is_told_with_the_noise_that_the_attitude_loop_bears() -> None:
    def ask(noise: float, *sets: str) -> str:
        key = f"robot.sensors.gyro_noise_rad_s_sqrthz={noise}"
        return str(plan_mission(load_description("waypoints", sets=[key, *sets])).blocked_by)

    told = ask(0.34)
    assert told.startswith("robot.sensors.gyro_noise_rad_s_sqrthz = 0.34: the attitude loop")
    most = float(told.split("at most ")[1].split(",")[0])
    assert ask(0.95 * most) == "None" and "mission.noise_sigmas" in ask(1.05 * most)
    assert ask(1.05 * most, "robot.control.attitude_bandwidth_rad_s=6") == "None"
    assert ask(1.9 * most, "mission.noise_sigmas=1.5") == "None"


@pytest.mark.parametrize(
    ("mission", "most"), [("bridge-contact", 0.027), ("bar-insertion", 0.0092)]
)
def test_a_noisy_gyroscope_is_told_of_laws_with_other_loops(mission: str, most: float) -> None:
    """Backstepping as a PID; the cascade's rate loop with its lead."""

    def ask(noise: float) -> str:
        key = f"robot.sensors.gyro_noise_rad_s_sqrthz={noise}"
        return str(plan_mission(load_description(mission, sets=[key])).blocked_by)

    assert f"at most {most:g}, or a lower bandwidth" in ask(1.1 * most)
    assert ask(0.9 * most) == "None"


def test_a_clearance_is_told_with_its_key() -> None:
    def ask(*sets: str) -> str:
        points = "mission.task.points=[{x_m=1.0, y_m=0.0, z_m=1.2}]"
        d = load_description("waypoints", sets=["mission.robot=ars-lrm", points, *sets])
        return str(plan_mission(d).blocked_by)

    assert re.search(
        r"start: .* and the ground are 0\.016 m apart; required distance: 0\.051 m "
        r"\(mission\.clearance_m\)",
        ask(),
    )
    assert ask("mission.clearance_m=0.01") == "None"
    told = str(plan("mission.surface_clearance_m=0.2").blocked_by)
    assert "m < 0.200 m (mission.surface_clearance_m)" in told


def test_the_distance_of_a_climb_is_told_with_its_key() -> None:
    def ask(*sets: str) -> str:
        start = ["mission.world=pipe", "mission.start_x_m=1.25", "mission.hover_height_m=2.5"]
        points = "mission.task.points=[{x_m=0.0, y_m=0.0, z_m=2.5}]"
        return str(
            plan_mission(load_description("waypoints", sets=[*start, points, *sets])).blocked_by
        )

    told = re.search(
        r"take-off and landing at \(1\.25, 0\.00\) m: propeller\d and pipe come within "
        r"(\d\.\d+) m at a height of "
        r"\d\.\d+ m; at least 0\.1 m \(mission\.climb_clearance_m\) are required",
        ask(),
    )
    assert told is not None and 0.0 < float(told[1]) < 0.1
    assert ask("mission.climb_clearance_m=0.02") == "None"
    with pytest.raises(
        InputError, match=r"mission\.climb_clearance_m is -1; it must be at least 0"
    ):
        ask("mission.climb_clearance_m=-1")


def test_a_soft_position_loop_is_told_before_what_its_depth_runs_into() -> None:
    found = plan("robot.control.position_bandwidth_rad_s=2.2")
    said = str(found.blocked_by)
    assert said.startswith(
        "the press is too deep: 2 N at 10.9 N/m (mass times "
        "robot.control.position_bandwidth_rad_s = 2.2 rad/s squared) require the desired tip "
        "184 mm inside the surface, where "
    )
    assert "with 20 mm the scan is possible: raise robot.control.position_bandwidth" in said
    arm = str(plan("mission.task.force_n=0.5", robot="f550-bridge").blocked_by)
    assert "propeller3 and pipe" in arm and "thin" not in arm and "depth" not in arm
    arm = str(plan(robot="f550-bridge").blocked_by)  # 222 mm deep: no depth helps this arm
    assert "propeller3 and pipe" in arm
    assert "also with the desired tip 20 mm inside the surface instead of 222 mm" in arm
    said = str(plan("mission.task.depth_m=0.15").blocked_by)
    assert re.match(r"mission\.task\.depth_m = 0\.15 m is too large, a push of [\d.]+ N at ", said)
    assert said.endswith("; lower mission.task.depth_m")


@pytest.mark.parametrize(
    ("sets", "reason"),
    [
        (("world.pipe.diameter_m=0.05",), "mm apart"),
        (("mission.task.pass_length_m=0.6",), "reach"),
        (("mission.task.depth_m=0.2",), "tip lies 200 mm inside"),
        (("mission.start_x_m=1.9", "mission.hover_height_m=1.5"), "platform and pipe"),
        (('mission.task.side="underside"',), "support"),  # propellers between the posts
        (("world.pipe.z_m=0.27",), "ground"),
        (
            ('world.wind.kind="steady"', "world.wind.mean_mps=9", "world.wind.toward_deg=90"),
            "rotor",
        ),
    ],
)
def test_impossible_requests_name_the_constraint(
    sets: tuple[str, ...], reason: str, searches: list[ScanPlan]
) -> None:
    found = plan(*sets)
    assert not found.feasible and found.segments == {}
    by_planner = searches[-1].blocked_by
    assert by_planner is not None and reason in by_planner
    assert found.blocked_by is not None
    if "wind of" not in found.blocked_by:  # too much wind is told in the mission's own words
        assert by_planner in found.blocked_by
    assert found.to_json()["duration_s"] is None


@pytest.mark.parametrize("seed", [1, 2])
def test_a_fin_on_the_pass_is_flown_around(seed: int, searches: list[ScanPlan]) -> None:
    """A thin plate where the arm passes on the uppermost pass: the tree finds a detour."""
    d = load_description("pipe-weld-scan", seed=seed)
    fin = Box(x_m=1.7, y_m=0.0, z_m=1.74, size_x_m=0.1, size_y_m=0.02, size_z_m=0.22)
    world = d.world.add_thing("fin", fin)
    free, found = plan_mission(d), plan_mission(d._replace(world=world))
    assert free.feasible and found.feasible, found.blocked_by
    assert free.way is not None and found.way is not None
    way, search = found.get_way(), searches[-1]
    query = build_clearance(build_scene(d.robot, world))

    def closest(p: MissionPlan) -> float:
        rows = p.segments["scan"][::20]
        return min(
            compute_clearance(query, r["p_WB"], r["R_WB"], r["q"][:2], True).distance for r in rows
        )

    assert closest(free) < 0.0 and closest(found) > 0.028
    assert search.statistics.failed_edges > 0
    assert len(search.corners_sphi) == 8
    for s, phi in search.corners_sphi:  # the corners are still visited
        away = np.abs(way.path_sphi - [s, phi]) * [1.0, 0.2]
        assert away.max(axis=1).min() < 2e-4


# way-points --------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ["hexarotor", "f550-bridge", "othex"])
def test_waypoints_for_every_robot(robot: str) -> None:
    d = load_description("waypoints", robot=robot)
    found = plan_mission(d)
    assert found.feasible, found.blocked_by
    assert list(found.segments) == [f"waypoint {i}" for i in range(1, 5)]
    for rows, w in zip(found.segments.values(), d.mission.task.points, strict=True):
        np.testing.assert_allclose(rows[-1]["p_WB"], [w.x_m, w.y_m, w.z_m], atol=1e-9)
        yaw = math.degrees(math.atan2(rows[-1]["R_WB"][1, 0], rows[-1]["R_WB"][0, 0]))
        assert (yaw - w.yaw_deg + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-6)


def test_waypoint_inside_an_obstacle_is_refused() -> None:
    d = load_description("waypoints")
    crate = Box(x_m=1.5, y_m=1.5, z_m=1.0, size_x_m=0.5, size_y_m=0.5, size_z_m=2.0)
    world = d.world.add_thing("crate", crate)
    found = plan_mission(d._replace(world=world))
    assert not found.feasible and found.blocked_by is not None
    assert found.blocked_by.startswith("way-point 2: goal: ") and "crate" in found.blocked_by


def test_a_flight_outside_the_world_s_area_is_refused() -> None:
    """Way-points at 1.5 m; the propellers reach 0.58 m farther while the robot turns."""
    d = load_description("waypoints", robot="hexarotor")
    for limits, told in (
        ({"x_max_m": 1.0}, r"^waypoint 2 at t = .* s: the robot is 1\.08 m .*x_max_m = 1\)"),
        ({"y_max_m": 1.9}, r" is 0\.1. m outside the world's area \(world\.area\.y_max_m = "),
        ({"z_max_m": 1.4}, r"world\.area\.z_max_m = 1\.4"),
        ({"x_max_m": 2.3, "y_max_m": 2.3}, None),
    ):
        world = d.world.model_copy(update={"area": Area(**limits)})
        found = plan_mission(d._replace(world=world))
        assert found.feasible == (told is None), found.blocked_by
        assert told is None or re.search(told, str(found.blocked_by)), found.blocked_by


def test_waypoints_lead_around_what_is_in_the_way() -> None:
    """A crate on the straight line between two way-points: the flight goes around it and rests."""
    d = load_description("waypoints")
    straight = plan_mission(d)
    a, b = d.mission.task.points[:2]
    crate = Box(
        x_m=(a.x_m + b.x_m) / 2, y_m=(a.y_m + b.y_m) / 2, z_m=1.0,
        size_x_m=0.2, size_y_m=0.2, size_z_m=2.0,
    )  # fmt: skip
    found = plan_mission(d._replace(world=d.world.add_thing("c", crate)))
    assert found.feasible, found.blocked_by
    assert found.min_clearance_m >= 0.05 and found.duration_s > straight.duration_s
    rows = found.segments["waypoint 2"]
    np.testing.assert_allclose(rows[-1]["p_WB"], [b.x_m, b.y_m, b.z_m], atol=1e-9)
    assert np.all(np.diff(rows["t"]) > 0) and np.linalg.norm(rows[-1]["v_WB"]) < 1e-9
    again = plan_mission(d._replace(world=d.world.add_thing("c", crate)))
    assert np.array_equal(again.segments["waypoint 2"], rows)  # same seed, same way


def test_the_numbers_of_a_climb_beside_a_crate_follow_by_hand(tmp_path: Path) -> None:
    """4 m up: ramps of 1.875 (1 m/s) / a = 2 s and 1 m/s between them."""
    a = 0.9375
    sets = [
        "mission.task.points=[{x_m=0,y_m=0,z_m=5.2,hold_s=0}]", "mission.hover_height_m=1.2",
        "robot.platform.drag_area_z_m2=0", f"robot.control.acceleration_max_mps2={a}",
    ]  # fmt: skip
    d = load_description("waypoints", sets=sets)
    crate = Box(  # its side is at 0.8 m
        x_m=1.3, y_m=0.0, z_m=3.0, size_x_m=1.0, size_y_m=2.0, size_z_m=2.0
    )  # fmt: skip
    setup = Setup(d._replace(world=d.world.add_thing("crate", crate)))
    found = plan_mission(setup.description, setup)
    assert found.duration_s == pytest.approx(6.0)
    none = np.zeros(0, [("t", float), ("phase", int)])
    m = _evaluate(Flown(setup, found, none, []), Flight(False, "not flown"), "", tmp_path).metrics
    rotors = d.robot.rotors
    assert rotors.azimuth_deg[0] == 30.0
    edge = rotors.radius_m * math.cos(math.radians(30.0)) + rotors.propeller_radius_m
    assert m["plan.min_clearance_m"] == pytest.approx(0.8 - edge)
    # six rotors share m (g - a) while it brakes, nearer to idle than m (g + a) to the limit
    least = d.robot.platform.mass_kg * (9.81 - a) / 6.0
    room = rotors.thrust_fraction * rotors.thrust_max_n - rotors.thrust_min_n
    assert m["plan.min_rotor_margin"] == pytest.approx((least - rotors.thrust_min_n) / room)


# transport ---------------------------------------------------------------------------------------


def test_the_numbers_of_a_free_transport_follow_by_hand() -> None:
    """4 m on a straight line with a = 0.5 m/s^2, for one period T of the pendulum each way.

    Without friction a pendulum that hangs at rest swings to twice atan(a / g) and, after a period,
    rests again: no swing is left when the robot brakes. The weight of a metre is 1.5; the hub's
    top, half its height above z = 2 m, is nearest to the area's upper limit.
    """
    a, length = 0.5, 4.0
    d = load_description("bar-transport", sets=["robot.pendulum.damping_nms_per_rad=0"])
    robot, area = drop_bar(d.robot), d.world.area.model_copy(update={"z_max_m": 2.4})
    way = Transport(goal=(length, 2.0, 0.0, -math.pi / 2.0), p1=1.5)
    problem = build_transport(robot, World(name="empty", area=area), way)
    period = compute_swing_period(build_swing_model(robot, problem), 0.0, -math.pi / 2.0, 9.81)
    limits = TimeLimits(speed=a * period, acceleration=a / math.sqrt(0.75))
    m = plan_transport(robot, problem, slices=1, limits=limits).file.metrics
    assert m["plan.cost"] == m["plan.lower_bound"] == pytest.approx(1.5 * length)
    assert m["plan.duration_s"] == pytest.approx(length / (a * period) + period, rel=1e-5)
    swing = 2.0 * math.degrees(math.atan(a / 9.81))
    assert m["plan.swing_max_deg"] == pytest.approx(swing, rel=2e-3)
    assert m["plan.clearance_min_m"] == pytest.approx(0.4 - robot.platform.height_m / 2.0)


def test_the_first_path_is_timed_apart_from_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that goes on by 0.25 s at each reading: once for each of eight slices of work."""
    readings = itertools.count()
    timed = partial(plan_path, clock=lambda: 0.25 * next(readings))
    monkeypatch.setattr(transport_plan, "plan_path", timed)
    d = load_description("bar-transport")
    robot = drop_bar(d.robot)
    found = plan_transport(robot, build_transport(robot, d.world), slices=8)
    assert len(found.path.history) > 1 and found.path.plan_s == 8 * 0.25
    assert found.file.metrics["plan.first_solution_s"] == 0.25  # found in the first slice


# other robots ------------------------------------------------------------------------------------


def test_arms_of_zero_one_and_three_joints() -> None:
    """The planner knows no robot: a fixed probe, one joint, and three in the plane."""
    d = load_description("pipe-weld-scan")
    arm = d.robot.arm
    assert arm is not None
    links, motor = arm.links, arm.servos["motor1"]
    stiff = {n: links[n].model_copy(update={"joint": "fixed"}) for n in ("link1", "link2")}
    wrist = links["link2"].model_copy(
        update={"length_m": 0.12, "mass_kg": 0.04, "folded_deg": 0.0, "working_deg": 0.0}
    )

    def fly(moved: dict, joints: int, **scan: object) -> MissionPlan:
        changed = arm.model_copy(
            update={
                "links": {**links, **moved},
                "servos": {f"motor{i}": motor for i in range(joints)},
                "belt": None,
            }
        )
        robot = d.robot.model_copy(update={"arm": changed})
        task = d.mission.task.model_copy(update=scan)
        mission = d.mission.model_copy(update={"task": task})
        return plan_mission(d._replace(robot=robot, mission=mission))

    assert fly(stiff, 0, pattern="line").feasible
    refused = fly(stiff, 0)  # a fixed probe must tilt by the sector's 20 deg
    assert not refused.feasible and "tilt 20.0 deg > 10.0 deg" in str(refused.blocked_by)
    assert fly({"link1": stiff["link1"]}, 1).feasible
    assert fly({"wrist": wrist}, 3).feasible
