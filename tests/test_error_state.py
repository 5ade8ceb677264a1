"""The error-state filter against closed forms, a dense textbook filter, and simulated truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from exact_map import EXACT
from skywright.core.record import View
from skywright.core.types import IMU_HISTORY
from skywright.description.loader import load_description
from skywright.errors import InputError
from skywright.evidence.consistency import (
    PARTS,
    compute_consistency,
    compute_nees,
    compute_whiteness,
    fly_traces,
)
from skywright.run.backends import build_vehicle
from skywright.run.parts import build_rules
from skywright.run.planning import plan_mission
from skywright.run.supervisor import Supervisor
from skywright.vehicle.estimators._strapdown import integrate, propagate_covariance
from skywright.vehicle.estimators.filter import Filter, fuse
from skywright.vehicle.readings import MocapSample
from skywright.vehicle.sensors.mocap import MotionCapture
from steps import Stepped

G = 9.81
SHORT = [*EXACT, "mission.task.passes=1", "mission.task.pass_length_m=0.03"]


def skew(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


@pytest.fixture
def flt():
    """A running filter with made-up samples, at an arbitrary state."""
    rng = np.random.default_rng(4)
    f = np.zeros(1, Filter.Me.dtype)[0]
    f["h"], f["r_p"], f["r_R"] = 1e-3, 3e-4**2, 2e-3**2
    f["sheet_p"], f["sheet_R"] = f["r_p"], f["r_R"]
    f["q_v"], f["q_R"], f["q_ba"], f["q_bg"] = 4e-3**2, 3.4e-4**2, 6e-3**2, 3.9e-5**2
    f["p_BI"] = [0.05, -0.02, 0.03]
    f["R_f"] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    f["v_f"], f["bg"], f["ba"] = [0.3, -0.1, 0.2], [0.01, -0.02, 0.005], [0.1, 0.05, -0.08]
    f["gyro"] = rng.normal(0.0, 0.5, (IMU_HISTORY, 3))
    f["accel"] = rng.normal(0.0, 1.0, (IMU_HISTORY, 3)) + [0, 0, G]
    a = rng.normal(size=(15, 15)) * np.repeat([1e-3, 1e-2, 1e-3, 1e-4, 1e-2], 3)[:, None]
    f["P"] = a @ a.T
    f["ready"] = 2.0
    return np.zeros(1, MocapSample.dtype)[0], f


def run_integrate(f, last, p, v, R):
    p, v, R, dv, turn = p.copy(), v.copy(), R.copy(), np.empty(3), np.empty((3, 3))
    integrate(View(f), 0, last, G, p, v, R, dv, turn)
    return p, v, R, dv, turn


def test_strapdown_integration_meets_the_closed_form(flt):
    """Turning at a constant rate about z while pushed along body x: a circle in velocity."""
    _, f = flt
    rate, push, n = 1.2, 2.0, 500
    f["bg"] = f["ba"] = 0.0
    f["gyro"], f["accel"] = [0, 0, rate], [push, 0, G]
    p, v, R, _, _ = run_integrate(f, n, np.zeros(3), np.zeros(3), np.eye(3))
    t = n * 1e-3
    np.testing.assert_allclose(R, Rotation.from_rotvec([0, 0, rate * t]).as_matrix(), atol=1e-12)
    s, c = np.sin(rate * t), np.cos(rate * t)
    np.testing.assert_allclose(v, [push / rate * s, push / rate * (1 - c), 0], atol=1e-6)
    x = push / rate**2 * np.array([1 - c, rate * t - s, 0])
    np.testing.assert_allclose(p, x, atol=1e-6)


def test_covariance_step_is_the_jacobian_of_the_integration(flt):
    """F by finite differences of `integrate`, then F P F' + Q; the biases drive through it."""
    _, f = flt
    n, T = 10, 0.01
    p0, v0, R0 = f["p_f"].copy(), f["v_f"].copy(), f["R_f"].copy()
    p1, v1, R1, dv, turn = run_integrate(f, n, p0, v0, R0)

    def moved(dx):
        f["bg"] += dx[9:12]
        f["ba"] += dx[12:15]
        out = run_integrate(
            f, n, p0 + dx[:3], v0 + dx[3:6], Rotation.from_rotvec(dx[6:9]).as_matrix() @ R0
        )
        f["bg"] -= dx[9:12]
        f["ba"] -= dx[12:15]
        turned = Rotation.from_matrix(out[2] @ R1.T).as_rotvec()
        return np.concatenate([out[0] - p1, out[1] - v1, turned, dx[9:]])

    step = 1e-5
    F = np.column_stack([(moved(step * e) - moved(-step * e)) / (2 * step) for e in np.eye(15)])
    Q = np.zeros(15)
    Q[3:6], Q[6:9], Q[9:12], Q[12:15] = f["q_v"], f["q_R"], f["q_bg"], f["q_ba"]
    expected = F @ f["P"] @ F.T + T * np.diag(Q)
    P = f["P"].copy()
    propagate_covariance(View(f), P, dv, turn, T)
    np.testing.assert_allclose(P, P.T, atol=0)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(P - expected) / scale) < 2e-3


def test_update_is_the_textbook_one(flt):
    meas, f = flt
    R, lever = f["R_f"].copy(), f["R_f"] @ f["p_BI"]
    shift, turn = np.array([2e-4, -3e-4, 1e-4]), np.array([1e-3, -2e-3, 5e-4])
    meas["p_WB"] = f["p_f"] - lever + shift
    meas["R_WB"] = Rotation.from_rotvec(turn).as_matrix() @ R
    P, p, v = f["P"].copy(), f["p_f"].copy(), f["v_f"].copy()
    H = np.zeros((6, 15))
    H[:3, :3], H[:3, 6:9], H[3:, 6:9] = np.eye(3), skew(lever), np.eye(3)
    S = H @ P @ H.T + np.diag([f["r_p"]] * 3 + [f["r_R"]] * 3)
    K = P @ H.T @ np.linalg.inv(S)
    nu = np.concatenate([shift, turn])
    dx = K @ nu
    assert fuse(View(f), View(meas))
    assert f["nis"] == pytest.approx(nu @ np.linalg.solve(S, nu), rel=1e-9)
    np.testing.assert_allclose(f["P"], P - K @ S @ K.T, atol=1e-12)
    np.testing.assert_allclose(f["p_f"], p + dx[:3], atol=1e-12)
    np.testing.assert_allclose(f["v_f"], v + dx[3:6], atol=1e-12)
    np.testing.assert_allclose(f["R_f"], Rotation.from_rotvec(dx[6:9]).as_matrix() @ R, atol=1e-12)


def test_gate_lets_an_artefact_change_nothing(flt):
    meas, f = flt
    meas["p_WB"], meas["R_WB"] = f["p_f"] - f["R_f"] @ f["p_BI"], f["R_f"]
    meas["p_WB"][1] += 0.05
    before = f["P"].copy(), f["p_f"].copy()
    assert not fuse(View(f), View(meas))
    assert f["nis"] > chi2.ppf(0.999, 6)
    np.testing.assert_array_equal(f["P"], before[0])
    np.testing.assert_array_equal(f["p_f"], before[1])


def feed(ticks, latency, artefacts=(), seed=0, worse=(1000, 1.0)):
    """Feed a filter a turning, swinging motion; motion capture every 10 ms, `latency` late.

    From a sample on, its noise is `worse` by a factor.
    """
    rng = np.random.default_rng(seed)
    b = Stepped(Filter("filter"), absent=["fix"])
    f, imu, mocap = b.me, b.imu, b.mocap
    f["h"], f["r_p"], f["r_R"], f["p_ba"], f["p_bg"] = 1e-3, 9e-8, 4e-6, 0.01, 2.5e-5
    f["sheet_p"], f["sheet_R"] = f["r_p"], f["r_R"]
    f["q_v"], f["q_R"], f["q_ba"], f["q_bg"] = 1.6e-5, 1.2e-7, 3.6e-5, 1.5e-9
    f["q_c"], f["r_c"], f["P_c"] = 2.5e-7, 1.8e-7, 1e-4
    f["dt"], b.body["mass"], b.body["gravity"] = 0.002, 2.0, G
    f["bandwidth"], f["rotor_tau"] = 12.0, 0.03
    b.body["R_BT"] = np.eye(3)
    w = np.array([0.2, -0.1, 0.4])
    R, v, p, h = np.eye(3), np.zeros(3), np.zeros(3), 1e-3
    half = Rotation.from_rotvec(0.5 * h * w).as_matrix()
    noise = rng.normal(size=(2000, 6))  # the same whatever the latency
    path = [(p, R)]
    for k in range(ticks):
        t = 0.002 * k
        imu["n"] = 0 if k == 0 else 2
        for i in range(imu["n"]):
            a = np.array([np.sin(3 * t), np.cos(2 * t), 0.5 * np.sin(t)])
            imu["accel"][i] = (R @ half).T @ (a + [0, 0, G]) + rng.normal(0, 0.126, 3)
            imu["gyro"][i] = w + rng.normal(0, 0.0107, 3)
            p, v = p + h * v + 0.5 * h * h * a, v + h * a
            R = R @ half @ half
        path.append((p, R))
        b.clock["t"] = imu["t"] = t
        mocap["fresh"] = 0.0
        exposed = k - round(latency / 0.002)
        if exposed >= 0 and exposed % 5 == 0:
            pe, Re = path[exposed + 1]
            size = worse[1] if exposed // 5 >= worse[0] else 1.0
            mocap["fresh"], mocap["t"], mocap["period"] = 1.0, 0.002 * exposed, 0.01
            mocap["p_WB"] = mocap["p_WT"] = pe + 3e-4 * size * noise[exposed, :3]
            mocap["R_WB"] = Re @ Rotation.from_rotvec(2e-3 * size * noise[exposed, 3:]).as_matrix()
            if exposed // 5 in artefacts:
                mocap["p_WB"] += [0.7, 0.0, -0.3]
        b()
    return b, p, R


def test_a_delayed_sample_is_worth_as_much_as_at_its_exposure():
    """Horizon and covariance do not depend on the delay; the newest state only on its age."""
    now, p, _ = feed(1001, 0.0)
    late, _, _ = feed(1001 + 15, 0.03)
    a, c = now.me, late.me
    assert a["n_f"] == c["n_f"] == 2000
    for name in ("p_f", "v_f", "R_f", "bg", "ba", "P"):
        np.testing.assert_allclose(c[name], a[name], rtol=1e-9, atol=1e-12)
    assert np.linalg.norm(now.est["p_WB"] - p) < 1e-3


def test_an_artefact_as_first_sample_does_not_start_the_filter():
    b, p, R = feed(501, 0.008, artefacts=(0,))
    assert b.me["rejected"] == 0
    assert np.linalg.norm(b.est["p_WB"] - p) < 2e-3
    assert Rotation.from_matrix(b.est["R_WB"].T @ R).magnitude() < 5e-3


def test_a_filter_that_is_wrong_starts_again():
    """All samples from the 20th on say something else, and agree with each other."""
    b, p, _ = feed(501, 0.008, artefacts=range(20, 1000))
    assert b.me["rejected"] == 10
    assert np.linalg.norm(b.est["p_WB"] - p - [0.7, 0.0, -0.3]) < 2e-3


@pytest.mark.parametrize(("since", "factor"), [(0, 2.0), (0, 8.0), (100, 4.0), (100, 8.0)])
def test_noise_of_motion_capture_that_grows_is_learned(since, factor):
    """Rejected samples that scatter mean noise: the filter weighs them less and keeps its state."""
    b, p, _ = feed(1001, 0.008, worse=(since, factor))
    f = b.me
    assert f["restarts"] == 0 and f["rejected"] < 40
    assert np.sqrt(f["r_p"]) / 3e-4 == pytest.approx(factor, rel=0.25)
    assert np.sqrt(f["r_R"]) / 2e-3 == pytest.approx(factor, rel=0.25)
    assert np.linalg.norm(b.est["p_WB"] - p) < 3.0 * np.linalg.norm(b.state["p_std"])
    assert np.linalg.norm(b.est["p_WB"] - p) < factor * 5e-4


def test_the_ring_is_long_enough_for_any_silence():
    """Two seconds without motion capture: the horizon follows, the variance grows."""
    b, _, _ = feed(1500, 0.008)
    f = b.me
    before = f["P"][0, 0]
    b.mocap["fresh"] = 0.0
    for _ in range(1000):
        b.clock["t"] += 0.002
        b.imu["t"] += 0.002
        b()
    assert f["n"] - f["n_f"] < IMU_HISTORY
    assert f["P"][0, 0] > 100 * before


# --- in flight -----------------------------------------------------------------------------------


def fly(sets, fault=None, mission="pipe-weld-scan", robot=None):
    d = load_description(mission, robot, sets=sets)
    blocks = []
    v = build_vehicle(d, blocks.append)
    on_tick = None if fault is None else lambda t, phase: fault(v, t, phase)
    flight = Supervisor(
        v,
        d.mission,
        plan_mission(d),
        d.robot.platform.gear_height_m,
        None,
        on_tick,
        rules=build_rules(d),
    ).fly()
    v.flush()
    return np.concatenate(blocks), v, flight


def test_consistent_over_seeds_and_innovations_white():
    """NEES inside its bounds: touch-down, contact and sliding included (see studies)."""
    known = [*SHORT, "plant.sensor_noise_error=0", "mission.timestep_ms=2"]  # what P rests on
    traces = fly_traces("pipe-weld-scan", known, range(1, 5))
    for name, part in PARTS.items():
        c = compute_consistency(traces, part)
        assert c.low < c.mean < c.high, name
        assert c.inside > 0.85, name
    # velocity and attitude are tight enough to matter: millimetres a second, a fifth of a degree
    sigma = np.sqrt(np.mean([np.diagonal(t.covariance, 0, 1, 2) for t in traces], axis=(0, 1)))
    assert np.all(sigma[3:6] < 4e-3) and np.all(sigma[6:9] < 3e-3)
    variance, memory = compute_whiteness(traces)
    np.testing.assert_allclose(variance, 1.0, atol=0.1)
    np.testing.assert_allclose(memory, 0.0, atol=0.05)
    assert np.mean(compute_nees(traces[0], PARTS["all"])) > 5.0  # not merely timid


class Silence:
    """No motion capture for half a second, again and again."""

    def __init__(self):
        self.gaps = 0

    def __call__(self, vehicle, t, phase):
        silent = phase in ("settle", "scan") and t % 2.0 < 0.5
        self.gaps += silent
        vehicle.assembly.get(MotionCapture.Me, "mocap")["dropout"] = 1.0 if silent else 0.01


def test_drop_outs_of_half_a_second_are_survived():
    silence = Silence()
    # the filter is tested, not the rule that draws back after 0.2 s
    s, _, flight = fly([*SHORT, "mission.faults.localisation_stale.on=false"], silence)
    assert flight.completed and silence.gaps > 50
    error = np.linalg.norm(s["est_p_WB"] - s["p_WB"], axis=1)[s["t"] > 5.0]
    assert error.max() < 0.015


def test_artefacts_of_motion_capture_are_rejected():
    s, v, flight = fly([*SHORT, "world.mocap.outlier_fraction=0.1"])
    assert flight.completed
    f = v.read(Filter.Me, "estimator")
    assert f["rejected"] > 0.08 * (f["fused"] + f["rejected"])
    flown = s[s["t"] > 5.0]
    assert np.linalg.norm(flown["est_p_WB"] - flown["p_WB"], axis=1).max() < 0.003
    # so are those of the probe's own markers, before they reach the weld's map
    assert np.linalg.norm(flown["meas_p_WT"] - flown["p_WT"], axis=1).max() < 0.02


def test_external_force_is_the_model_error_of_the_plant():
    """Hovering 5 % heavier and 5 % weaker than believed: the filter sees the missing lift."""
    sets = [
        "plant.mass_error=0.05", "plant.rotor_gain_error=-0.05", "plant.rotor_gain_spread=0",
    ]  # fmt: skip
    s, v, _ = fly(sets, mission="waypoints", robot="othex")
    held = s[(s["t"] > s["t"][-1] - 14.0) & (s["t"] < s["t"][-1] - 12.0)]
    mass = v.sim.scene.model.body_mass.sum()
    expected = mass / 1.05 * 9.81 - mass * 9.81 / 0.95
    assert np.mean(held["est_f_ext_W"][:, 2]) == pytest.approx(expected, rel=0.07)


def test_an_inertial_unit_off_the_centre_is_accounted_for():
    s, _, flight = fly([*SHORT, "robot.sensors.imu_x_m=0.08", "robot.sensors.imu_z_m=-0.06"])
    assert flight.completed
    flown = s[s["t"] > 5.0]
    assert np.linalg.norm(flown["est_p_WB"] - flown["p_WB"], axis=1).max() < 0.002
    velocity = np.linalg.norm(flown["est_v_WB"] - flown["v_WB"], axis=1)
    assert np.sqrt(np.mean(velocity**2)) < 0.006


def test_wrong_choices_are_told():
    with pytest.raises(InputError, match=r"mission\.estimator: estimator 'ukf' is unknown; valid:"):
        load_description("pipe-weld-scan", sets=["mission.estimator=ukf"])
